"""Rows of a run as an MCAP file, which Foxglove, PlotJuggler and Rerun open: one protobuf message a period.

A message has a double for each column, in the order of the columns; its schema is written by hand here, so that no
library of protobuf is needed. Names of columns and their units stand in the metadata of the channel, the provenance in
metadata of the file: once at the begin, and once more at the end with what only the run could tell. Each tenth of a
second becomes a chunk of its own that reaches the system at once, so a file that was cut off anywhere is read up to its
last whole chunk.
"""

import json
import re
import struct
from collections.abc import Mapping, Sequence
from io import BufferedWriter, FileIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.errors import UsageError, require
from haptic_fieldbus.recordings.provenance import METADATA

TOPIC, PACKAGE, MESSAGE = "run", "haptic_fieldbus", "Period"
DOUBLE, OPTIONAL, TEXT = 1, 1, 2
"""Type double and label optional of a field; wire type of a text (descriptor.proto)."""
CUT = "cut off"
"""Key of the metadata of a file whose rows are those of a recording that was cut off."""


def varint(value: int) -> bytes:
    """Return a whole number as protobuf writes it, seven bits an octet."""
    octets = bytearray()
    while value > 0x7F:
        octets.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*octets, value])


def _field(number: int, value: str | bytes | int) -> bytes:
    """Return a field of a message: a whole number, a text or an inner message."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    octets = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | TEXT) + varint(len(octets)) + octets


def descriptor(columns: Sequence[str]) -> bytes:
    """Return the FileDescriptorSet of the message: a double for each column (descriptor.proto)."""
    names: list[str] = []
    for column in columns:
        name = re.sub(r"\W+", "_", column, flags=re.ASCII)  # protobuf has names of ASCII letters alone
        names.append(name if name not in names else f"{name}_{len(names)}")
    fields = [
        _field(2, _field(1, name) + _field(3, number) + _field(4, OPTIONAL) + _field(5, DOUBLE))
        for number, name in enumerate(names, 1)
    ]
    message = _field(1, MESSAGE) + b"".join(fields)
    return _field(1, _field(1, "period.proto") + _field(2, PACKAGE) + _field(4, message) + _field(12, "proto3"))


def _tags(columns: int) -> list[bytes]:
    return [varint(number << 3 | 1) for number in range(1, columns + 1)]


class McapFile:
    """A new MCAP file of rows; raises OSError, or UsageError without the library."""

    def __init__(
        self, path: Path, columns: Sequence[str], units: Mapping[str, str], provenance: str, *, cut: bool = False
    ) -> None:
        require("mcap", "data")
        from mcap.writer import CompressionType, Writer

        self._file = BufferedWriter(FileIO(path, "w"))
        self._writer = Writer(self._file, compression=CompressionType.NONE)
        self._writer.start(profile="", library="haptic-fieldbus")
        self._tell(provenance)
        schema = self._writer.register_schema(f"{PACKAGE}.{MESSAGE}", "protobuf", descriptor(columns))
        told = {"columns": json.dumps(list(columns)), "units": json.dumps(dict(units))} | ({CUT: "true"} if cut else {})
        self._channel = self._writer.register_channel(TOPIC, "protobuf", schema, told)
        self._tags = _tags(len(columns))
        self._pack = struct.Struct("<" + "".join(f"{len(tag)}sd" for tag in self._tags)).pack
        self._values: list[bytes | float] = [each for tag in self._tags for each in (tag, 0.0)]

    def _tell(self, provenance: str) -> None:
        if provenance:
            self._writer.add_metadata(METADATA, {"json": provenance})

    def take(self, octets: bytes) -> None:
        """Append rows, doubles of this machine, as a chunk; raises OSError when the disk refuses it."""
        for row in np.frombuffer(octets).reshape(-1, len(self._tags)).tolist():
            self._values[1::2] = row
            t_ns = max(0, int(row[0]))
            self._writer.add_message(self._channel, t_ns, self._pack(*self._values), t_ns)
        self._writer.flush()

    def close(self, provenance: str | None) -> None:
        """Write the last provenance and the index, and close; raises OSError. None: leave the file as cut off."""
        try:
            if provenance is not None:
                self._tell(provenance)
                self._writer.finish()
            self._file.flush()
        finally:
            self._file.raw.close()


def read_mcap(path: Path) -> tuple[dict[str, NDArray[np.float64]], dict[str, str], str, bool]:
    """Return columns, units, the last provenance, and whether the file has its end.

    Of a file that was cut off, the rows are those of its whole chunks. Raises UsageError without the library and for a
    file that is none of ours, and OSError.
    """
    require("mcap", "data")
    from mcap.exceptions import McapError
    from mcap.records import Channel, Footer, Message, Metadata
    from mcap.stream_reader import StreamReader

    messages: list[bytes] = []
    told: dict[str, str] = {}
    provenance, complete = "", False
    with path.open("rb") as stream:
        reader = StreamReader(stream, validate_crcs=True, record_size_limit=max(1, path.stat().st_size))
        try:
            for record in reader.records:
                if isinstance(record, Channel) and record.topic == TOPIC:
                    told = record.metadata
                elif isinstance(record, Message):
                    messages.append(record.data)
                elif isinstance(record, Metadata) and record.name == METADATA:
                    provenance = record.metadata.get("json", "")
                complete = complete or isinstance(record, Footer)
        except (McapError, ValueError, struct.error):  # cut off, or torn
            complete = False
    complete = complete and CUT not in told
    if not told:
        raise UsageError(f"{path}: no MCAP file of a run, or cut off before its first chunk")
    try:
        columns, units = json.loads(told.get("columns", "[]")), dict(json.loads(told.get("units", "{}")))
        fields = [(str(n), [("tag", f"V{len(tag)}"), ("value", "<f8")]) for n, tag in enumerate(_tags(len(columns)))]
        kind = np.dtype(fields)
        if any(len(each) != kind.itemsize for each in messages):
            raise ValueError("a message with other fields")
        table = np.frombuffer(b"".join(messages), kind)
    except ValueError as error:
        raise UsageError(f"{path}: no MCAP file of a run: {error}") from error
    return {name: table[str(n)]["value"].astype(float) for n, name in enumerate(columns)}, units, provenance, complete

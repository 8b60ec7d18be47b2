"""Recordings read back: arrays by column, with units and the provenance; and rows written in another format."""

import json
import os
import re
import struct
import zlib
from base64 import b64decode
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.documents.safe_read import PROVENANCE_SIZE, check_regular, read_octets
from haptic_fieldbus.errors import UsageError, require, wrong_kind
from haptic_fieldbus.recordings.mcap import CUT, McapFile, read_mcap
from haptic_fieldbus.recordings.provenance import (
    LONGEST_NAME,
    MARK,
    METADATA,
    PICTURES,
    Provenance,
    digest,
    replacing,
    side_file,
    write_beside,
)
from haptic_fieldbus.recordings.tables import UNIT, arrow_table, column_units, heading, row_line

if TYPE_CHECKING:
    import can
    import pandas
    import pyarrow

FRAMES, ROWS = (".log", ".blf"), (".csv", ".mcap", ".parquet")
"""Suffixes of recordings of frames, and of one row a period."""
# A remote frame may have its length, eight octets their length code; candump -x and python-can add a direction.
_FRAME = re.compile(r"\((\d+\.\d+)\) (\S+) ([0-9A-F]+)#(?:(R)\d?|((?:[0-9A-F]{2})*))(?:_[0-9A-F])?(?: [RT])?$")


# Provenance of any file that a run leaves.

_FILE_NAME = re.compile(rf"(?!\.\.?$)[^/\\:\x00-\x1f]{{1,{LONGEST_NAME}}}")
# Whole groups of four: the next octet of a picture, such as the checksum of a PNG chunk, may be a digit of base64 too.
_MARKED = re.compile(MARK.encode() + rb"((?:[A-Za-z0-9+/]{4})*(?:[A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?)")


def read_provenance(path: str | Path) -> Provenance:
    """Return the provenance in a recording, a picture or the JSON object of a run, or in the file beside it.

    Raises UsageError when there is none that this version can read.
    """
    if not isinstance(path, str | Path):
        raise wrong_kind("path", "that of a recording, a picture or a JSON object", path)
    path = Path(path)
    found, holder = _found(path)
    if found is None:
        raise UsageError(f"{path}: no provenance in it, nor in a file {side_file(path).name} beside it")
    return checked(found, holder)


def check_apart(source: str | Path, *targets: str | Path | None) -> None:
    """Raise UsageError if a repeated run would be written over the file that it repeats, or over that beside it."""
    kept = {os.path.realpath(each) for each in (source, side_file(Path(source)))}
    for target in [Path(each) for each in targets if each is not None]:
        if kept & {os.path.realpath(each) for each in (target, side_file(target))}:
            raise UsageError(f"{target}: this file is repeated, and would be overwritten; name another one")


def _read(path: Path, reader: Callable[[Path], Any], fault: str) -> Any:
    """Return what a reader makes of a regular file; raises UsageError, which names it, where it can make nothing."""
    try:
        check_regular(path)
        return reader(path)
    except UsageError:
        raise
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        place = error.object.count(b"\n", 0, error.start) + 1
        octet = f"0x{error.object[error.start]:02X}"
        raise UsageError(f"{path}: line {place}: not UTF-8: octet {octet}; {fault}") from error
    except (ValueError, LookupError, TypeError, RecursionError, zlib.error) as error:  # of JSON, UTF-8 or base64
        raise UsageError(f"{path}: {fault}: {error}") from error


def checked(found: object, path: Path) -> Provenance:
    """Return the value of a JSON object; raises UsageError for one that no run has written."""
    from pydantic import TypeAdapter, ValidationError

    try:
        provenance = TypeAdapter(Provenance).validate_python(found)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "its provenance"
        raise UsageError(f"{path}: {place}: {first['msg']}") from error
    for text in filter(None, (provenance.scene, provenance.rig, *provenance.profiles, provenance.faults)):
        if not _FILE_NAME.fullmatch(text.name):
            raise UsageError(f"{path}: {text.name!r}: expected the name of a file, without a folder")
        if digest(text.text) != text.sha256:
            raise UsageError(f"{path}: {text.name} was changed after the run: its text does not have its SHA-256")
    names = [text.name for text in (provenance.rig, *provenance.profiles)]
    if len({*names}) < len(names):
        raise UsageError(f"{path}: expected a name of its own for rig and profiles, found {', '.join(names)}")
    return provenance


def _found(path: Path) -> tuple[Any, Path]:
    """Return the JSON object in a file, or in the file beside it, and the file that has it; None where there is none.

    Raises UsageError.
    """
    found, beside = _read(path, _held_in, "no provenance in it"), side_file(path)
    if found is None and beside.is_file():
        return _read(beside, _held_in, "no provenance in it"), beside
    return found, path


def _held_in(path: Path) -> Any:
    """Return the JSON object in a file; None where there is none. Raises OSError or ValueError."""
    if path.suffix == ".json":
        table = json.loads(read_octets(path, PROVENANCE_SIZE).decode())
        return table.get("provenance", table) if isinstance(table, dict) else None
    octets = read_octets(path, PROVENANCE_SIZE) if path.suffix in PICTURES else b""
    if marked := _MARKED.search(octets):
        table = json.loads(zlib.decompressobj().decompress(b64decode(marked[1]), PROVENANCE_SIZE))
        if isinstance(table, dict) and "files" in table:
            made = f"by {' '.join(table['command'])} on {table['date']} with version {table['version']}"
            raise UsageError(f"{path}: shows no run that could be repeated; made {made}")
        return table
    if path.suffix in HOLDERS:
        text = HOLDERS[path.suffix](path)[2]
        return json.loads(text) if text else None
    return None


# Rows and frames.


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recording: arrays of one length by column, with units and provenance."""

    path: Path
    columns: dict[str, NDArray[Any]]
    """Columns of rows, or `time`, `channel`, `can_id` and `data` of frames; CAN-IDs have the flags of SocketCAN."""
    units: dict[str, str]
    """Units of the columns that have one."""
    provenance: Provenance | None
    complete: bool
    """False for a file that was cut off; what came before is here."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, column: str) -> NDArray[Any]:
        return self.columns[column]

    @property
    def rows(self) -> bool:
        """True for one row a period, False for frames."""
        return "t_ns" in self.columns

    @property
    def time(self) -> NDArray[np.float64]:
        """Times from the first row or frame [s]."""
        times = self.columns["t_ns"] * 1e-9 if self.rows else self.columns["time"]
        return np.asarray(times - times[0] if len(times) else times, float)

    def table(self) -> NDArray[np.float64]:
        """Return the rows as `(n_rows, n_columns)`; raises UsageError for frames."""
        if not self.rows:
            raise UsageError(f"{self.path}: frames, not rows; expected one of {', '.join(ROWS)}")
        return np.column_stack(list(self.columns.values()))

    def to_arrow(self) -> "pyarrow.Table":
        """Return a table of Arrow, with units and provenance in its metadata; raises UsageError without pyarrow."""
        return arrow_table(self.columns, self.units, self.provenance)

    def to_frame(self) -> "pandas.DataFrame":
        """Return a frame of pandas; raises UsageError without pandas."""
        require("pandas", "data")
        return self.to_arrow().to_pandas()

    def write(self, path: str | Path) -> None:
        """Write the rows as .csv, .mcap or .parquet, the whole file or none; raises UsageError."""
        path, table = Path(path), self.table()
        if path.suffix not in ROWS:
            raise UsageError(f"{path}: expected one of {', '.join(ROWS)}")
        try:
            with replacing(path) as new:
                self._write_as(path.suffix, new, table)
                if path.suffix == ".csv" and self.provenance is not None:
                    write_beside(path, self.provenance, len(table) if self.complete else None)
            if path.suffix == ".csv" and self.provenance is None:
                side_file(path).unlink(missing_ok=True)  # that of another recording
        except OSError as error:
            raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error

    def _write_as(self, suffix: str, path: Path, table: NDArray[np.float64]) -> None:
        """Write the rows in the format of a suffix; raises OSError, or UsageError without the library of it."""
        if suffix == ".csv":
            path.write_bytes(heading(list(self.columns)) + b"".join(row_line(row) for row in table.tolist()))
        elif suffix == ".mcap":
            text = "" if self.provenance is None else self.provenance.text()
            file = McapFile(path, list(self.columns), self.units, text, cut=not self.complete)
            try:
                for first in range(0, len(table), 1000):
                    file.take(table[first : first + 1000].tobytes())
            except BaseException:
                file.close(None)
                raise
            file.close(text)
        else:
            written, cut = self.to_arrow(), {} if self.complete else {CUT: "true"}
            written = written.replace_schema_metadata({**(written.schema.metadata or {}), **cut})
            from pyarrow import parquet

            parquet.write_table(written, path)


def read_recording(path: str | Path) -> RecordedRun:
    """Return the recording of a run: rows (.csv, .mcap, .parquet) or frames (.log, .blf).

    A file that was cut off is read up to its last whole chunk, or its last whole line. Raises UsageError for a file
    that cannot be read, and without the library of its format.
    """
    if not isinstance(path, str | Path):
        raise wrong_kind("path", "that of a recording", path)
    path = Path(path)
    readers = {".csv": _csv, ".mcap": _held, ".parquet": _held, ".log": _candump, ".blf": _blf}
    if path.suffix not in readers:
        raise UsageError(f"{path}: expected a recording, one of {', '.join(readers)}")
    found: RecordedRun = _read(path, readers[path.suffix], "no recording of this format")
    return found


def _of(path: Path, columns: Mapping[str, Any], complete: bool) -> RecordedRun:
    """Return a recording with the provenance of the file beside it, which may tell the number of its rows or frames."""
    told, holder = _found(path)
    provenance = None if told is None else checked(told, holder)
    if told is not None and "count" in told:
        complete &= told["count"] is not None and len(next(iter(columns.values()))) >= told["count"]
    return RecordedRun(path, dict(columns), column_units(columns, provenance), provenance, complete)


def _csv(path: Path) -> RecordedRun:
    octets = path.read_bytes()
    whole = octets[: octets.rfind(b"\n") + 1].decode("utf-8-sig")
    head, _, body = whole.partition("\n")
    names = head.rstrip("\r").split(",")
    if names[0] != "t_ns" or len({*names}) < len(names):
        head, *_ = (head or octets.decode("utf-8-sig")).splitlines() or [""]  # also of a row without an end
        raise UsageError(f'{path}: row 1: "{head[:40]}"; expected names of columns, each once, the first of them t_ns')
    table, expected = _numbers(body, len(names)), f"expected {len(names)} numbers"
    if table is None:  # numpy counts other lines than an editor, and skips an empty one
        for place, line in enumerate(body.splitlines(), 2):
            if line and _numbers(line, len(names)) is None:
                raise UsageError(f'{path}: line {place}: "{line[:40]}"; {expected} between commas')
        raise ValueError(f"{expected} in a line")
    columns = {name: table[:, place] for place, name in enumerate(names)}
    _check_times(path, columns["t_ns"])
    return _of(path, columns, len(whole) > 0 and octets.endswith(b"\n"))


def _numbers(lines: str, count: int) -> NDArray[np.float64] | None:
    """Return the numbers in lines of so many, (n_lines, count); None where a line is another one."""
    with suppress(ValueError):
        table = np.loadtxt(StringIO(lines), delimiter=",", ndmin=2) if lines else np.empty((0, count))
        return table if table.shape[1] == count else None
    return None


def check_rows(path: Path, column: str, values: NDArray[Any], good: NDArray[np.bool_], expected: str) -> None:
    """Raise UsageError for the first value of a column that is not as expected; row 1 is that of the names."""
    if not good.all():
        row = int(np.argmin(good))
        raise UsageError(f"{path}: row {row + 2}, column {column}: {values[row]:g}; expected {expected}")


def _check_times(path: Path, times: NDArray[np.float64]) -> None:
    """Raise UsageError for the first time that is not later than the one before."""
    with np.errstate(invalid="ignore"):
        rising = np.isfinite(times) & (np.diff(times, prepend=-np.inf) > 0.0)
    check_rows(path, "t_ns", times, rising, "a finite time, later than that of the row before")


def _held(path: Path) -> RecordedRun:
    """Return the rows of a file that holds its provenance."""
    columns, units, text, complete = HOLDERS[path.suffix](path)
    if "t_ns" not in columns:
        raise UsageError(f"{path}: no recording of a run: it has no column t_ns")
    _check_times(path, columns["t_ns"])
    return RecordedRun(path, {**columns}, units, checked(json.loads(text), path) if text else None, complete)


def _parquet(path: Path) -> tuple[dict[str, NDArray[np.float64]], dict[str, str], str, bool]:
    """Return what `read_mcap` returns."""
    require("pyarrow", "data")
    from pyarrow import parquet

    table = parquet.read_table(path)
    units = {each.name: each.metadata[UNIT].decode() for each in table.schema if UNIT in (each.metadata or {})}
    text = (table.schema.metadata or {}).get(METADATA.encode(), b"").decode()
    columns = {name: table[name].to_numpy().astype(float) for name in table.column_names}
    return columns, units, text, CUT.encode() not in (table.schema.metadata or {})


HOLDERS = {".mcap": read_mcap, ".parquet": _parquet}
"""By suffix: function that returns columns, units, provenance, and whether the file has its end."""


EXTENDED, REMOTE, ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
"""Flags of a CAN-ID (linux/can.h)."""


def _can_id(message: "can.Message") -> int:
    flags = EXTENDED * message.is_extended_id | REMOTE * message.is_remote_frame | ERROR * message.is_error_frame
    return message.arbitration_id | flags


def _candump(path: Path) -> RecordedRun:
    text = path.read_bytes().decode()
    if not text:
        raise UsageError(f"{path}: an empty file; expected frames as candump -L writes them")
    lines = text.splitlines()[: None if text.endswith("\n") else -1]
    found = [_FRAME.match(line) for line in lines]
    if not all(found):
        wrong = found.index(None)
        words = "is a frame of CAN FD; remove such lines" if "##" in lines[wrong] else "is not as candump -L writes it"
        raise UsageError(f"{path}: line {wrong + 1} {words}")
    frames = []
    for time, channel, can_id, remote, data in (each.groups() for each in found if each is not None):
        number = int(can_id, 16)
        number |= EXTENDED * (len(can_id) > 3 and not number & ERROR) | REMOTE * bool(remote)
        frames.append((float(time), channel, number, bytes.fromhex(data or "")))
    return _frames(path, frames, complete=text.endswith("\n"))


def _blf(path: Path) -> RecordedRun:
    from can.io.blf import BLFParseError, BLFReader

    frames: list[tuple[float, str, int, bytes]] = []
    with path.open("rb") as stream:
        try:
            reader = BLFReader(stream)
            frames.extend((each.timestamp, str(each.channel), _can_id(each), bytes(each.data)) for each in reader)
        except (BLFParseError, struct.error, zlib.error) as error:
            if not frames:
                raise ValueError(error) from error
            return _frames(path, frames, complete=False)  # cut off within an object
    return _frames(path, frames, complete=reader.file_size == path.stat().st_size)  # it is written at the end


def _frames(path: Path, frames: Sequence[tuple[float, str, int, bytes]], *, complete: bool) -> RecordedRun:
    """Return the recording of frames: time, channel, CAN-ID and data of each."""
    kinds = {"time": float, "channel": object, "can_id": np.int64, "data": object}
    columns = {name: np.array([each[n] for each in frames], kind) for n, (name, kind) in enumerate(kinds.items())}
    return _of(path, columns, complete)

"""Files of CAN frames: `.log` in the format of `candump -L`, `.blf` for Vector's tools and Wireshark."""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from io import BufferedWriter, FileIO
from pathlib import Path
from struct import Struct
from typing import Protocol

from haptic_fieldbus.buses.writing import FRAME_SUFFIXES, LogFile, WritingProcess, cut_file, pieces
from haptic_fieldbus.protocols.canopen.pdo import worst_case_bits

EXTENDED_FLAG = 0x8000_0000
REMOTE_FLAG = 0x4000_0000
ERROR_FLAG = 0x2000_0000
CAN_ID_MASK = 0x1FFF_FFFF
"""Mask of the identifier; it and the three flags make up a CAN-ID as SocketCAN writes it (linux/can.h)."""


def frame_bits(can_id: int, data: bytes | bytearray) -> int:
    """Return the bits of a received frame with worst-case stuffing; 0 for an error frame, whose length is unknown."""
    if can_id & ERROR_FLAG:
        return 0
    return worst_case_bits(0 if can_id & REMOTE_FLAG else len(data), extended=bool(can_id & EXTENDED_FLAG))


FrameLog = Callable[[int, int, bytes | bytearray], None]
"""Function that is called with every frame of a bus: time [ns], CAN-ID with the flags of SocketCAN, data."""


class FrameWriter(Protocol):
    """Writer of a file of frames. A call takes a frame of the only bus of a run; `channel` serves several buses."""

    def __call__(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None: ...

    def channel(self, name: str) -> FrameLog:
        """Return the log of one of several buses: by its name, or numbered from 1 in a format with channel numbers."""

    def close(self) -> None: ...


class CandumpWriter:
    """Writer of `candump -L` text.

    python-can's own writer ends each line with " R" or " T", which tshark refuses.
    """

    def __init__(self, path: Path) -> None:
        self._file = LogFile(path)

    def __call__(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        self._write("can0", t_ns, can_id, data)

    def channel(self, name: str) -> FrameLog:
        # A field of the format ends at white space.
        return partial(self._write, "_".join(name.split()))

    def _write(self, channel: str, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        seconds, microseconds = divmod(t_ns // 1000, 1_000_000)
        line = f"({seconds:010d}.{microseconds:06d}) {channel} {_candump_frame(can_id, data)}\n"
        self._file.add(line.encode())

    def close(self) -> None:
        self._file.close()


def _candump_frame(can_id: int, data: bytes | bytearray) -> str:
    if can_id & ERROR_FLAG:
        return f"{can_id & (ERROR_FLAG | CAN_ID_MASK):08X}#{data.hex().upper()}"
    name = f"{can_id & CAN_ID_MASK:08X}" if can_id & EXTENDED_FLAG else f"{can_id & CAN_ID_MASK:03X}"
    return f"{name}#R" if can_id & REMOTE_FLAG else f"{name}#{data.hex().upper()}"


class BlfWriter:
    """Writer of Vector's binary logging format, by means of python-can.

    Each container of frames reaches the system in one piece, so that a killed run leaves a file that can be read.
    """

    def __init__(self, path: Path) -> None:
        from can.io import BLFWriter

        # The buffer holds a whole container, which python-can writes in several pieces.
        self._file = BufferedWriter(FileIO(path, "w"), 2 * BLFWriter.max_container_size)
        self._writer = BLFWriter(self._file, channel=1)
        self._size = 0
        self._flush()
        self._channels = 0

    def __call__(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        self._write(None, t_ns, can_id, data)

    def channel(self, name: str) -> FrameLog:
        self._channels += 1
        return partial(self._write, self._channels - 1)  # python-can counts channels from 0, and writes them from 1

    def _write(self, channel: int | None, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        from can import Message

        self._writer.on_message_received(
            Message(
                timestamp=t_ns * 1e-9,
                channel=channel,
                arbitration_id=can_id & CAN_ID_MASK,
                is_extended_id=bool(can_id & EXTENDED_FLAG),
                is_remote_frame=bool(can_id & REMOTE_FLAG),
                is_error_frame=bool(can_id & ERROR_FLAG),
                data=data,
            )
        )
        if self._file.tell() != self._size:
            self._flush()

    def _flush(self) -> None:
        """Hand a container to the system; raises OSError, after which the file ends with the container before."""
        try:
            self._file.flush()
        except OSError:
            self._give_up()
            raise
        self._size = self._file.tell()

    def _give_up(self) -> None:
        cut_file(self._file.fileno(), self._size)
        self._file.raw.close()  # below the buffer, which would try again

    def close(self) -> None:
        if self._file.closed:
            return
        try:
            self._writer.stop()
        except OSError:
            self._give_up()
            raise


PIECE = Struct("<qIBB8s")
"""A frame on its way to the writing process: time, CAN-ID, number of the bus, octets of data, data."""
GATHERED = 4096
"""[octets]; so many are handed over at once."""


class ProcessWriter:
    """Writer of a file of frames in another process, for a run in real time; the buses are named in advance."""

    def __init__(self, path: Path, buses: Sequence[str]) -> None:
        path.open("wb").close()  # what cannot be written is refused at once
        program = "from haptic_fieldbus.buses.canopen.frames import main; main()"
        self._process = WritingProcess(program, str(path), *buses)
        self._buses = list(buses)
        self._gathered = bytearray()

    def __call__(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        self._write(0, t_ns, can_id, data)

    def channel(self, name: str) -> FrameLog:
        return partial(self._write, self._buses.index(name))

    def _write(self, bus: int, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        self._gathered += PIECE.pack(t_ns, can_id, bus, len(data), bytes(data))
        if len(self._gathered) >= GATHERED:
            self._hand_over()

    def _hand_over(self) -> None:
        gathered = bytes(self._gathered)
        self._gathered.clear()
        self._process.take(gathered)

    def close(self) -> None:
        try:
            self._hand_over()
        finally:
            self._process.close()


def main() -> None:
    """Write the frames that come on standard input to the file named first, for the buses named after it."""
    path, *buses = Path(sys.argv[1]), *sys.argv[2:]
    try:
        writer = WRITERS[path.suffix](path)
        logs = list(_logs_of(writer, buses).values())
        for octets in pieces(PIECE.size):
            for t_ns, can_id, bus, size, data in PIECE.iter_unpack(octets):
                logs[bus](t_ns, can_id, data[:size])
        writer.close()
    except OSError as error:
        sys.exit(error.strerror or str(error))


def _logs_of(writer: FrameWriter, buses: Sequence[str]) -> dict[str, FrameLog]:
    return {buses[0]: writer} if len(buses) == 1 else {name: writer.channel(name) for name in buses}


WRITERS: Mapping[str, Callable[[Path], FrameWriter]] = {".log": CandumpWriter, ".blf": BlfWriter}
"""Writer by the suffix of its file, one for each of `FRAME_SUFFIXES`."""


def open_frame_writer(path: Path) -> FrameWriter | None:
    """Open a writer for a file of frames; None when the suffix names no format of frames."""
    return WRITERS[path.suffix](path) if path.suffix in WRITERS else None


@contextmanager
def frame_logs(path: Path | None, buses: Sequence[str], *, simulated: bool = True) -> Iterator[Mapping[str, FrameLog]]:
    """Yield a log for each named bus, all into one file; an empty mapping when `path` is no file of frames.

    In virtual time this process writes, because nothing waits for it; otherwise another one does.

    A log never raises: the exchange goes on without it. Its error is raised at the end of the block, as that of closing
    the file. Raises OSError.
    """
    if path is None or path.suffix not in FRAME_SUFFIXES:
        yield {}
        return
    writer = WRITERS[path.suffix](path) if simulated else ProcessWriter(path, buses)
    faults: list[Exception] = []

    def note(log: FrameLog, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        """Record a frame; after a first error nothing more is recorded."""
        if not faults:
            try:
                log(t_ns, can_id, data)
            except Exception as error:
                faults.append(error)

    try:
        yield {name: partial(note, log) for name, log in _logs_of(writer, buses).items()}
    finally:
        try:
            writer.close()
        except Exception as error:
            faults.append(error)
    if faults:
        raise faults[-1]  # that of closing is of the disk itself, so it says more than that of a pipe before

"""Files of CAN frames: `.log` in the format of `candump -L`, `.blf` for Vector's tools and Wireshark."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

FRAME_SUFFIXES = (".log", ".blf")

EXTENDED_FLAG = 0x8000_0000
REMOTE_FLAG = 0x4000_0000
ERROR_FLAG = 0x2000_0000
CAN_ID_MASK = 0x1FFF_FFFF
"""Mask of the identifier; it and the three flags make up a CAN-ID as SocketCAN writes it (linux/can.h)."""
BUFFER = 1 << 16
"""[octets]; the loop writes to the disk only when so many have gathered."""


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

    def __init__(self, path: Path, channel: str = "can0") -> None:
        self._file = path.open("w", encoding="ascii", buffering=BUFFER, newline="\n")
        self._channel = channel

    def __call__(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        self._write(self._channel, t_ns, can_id, data)

    def channel(self, name: str) -> FrameLog:
        # A field of the format ends at white space.
        return partial(self._write, "_".join(name.split()))

    def _write(self, channel: str, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        seconds, microseconds = divmod(t_ns // 1000, 1_000_000)
        self._file.write(f"({seconds:010d}.{microseconds:06d}) {channel} {_candump_frame(can_id, data)}\n")

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _candump_frame(can_id: int, data: bytes | bytearray) -> str:
    if can_id & ERROR_FLAG:
        return f"{can_id & (ERROR_FLAG | CAN_ID_MASK):08X}#{data.hex().upper()}"
    name = f"{can_id & CAN_ID_MASK:08X}" if can_id & EXTENDED_FLAG else f"{can_id & CAN_ID_MASK:03X}"
    return f"{name}#R" if can_id & REMOTE_FLAG else f"{name}#{data.hex().upper()}"


class BlfWriter:
    """Writer of Vector's binary logging format, by means of python-can."""

    def __init__(self, path: Path, channel: int = 1) -> None:
        from can.io import BLFWriter

        self._writer = BLFWriter(path, channel=channel)
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

    def close(self) -> None:
        self._writer.stop()


def open_frame_writer(path: Path, channel: str = "can0") -> FrameWriter | None:
    """Open a writer for a file of frames; None when the suffix names no format of frames."""
    if path.suffix == ".log":
        return CandumpWriter(path, channel)
    return BlfWriter(path) if path.suffix == ".blf" else None


@contextmanager
def frame_logs(path: Path | None, buses: Sequence[str]) -> Iterator[Mapping[str, FrameLog]]:
    """Yield a log for each named bus, all into one file; an empty mapping when `path` is no file of frames."""
    writer = None if path is None else open_frame_writer(path)
    if writer is None:
        yield {}
        return
    try:
        yield {buses[0]: writer} if len(buses) == 1 else {name: writer.channel(name) for name in buses}
    finally:
        writer.close()

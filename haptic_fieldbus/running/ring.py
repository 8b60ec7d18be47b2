"""A ring of rows in shared memory: one process writes a row each period, others read without disturbing it.

The memory is a file without a name. A reader gets its descriptor over a socket and maps it; the memory lives as long as
any process has it open, so no reader can take it away when it ends. (`multiprocessing.shared_memory` of Python below
3.13 unlinks a segment when any reader ends.)

Layout: a header with the number of completed rows, then `capacity` slots. A slot is the number of the row, the row, and
the number again. The writer writes the slot from front to back and then the header; it never waits. A reader copies
slots, then reads the header again, and drops each row that the writer may have reached in the meantime or whose two
numbers differ. So it never returns a torn row.
"""

import contextlib
import json
import mmap
import os
import socket
import struct
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"HFRING1\0"
HEADER = struct.Struct("@8sIIQ")
"""Magic, values in a row, slots, completed rows."""
COUNT = struct.Struct("@Q")
COUNT_AT = HEADER.size - COUNT.size
SLOTS_AT = 64
"""Begin of the slots: a multiple of the size of a number."""
LONGEST_LINE = 65_536
"""Octets of a command after which its sender is left."""


def _size(columns: int, capacity: int) -> int:
    return SLOTS_AT + capacity * 8 * (columns + 2)


def _nameless(size: int) -> int:
    """Return the descriptor of a file in memory without a name, or of a deleted file where there are none."""
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("haptic-fieldbus", os.MFD_CLOEXEC)
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, size)
    return fd


class RingWriter:
    """The writing end; `fd` is what readers map."""

    def __init__(self, columns: int, capacity: int) -> None:
        """Make a ring of `capacity` rows of `columns` numbers."""
        self.columns, self.capacity, self.pushed = columns, capacity, 0
        self.fd = _nameless(_size(columns, capacity))
        self._memory = mmap.mmap(self.fd, _size(columns, capacity))
        # Every page is touched here, so that no push in the loop waits for memory.
        self._memory[:] = bytes(len(self._memory))
        HEADER.pack_into(self._memory, 0, MAGIC, columns, capacity, 0)
        slot = struct.Struct(f"{columns + 2}d")
        self._pack, self._count, self._step = slot.pack_into, COUNT.pack_into, slot.size

    def push(self, row: Sequence[float], rest: Sequence[float] = ()) -> None:
        """Append one row, in two parts; a full ring overwrites its oldest one.

        Raises `struct.error` for a row of another length.
        """
        memory, before = self._memory, self.pushed
        self.pushed = number = before + 1
        self._pack(memory, SLOTS_AT + before % self.capacity * self._step, number, *row, *rest, number)
        self._count(memory, COUNT_AT, number)

    def close(self) -> None:
        """Leave the ring; readers that have it open keep it."""
        self._memory.close()
        os.close(self.fd)


class RingReader:
    """The reading end of a ring; the memory is mapped read-only."""

    def __init__(self, fd: int) -> None:
        """Map the ring behind a descriptor, which may be closed afterwards; raises ValueError for anything else."""
        size = os.fstat(fd).st_size
        if size < SLOTS_AT:
            raise ValueError("no ring: the file is too short")
        self._memory = mmap.mmap(fd, size, access=mmap.ACCESS_READ)
        magic, self.columns, self.capacity, _ = HEADER.unpack_from(self._memory)
        if magic != MAGIC or not self.capacity or size != _size(self.columns, self.capacity):
            raise ValueError("no ring of this version")
        self._slots = np.frombuffer(self._memory, offset=SLOTS_AT).reshape(self.capacity, self.columns + 2)

    @property
    def pushed(self) -> int:
        """Number of rows completed since the ring was made."""
        return int(COUNT.unpack_from(self._memory, COUNT_AT)[0])

    def since(self, first: int) -> tuple[int, NDArray[np.float64]]:
        """Return the number of the oldest row that is left from row `first` on, and the rows, shape `(n, columns)`."""
        end = self.pushed
        first = max(first, end - self.capacity, 0)
        numbers = np.arange(first, end)
        slots = self._slots[numbers % self.capacity]
        # The writer may be in the slot after the last completed row, which is that of the oldest one.
        reached = self.pushed - self.capacity + 1
        whole = (slots[:, 0] == numbers + 1) & (slots[:, -1] == numbers + 1) & (numbers >= reached)
        torn = np.flatnonzero(~whole)
        left = int(torn[-1]) + 1 if len(torn) else 0
        return first + left, slots[left:, 1:-1]


class LiveReader:
    """The other end, in the process that shows pages: the ring, and the messages of the run."""

    def __init__(self, path: Path) -> None:
        """Connect to a run; raises OSError."""
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.connect(str(path))
        self._received = b""

    def send(self, command: Mapping[str, Any]) -> None:
        """Send a command; raises OSError when the run is gone."""
        self.socket.sendall(json.dumps(command).encode() + b"\n")

    def close(self) -> None:
        """Leave the run."""
        self.socket.close()

    def messages(self) -> Iterator[tuple[dict[str, Any], int | None]]:
        """Yield each message of the run, with the descriptor of the ring that came with it; ends with the run."""
        fds: list[int] = []
        with contextlib.suppress(OSError):
            while (received := socket.recv_fds(self.socket, LONGEST_LINE, 4))[0]:
                fds += received[1]
                *lines, self._received = (self._received + received[0]).split(b"\n")
                for message in map(json.loads, lines):
                    yield message, fds.pop(0) if "hello" in message and fds else None

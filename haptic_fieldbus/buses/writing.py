"""A process that writes a file while a run goes on, so that the loop waits for no disk and formats no text.

It is handed octets through a pipe that never makes the loop wait. It outlives a run that is killed, and writes all that
was handed over.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from io import FileIO
from pathlib import Path
from select import select
from time import monotonic

# A file of text that grows by whole lines, so that what a killed process leaves behind can be read.
#
# Lines gather in memory, and many are handed to the system at once. The system keeps what it was handed, also when the
# process is killed. Where the disk took a part only, as a full one does, the torn line at the end is cut off again.

FRAME_SUFFIXES = (".log", ".blf")
"""Suffixes of files of CAN frames."""
CHUNK = 1 << 16
"""[octets]; the disk is asked only when so many have gathered."""


class LogFile:
    """A new file at `path`; raises OSError when it cannot be made."""

    def __init__(self, path: Path) -> None:
        self._file = FileIO(path, "w")
        self._gathered = bytearray()
        self._size = 0

    def add(self, line: bytes) -> None:
        """Append a line, its end included; raises OSError when the disk refuses it."""
        self._gathered += line
        if len(self._gathered) >= CHUNK:
            self.flush()

    def flush(self) -> None:
        """Hand all lines to the system; raises OSError, after which the file ends with the last line that fitted."""
        chunk = bytes(self._gathered)
        self._gathered.clear()
        done = 0
        try:
            while done < len(chunk):
                done += self._file.write(chunk[done:]) or 0
        except OSError:
            cut_file(self._file.fileno(), self._size + chunk.rfind(b"\n", 0, done) + 1)
            raise
        self._size += done

    def close(self) -> None:
        """Hand over the rest and close; raises OSError."""
        try:
            if self._gathered:
                self.flush()
        finally:
            self._file.close()


def cut_file(number: int, size: int) -> None:
    """Cut the file of a descriptor down to `size` octets, if it can be cut; a device such as /dev/full cannot."""
    with suppress(OSError):
        os.ftruncate(number, size)
        os.lseek(number, size, os.SEEK_SET)


PIPE = 1 << 20
"""[octets] that may wait for the disk: ten seconds of rows at 1 kHz."""
PARTING = 30.0
"""Longest time for which the end of the run waits for the disk [s]."""


class WritingProcess:
    """A process that runs `program`, a text in Python, which reads `pieces` and writes the file."""

    def __init__(self, program: str, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,  # who reads the output of the run is not to wait for a disk
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,  # Ctrl-C at the terminal ends the run, not the file
        )
        self._pipe = self._process.stdin.fileno() if self._process.stdin is not None else -1
        os.set_blocking(self._pipe, False)
        self._rest = b""

    def take(self, octets: bytes) -> None:
        """Hand over octets; raises OSError when the process has ended, or the disk is too slow."""
        self._rest += octets
        self._pass_on()
        if len(self._rest) > PIPE:
            raise OSError("the disk is too slow")

    def _pass_on(self) -> None:
        """Hand over as much as the pipe takes now; raises BrokenPipeError when nobody reads it."""
        with suppress(BlockingIOError):
            while self._rest:
                self._rest = self._rest[os.write(self._pipe, self._rest) :]

    def close(self) -> None:
        """Hand over the rest and wait for the end; raises OSError when the file is not complete."""
        end = monotonic() + PARTING
        with suppress(BrokenPipeError):  # the process tells why
            while self._rest and select([], [self._pipe], [], max(0.0, end - monotonic()))[1]:
                self._pass_on()
        try:
            _, told = self._process.communicate(timeout=max(1.0, end - monotonic()))
        except subprocess.TimeoutExpired:
            raise OSError(f"the disk did not accept the last rows within {PARTING:g} s") from None
        if self._process.returncode or self._rest:
            raise OSError(told.decode(errors="replace").strip() or "its writing process was killed")


def pieces(size: int) -> Iterator[bytes]:
    """Yield what comes on standard input, whole pieces of so many octets, as soon as they are there."""
    waiting = b""
    while octets := os.read(0, PIPE):
        waiting += octets
        whole = len(waiting) // size * size
        yield waiting[:whole]
        waiting = waiting[whole:]

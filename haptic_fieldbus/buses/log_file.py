"""A file of text that grows by whole lines, so that what a killed process leaves behind can be read.

Lines gather in memory, and many are handed to the system at once. The system keeps what it was handed, also when the
process is killed. Where the disk took a part only, as a full one does, the torn line at the end is cut off again.
"""

import os
from contextlib import suppress
from io import FileIO
from pathlib import Path

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

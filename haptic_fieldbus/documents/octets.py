"""The octets of a file from outside, which may be anything: a device, a FIFO, far too large, or exchanged meanwhile.

Only a regular file of bounded size is read. The path is looked at before it is opened, because opening a device or a
FIFO has effects, and what was opened is looked at again, because another file may stand there by then. Opening never
waits (O_NONBLOCK).
"""

import errno
import os
import stat
from pathlib import Path

KIBI = 1 << 10
MEBI = 1 << 20

TOML_SIZE = 256 * KIBI
"""Most octets of a scene, rig, profile or file of faults; the shipped ones have less than a tenth."""
EDS_SIZE = 2 * MEBI
"""Most octets of an EDS or DCF; the largest vendor's file that was met has a tenth."""
TABLE_SIZE = 32 * MEBI
"""Most octets of a table of numbers, such as a recorded motion."""

READING = os.O_RDONLY
"""Flags by which a file is opened; Windows has others than POSIX."""
for _flag in ("O_CLOEXEC", "O_NONBLOCK", "O_NOCTTY", "O_BINARY"):
    READING |= getattr(os, _flag, 0)

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


IMPOSSIBLE_NAME = "no file can have this name"
"""For a NUL or a character that cannot be encoded; the words of Python differ between its versions."""


def read_octets(path: str | Path, most: int) -> bytes:
    """Return the content of a regular file of at most `most` octets.

    Raises FileNotFoundError, or OSError with the reason as `strerror`, whatever is wrong with the path or the file.
    """
    try:
        _check_regular(os.stat(path))
        descriptor = os.open(path, READING)
    except ValueError as cause:
        raise OSError(errno.EINVAL, IMPOSSIBLE_NAME) from cause
    try:
        found = os.fstat(descriptor)
        _check_regular(found)
        _check_size(found.st_size, most)
        return _read(descriptor, most)
    finally:
        os.close(descriptor)


def _check_regular(found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = next((words for is_kind, words in _KINDS if is_kind(found.st_mode)), "something else")
        raise OSError(errno.EINVAL, f"it is {kind}; expected a regular file")


def _check_size(size: int, most: int) -> None:
    if size > most:
        raise OSError(errno.EFBIG, f"it is too large; expected at most {most} octets")


def _read(descriptor: int, most: int) -> bytes:
    """Return all octets; the size was told before, but a file may grow, and those of /proc tell 0."""
    chunks, size = [], 0
    while chunk := os.read(descriptor, most + 1 - size):
        chunks.append(chunk)
        size += len(chunk)
        _check_size(size, most)
    return b"".join(chunks)

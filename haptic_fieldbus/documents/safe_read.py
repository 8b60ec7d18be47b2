"""Safe reading of an untrusted path: it may be a device, a FIFO, a far too large file, or change meanwhile.

Only a regular file of bounded size is read. The path is checked before it is opened, because opening a device or FIFO
has side effects. The opened file is checked again, because another file may have replaced it. Opening never waits
(O_NONBLOCK).
"""

import errno
import os
import re
import stat
from itertools import accumulate
from pathlib import Path

# Bounds on the shape of a TOML text, which hold before and after it is parsed.
#
# The time of `tomllib` grows with the square of the number of parts in a key, and it recurses for nested values. So
# parts and depth are counted on the text itself, with all strings and comments replaced first.

DEEPEST = 32
"""Largest depth of nested lists and tables, and largest number of parts of a dotted key."""
MOST_MEMBERS = 1000
"""Largest number of members of one list or table."""

# Possessive, and with an end that may be missing (where tomllib stops): nothing is tried twice, so the time is
# proportional to the length of the text.
_OPAQUE = re.compile(
    r'"""(?:[^"\\]++|\\.|"(?!""))*+"{0,5}'
    r"|'''(?:[^']++|'(?!''))*+'{0,5}"
    r'|"(?:[^"\\\n]++|\\.)*+"?'
    r"|'[^'\n]*+'?"
    r"|#[^\n]*+",
    re.DOTALL,
)
_PART = r"[A-Za-z0-9_-]++"
_LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-])(?:{_PART}[ \t]*+\.[ \t]*+){{{DEEPEST}}}")
_BRACKETS = re.compile(r"[][{}]")


def fault_of_text(text: str) -> str:
    """Return the fault of a text that is nested too deeply or has a key of too many parts; empty when it has none."""
    bare = _OPAQUE.sub(lambda match: "" if match[0].startswith("#") else "_", text)
    if _LONG_KEY.search(bare):
        return f"a key has too many parts; expected at most {DEEPEST}"
    depths = accumulate(1 if bracket[0] in "[{" else -1 for bracket in _BRACKETS.finditer(bare))
    return "nested too deeply" if any(depth > DEEPEST for depth in depths) else ""


def fault_of_data(data: object) -> str:
    """Return the fault of data with too many members in a list or table, or a too long integer; empty for none."""
    waiting = [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict | list):
            if len(value) > MOST_MEMBERS:
                return f"a {'table' if isinstance(value, dict) else 'list'} of {len(value)} members; {_EXPECTED}"
            waiting.extend(value.values() if isinstance(value, dict) else value)
        elif isinstance(value, int) and value.bit_length() > LONGEST_INTEGER:
            return TOO_MANY_DIGITS
    return ""


_EXPECTED = f"expected at most {MOST_MEMBERS}"
LONGEST_INTEGER = 128
"""Bits of an integer in a file; products of some of them are still in the range of a float."""
TOO_MANY_DIGITS = "a number has too many digits"


KIBI, MEBI = 1 << 10, 1 << 20

TOML_SIZE = 256 * KIBI
"""Largest size of a scene, rig, profile or file of faults [octets]; the shipped ones have less than a tenth."""
EDS_SIZE = 2 * MEBI
"""Largest size of an EDS or DCF [octets]; the largest known vendor's file has a tenth."""
TABLE_SIZE = 32 * MEBI
"""Largest size of a table of numbers, such as a recorded motion [octets]."""
PROVENANCE_SIZE = 64 * MEBI
"""Largest size of a JSON object or a picture that may hold a provenance, and of the provenance in it [octets]."""

READING = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in ("O_CLOEXEC", "O_NONBLOCK", "O_NOCTTY", "O_BINARY"))
"""Flags for opening a file; they differ between Windows and POSIX."""

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a FIFO"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


IMPOSSIBLE_NAME = "invalid file name"
"""Message for a name with a NUL or a character that cannot be encoded; Python's own text differs between versions."""


def read_octets(path: str | Path, most: int) -> bytes:
    """Return the content of a regular file of at most `most` octets.

    For any problem of the path or the file, raises FileNotFoundError, or OSError with the reason as `strerror`.
    """
    check_regular(path)
    descriptor = os.open(path, READING)
    try:
        found = os.fstat(descriptor)
        _check_regular(found)
        _check_size(found.st_size, most)
        octets = b""
        # The known size is not enough, because a file may grow, and files of /proc have size 0.
        while chunk := os.read(descriptor, most + 1 - len(octets)):
            octets += chunk
            _check_size(len(octets), most)
        return octets
    finally:
        os.close(descriptor)


def check_regular(path: str | Path) -> None:
    """Raise FileNotFoundError, or OSError with the reason as `strerror`, for a path that is no regular file."""
    try:
        _check_regular(os.stat(path))
    except ValueError as cause:
        raise OSError(errno.EINVAL, IMPOSSIBLE_NAME) from cause


def _check_regular(found: os.stat_result) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = next((words for is_kind, words in _KINDS if is_kind(found.st_mode)), "something else")
        raise OSError(errno.EINVAL, f"it is {kind}; expected a regular file")


def _check_size(size: int, most: int) -> None:
    if size > most:
        raise OSError(errno.EFBIG, f"it is too large; expected at most {most} octets")

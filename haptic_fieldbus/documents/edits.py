"""Change of one table in the text of a TOML file; every other octet stays unchanged.

The text is changed by lines and then checked: read again, it must contain the earlier data with the new table and
nothing else. So a line in a multi-line text that only looks like a header does no harm. A file that cannot be changed
by lines, such as one with the axis in an inline table, is refused. No style-preserving TOML library is needed, so its
errors cannot reach a rig.
"""

import errno
import os
import re
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from haptic_fieldbus.documents.safe_read import TOML_SIZE, fault_of_text, read_octets

# Replacement of a file as a whole: whoever reads it, at whatever time, finds the old content or the new one.
#
# The new content goes into a file beside the old one, reaches the disk, and takes its name in one step (POSIX rename).
# A process that is killed in between leaves the old file whole, and a file ending in `.new` beside it. A symbolic link
# stays one: its target is replaced.

ATTEMPTS = 5
"""Number of attempts to edit a file that another program writes at the same time."""


def edit_file(path: str | Path, edit: Callable[[str], str], most: int = TOML_SIZE) -> None:
    """Replace the content of a regular UTF-8 file by the result of `edit`; its mode stays.

    `edit` may be called several times if the file changes meanwhile. Raises OSError with the reason as `strerror`,
    UnicodeDecodeError (a ValueError), and errors of `edit`; the file is then unchanged.
    """
    target = Path(os.path.realpath(path))
    for _ in range(ATTEMPTS):
        before = os.stat(target)
        # Not by a text file, whose line endings would change.
        text = read_octets(target, most).decode("utf-8")
        mark = "\ufeff" if text.startswith("\ufeff") else ""  # of some editors; no reader of TOML takes it
        edited = (mark + edit(text.removeprefix(mark))).encode("utf-8")
        # A rename asks only for the rights to the folder, but who took the right to write meant the file.
        if not before.st_mode & stat.S_IWUSR or not os.access(target, os.W_OK):
            raise OSError(errno.EACCES, "it is read-only")
        with _aside(target, edited, before) as name:
            if _seen(before) == _seen(os.stat(target)):
                os.replace(name, target)
                sync_folder(target.parent)
                return
    raise OSError(errno.EAGAIN, "another program writes it at the same time")


def write_file(target: Path, content: bytes) -> None:
    """Create a file or replace it completely; raises OSError, and the file is then unchanged."""
    with _aside(target, content) as name:
        os.replace(name, target)
    sync_folder(target.parent)


def remove_file(target: Path) -> None:
    """Remove a file for good, if it is there; raises OSError."""
    target.unlink(missing_ok=True)
    if target.parent.is_dir():
        sync_folder(target.parent)


@contextmanager
def _aside(target: Path, content: bytes, rights: os.stat_result | None = None) -> Iterator[str]:
    """Write a file beside the target to the disk, and yield its name; at the end it is removed unless renamed."""
    descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".new", dir=target.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(content)
            file.flush()
            if rights is not None and hasattr(os, "fchown"):  # Windows has neither modes nor owners of this kind
                _keep_rights(descriptor, rights)
            os.fsync(descriptor)
        yield name
    finally:
        with suppress(FileNotFoundError):
            os.unlink(name)


def _keep_rights(descriptor: int, before: os.stat_result) -> None:
    """Give a new file the mode of the old one, and its owner if permitted."""
    os.fchmod(descriptor, stat.S_IMODE(before.st_mode))
    if before.st_uid != os.geteuid():  # root, for whom the file must not become its own
        with suppress(PermissionError):
            os.fchown(descriptor, before.st_uid, before.st_gid)


def _seen(found: os.stat_result) -> tuple[int, int, int, int]:
    """Return a value that changes when a program writes or replaces a file."""
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def sync_folder(folder: Path) -> None:
    """Write the new name to the disk, if a folder can be synchronised."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows opens no folder
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with suppress(OSError):  # some file systems cannot; the file itself is on the disk already
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


Value = str | int | float | list[float]
MOST_HEADERS = 8
"""Largest number of lines tried as the header of a table; all but one can only be lines of multi-line texts."""
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_LINE = re.compile(r"[^\n]*\n|[^\n]+")
_HEADER = re.compile(r"\s*\[")
_COMMENTED = re.compile(r"""\s*([A-Za-z0-9_-]+)\s*=(?:[^"'#\n]|"[^"\\\n]*"|'[^'\n]*')*?([ \t]*#[^\r\n]*)""")
_KEY = re.compile(r"\s*([A-Za-z0-9_-]+)\s*=")


def with_table(text: str, path: Sequence[str], values: Mapping[str, Value]) -> str:
    """Return the text with only these values in the table at `path`; raises ValueError if that is impossible.

    An existing table keeps its place, its comments and its inner tables; a new table is appended. A comment behind a
    value goes with a key that is left out.
    """
    if fault := fault_of_text(text):  # before it is parsed, which would take long
        raise ValueError(fault)
    before = tomllib.loads(text)
    # The parent must be there, else the new table would create what somebody has taken out.
    parent: object = before
    for key in path[:-1]:
        parent = parent.get(key) if isinstance(parent, dict) else None
    if not isinstance(parent, dict):
        raise ValueError(f"[{table_name(path[:-1])}] no longer exists")
    expected = _with(before, path, dict(values))
    for changed in _candidates(text, f"[{table_name(path)}]", values):
        with suppress(tomllib.TOMLDecodeError):
            if tomllib.loads(changed) == expected:
                return changed
    raise ValueError(f"[{table_name(path)}] cannot be added to a file of this form")


def table_values(table: object) -> dict[str, Value]:
    """Return the keys that a dataclass gives a table: those whose value is not None, with lists for tuples."""
    given = {key: value for key, value in vars(table).items() if value is not None}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in given.items()}


def write_table(file: str | Path, path: Sequence[str], values: Mapping[str, Value]) -> str:
    """Write a table into a file, as `with_table` does; return why that was impossible, or an empty text."""
    try:
        edit_file(file, partial(with_table, path=path, values=values))
    except (OSError, ValueError) as error:
        return str(getattr(error, "strerror", None) or error)
    return ""


def table_text(path: Sequence[str], values: Mapping[str, Value]) -> str:
    """Return a table as it would be written."""
    return "\n".join([f"[{table_name(path)}]", *(_line(key, value) for key, value in values.items())])


def _candidates(text: str, header: str, values: Mapping[str, Value]) -> Iterator[str]:
    """Yield the text with the table at each line that looks like its header, then with a table at the end."""
    ending = "\r\n" if "\r\n" in text else "\n"
    lines = _LINE.findall(text)
    written = [f"{_line(key, value)}{ending}" for key, value in values.items()]
    headed = re.compile(rf"\s*{re.escape(header)}\s*(#|$)")
    for at in [place for place, line in enumerate(lines) if headed.match(line)][:MOST_HEADERS]:
        end = next((place for place in range(at + 1, len(lines)) if _HEADER.match(lines[place])), len(lines))
        kept = [line for line in lines[at + 1 : end] if not _KEY.match(line)]
        comments = {found[1]: found[2] for line in lines[at + 1 : end] if (found := _COMMENTED.match(line))}
        told = [f"{_line(key, value)}{comments.get(key, '')}{ending}" for key, value in values.items()]
        first = lines[at] if lines[at].endswith("\n") else lines[at] + ending
        yield "".join([*lines[:at], first, *told, *kept, *lines[end:]])
    gap = "" if not text or text.endswith("\n") else ending
    yield f"{text}{gap}{ending}{header}{ending}{''.join(written)}"


def _with(data: dict[str, object], path: Sequence[str], table: dict[str, Value]) -> dict[str, object]:
    """Return the data with the table at `path`, whose parents exist."""
    key, *rest = path
    inner = data.get(key)
    within = inner if isinstance(inner, dict) else {}
    tables = {name: each for name, each in within.items() if isinstance(each, dict)}
    return {**data, key: _with(within, rest, table) if rest else {**tables, **table}}


def table_name(path: Sequence[str]) -> str:
    """Return the name of a table as its header has it."""
    return ".".join(key if _BARE.fullmatch(key) else quoted(key) for key in path)


def _line(key: str, value: Value) -> str:
    """Return a line of a table; whole numbers are identifiers, written in hexadecimal."""
    return f"{key} = {value_text(value, lambda _, each: f'0x{each:08X}' if isinstance(each, int) else repr(each))}"


def value_text(value: object, number: Callable[[str, int | float], str], key: str = "") -> str:
    """Return a value of TOML, a table as an inline one; `number` writes the number of a key."""
    if isinstance(value, Mapping):
        members = (f"{table_name((name,))} = {value_text(each, number, name)}" for name, each in value.items())
        return f"{{ {', '.join(members)} }}"
    if isinstance(value, tuple | list):
        return f"[{', '.join(value_text(each, number, key) for each in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return number(key, value) if isinstance(value, int | float) else quoted(str(value))


def file_text(tables: Mapping[str, object]) -> str:
    """Return the text of a TOML file: single values, then `[key.name]` of tables of tables, `[[key]]` of lists."""
    lines: list[str] = []
    for key, value in tables.items():
        if isinstance(value, Mapping):
            for name, table in value.items():
                lines += ["", f"[{key}.{table_name((name,))}]", *_key_lines(table)]
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for table in value:
                lines += ["", f"[[{key}]]", *_key_lines(table)]
        else:
            lines += _key_lines({key: value})
    return "\n".join([*lines, ""]).lstrip("\n")


def _key_lines(table: Mapping[str, object]) -> list[str]:
    texts = {key: value_text(value, lambda _, number: repr(number)) for key, value in table.items()}
    return [f"{table_name((key,))} = {text}" for key, text in texts.items()]


_ESCAPES = {code: f"\\u{code:04X}" for code in (*range(0x20), 0x7F)} | {ord(each): f"\\{each}" for each in '\\"'}


def quoted(text: str) -> str:
    """Return a TOML basic string."""
    return f'"{text.translate(_ESCAPES)}"'

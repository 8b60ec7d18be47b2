"""Change of one table in the text of a TOML file; every other octet stays as somebody has written it.

The text is changed by lines, and then proved: read again, it must hold the data from before with the new table and
nothing else. So a line that only looks like a header, in a text of several lines, does no harm, and a file that lines
cannot change, such as one with the axis in an inline table, is refused. No library is needed that keeps the style of a
whole file, and none of its errors can reach a rig.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress

from haptic_fieldbus.documents.bounds import fault_of_text

Value = str | int | float
MOST_HEADERS = 8
"""Most lines that are tried as the header of a table; all but one stand in texts of several lines."""
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_LINE = re.compile(r"[^\n]*\n|[^\n]+")
_HEADER = re.compile(r"\s*\[")
_KEY = re.compile(r"\s*([A-Za-z0-9_-]+)\s*=")


def with_table(text: str, path: Sequence[str], values: Mapping[str, Value]) -> str:
    """Return the text with these values alone in the table at `path`; raises ValueError when it cannot be done.

    A table that is there keeps its place, its comments and the tables in it; a new one comes last.
    """
    fault = fault_of_text(text)
    if fault:  # before it is parsed, which would take long
        raise ValueError(fault)
    before = tomllib.loads(text)
    # The parent must be there, else the new table would create what somebody has taken out.
    if not isinstance(_found(before, path[:-1]), dict):
        raise ValueError(f"there is no [{table_name(path[:-1])}] any more")
    expected = _with(before, path, dict(values))
    for changed in _candidates(text, f"[{table_name(path)}]", values):
        with suppress(tomllib.TOMLDecodeError):
            if tomllib.loads(changed) == expected:
                return changed
    raise ValueError(f"[{table_name(path)}] cannot be written by lines into a file of this form")


def table_text(path: Sequence[str], values: Mapping[str, Value]) -> str:
    """Return a table as it would be written."""
    return "\n".join([f"[{table_name(path)}]", *(_line(key, value) for key, value in values.items())])


def _candidates(text: str, header: str, values: Mapping[str, Value]) -> Iterator[str]:
    """Yield the text with the table in the place of each line that looks like its header, then with one at its end."""
    ending = "\r\n" if "\r\n" in text else "\n"
    lines = _LINE.findall(text)
    written = [f"{_line(key, value)}{ending}" for key, value in values.items()]
    for at in [place for place, line in enumerate(lines) if _is(line, header)][:MOST_HEADERS]:
        end = next((place for place in range(at + 1, len(lines)) if _HEADER.match(lines[place])), len(lines))
        kept = [line for line in lines[at + 1 : end] if not _KEY.match(line)]
        first = lines[at] if lines[at].endswith("\n") else lines[at] + ending
        yield "".join([*lines[:at], first, *written, *kept, *lines[end:]])
    gap = "" if not text or text.endswith("\n") else ending
    yield f"{text}{gap}{ending}{header}{ending}{''.join(written)}"


def _is(line: str, header: str) -> bool:
    rest = line.strip().removeprefix(header).lstrip()
    return line.strip().startswith(header) and (not rest or rest.startswith("#"))


def _found(data: object, path: Sequence[str]) -> object:
    for key in path:
        data = data.get(key) if isinstance(data, dict) else None
    return data


def _with(data: dict[str, object], path: Sequence[str], table: dict[str, Value]) -> dict[str, object]:
    """Return the data with the table at `path`, whose parents exist."""
    key, *rest = path
    inner = data.get(key)
    within = inner if isinstance(inner, dict) else {}
    if rest:
        return {**data, key: _with(within, rest, table)}
    return {**data, key: {**{name: each for name, each in within.items() if isinstance(each, dict)}, **table}}


def table_name(path: Sequence[str]) -> str:
    """Return the name of a table as its header has it."""
    return ".".join(key if _BARE.fullmatch(key) else quoted(key) for key in path)


def _line(key: str, value: Value) -> str:
    """Return a line of a table; whole numbers are names of something, and are written in hexadecimal."""
    written = quoted(value) if isinstance(value, str) else f"0x{value:08X}" if isinstance(value, int) else repr(value)
    return f"{key} = {written}"


def quoted(text: str) -> str:
    """Return a TOML basic string."""
    escaped = "".join(
        f"\\u{ord(each):04X}" if ord(each) < 0x20 or ord(each) == 0x7F else each
        for each in text.replace("\\", "\\\\").replace('"', '\\"')
    )
    return f'"{escaped}"'

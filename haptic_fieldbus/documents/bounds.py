"""Bounds on the shape of a TOML text, which hold before and after it is parsed.

The time of `tomllib` grows with the square of the number of parts in a key, and it recurses for nested values. So parts
and depth are counted on the text itself, with all strings and comments replaced first.
"""

import re
from collections.abc import Iterator

DEEPEST = 32
"""Most levels of nested lists and tables, and most parts of a dotted key."""
MOST_MEMBERS = 1000
"""Most members of one list or table."""

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
    return "nested too deeply" if any(depth > DEEPEST for depth in _depths(bare)) else ""


def _depths(bare: str) -> Iterator[int]:
    depth = 0
    for bracket in _BRACKETS.finditer(bare):
        depth += 1 if bracket[0] in "[{" else -1
        yield depth


def fault_of_data(data: object) -> str:
    """Return the fault of data with a list or a table of too many members; empty when it has none."""
    waiting = [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict | list):
            if len(value) > MOST_MEMBERS:
                return f"a {'table' if isinstance(value, dict) else 'list'} of {len(value)} members; {_EXPECTED}"
            waiting.extend(value.values() if isinstance(value, dict) else value)
    return ""


_EXPECTED = f"expected at most {MOST_MEMBERS}"

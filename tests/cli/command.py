"""The command line as a test calls it, and the lines that it prints."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from haptic_fieldbus.numerals import KEY_WIDTH, LINE_WIDTH, Line


@dataclass(frozen=True)
class FinalState:
    """How a command ended: exit status, standard output, standard error."""

    status: int
    out: str
    err: str


Command = Callable[..., FinalState]
NEVER_HIDDEN = {"warning", "cap", "note", "plot", "failed"}
"""Keys of a run whose lines do not count."""


def printed(out: str) -> list[Line]:
    """Return the lines of a key and a text that a command has printed."""
    return [(line[:KEY_WIDTH].strip(), line[KEY_WIDTH:]) for line in out.splitlines()]


def counted(lines: Iterable[Line]) -> list[Line]:
    """Return those of the lines of a run that count, each with its key, after a look at the width of all."""
    found, key = [], ""
    for label, text in lines:
        assert KEY_WIDTH + len(text) <= LINE_WIDTH, text
        key = label or key
        if key not in NEVER_HIDDEN:
            found.append((key, text))
    return found

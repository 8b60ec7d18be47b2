"""What goes to the terminal: aligned lines, tables, JSON, a progress bar.

Colours and the bar appear on a terminal only; long lines are wrapped to its width, and left whole in a pipe or a file.
"""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from time import monotonic
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from haptic_fieldbus.assessing.result import Json

KEY_WIDTH = 11
"""Columns of the keys, the space after them included."""
UNWRAPPED = 100_000
REDRAW = 0.05
"""[s] between two drawings of the bar."""
KEY_STYLES = {"refused": "bold red", "tripped": "bold red", "failed": "bold red", "verdict": "bold green"}


def console(stream: TextIO) -> "Console":
    from rich.console import Console

    return Console(
        file=stream, highlight=False, markup=False, emoji=False, width=None if stream.isatty() else UNWRAPPED
    )


def show(lines: Iterable[tuple[str | None, str]], stream: TextIO | None = None) -> None:
    """Lines of a key and a text beside it; an empty key goes on with the line before, None has no key column."""
    from rich.text import Text

    screen = console(stream or sys.stdout)
    for key, text in lines:
        indent = 0 if key is None else KEY_WIDTH
        for part in Text(text).wrap(screen, max(20, screen.width - indent)):
            part.rstrip()
            head = f"{key or '':{indent}}" if indent else ""
            screen.print(Text.assemble((head, KEY_STYLES.get(key or "", "bold")), part), soft_wrap=True)
            key = key and ""


def show_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Columns as wide as their longest entry, under their headings."""
    table = [tuple(headings), *(tuple(row) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in table]
    show([(None, line) for line in lines])


def print_json(value: "Mapping[str, Json]") -> None:
    """One object on standard output; numbers that JSON does not know are an error, not NaN."""
    print(json.dumps(value, ensure_ascii=False, indent=2, allow_nan=False))


class Bar:
    """A progress bar on standard error, drawn by whoever reports progress: no thread beside the loop."""

    def __init__(self, rate: float) -> None:
        self.silent = False
        self._rate = rate
        self._progress: Progress | None = None
        self._drawn = 0.0

    def __call__(self, done: int, total: int) -> None:
        """Periods done and asked for."""
        now = monotonic()
        if self.silent or (done < total and now - self._drawn < REDRAW):
            return
        self._drawn = now
        progress = self._progress or self._begin(total)
        progress.update(progress.task_ids[0], completed=done / self._rate, refresh=True)

    def _begin(self, total: int) -> "Progress":
        from rich.progress import BarColumn, Progress, TextColumn

        self._progress = Progress(
            BarColumn(bar_width=40),
            TextColumn("{task.completed:.1f} of {task.total:.1f} s"),
            console=console(sys.stderr),
            auto_refresh=False,
            transient=True,
        )
        self._progress.add_task("", total=total / self._rate)
        self._progress.start()
        return self._progress

    def close(self) -> None:
        if self._progress is not None:
            self._progress.stop()


def bar(rate: float) -> Bar | None:
    """None where nobody would see it."""
    return Bar(rate) if sys.stderr.isatty() else None


def plain(value: object) -> "Json":
    """A value of dataclasses as JSON has it: names instead of enums, lists instead of tuples."""
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Mapping):
        return {str(key): plain(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [plain(member) for member in value]
    return value if isinstance(value, bool | int | float | str) or value is None else str(value)

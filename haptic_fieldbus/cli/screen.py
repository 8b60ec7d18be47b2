"""Output to the terminal: aligned lines, tables, JSON, a progress bar.

Colours and the bar appear on a terminal only. Long lines are wrapped to its width; in a pipe or a file they stay whole.
"""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, TextIO

import typer

from haptic_fieldbus.cli.output import behind
from haptic_fieldbus.errors import DocumentError, Fault, UsageError
from haptic_fieldbus.numerals import KEY_WIDTH

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from haptic_fieldbus.assessing.result import Json


UNWRAPPED = 100_000
"""Width of a pipe or file [characters]; larger than any line, so that Rich wraps none."""
COLOURED = {"FORCE_COLOR", "TTY_COMPATIBLE"}
"""Variables of the environment that may tell Rich to colour a pipe."""
CONTROLS = dict.fromkeys((7, 8, 11, 12, 13))
"""Control characters that Rich leaves out: bell, backspace, vertical tab, form feed, carriage return."""
REDRAW = 0.05
"""Least time between two drawings of the bar [s]."""
KEY_STYLES = {"refused": "bold red", "tripped": "bold red", "failed": "bold red", "verdict": "bold green"}


def console(stream: TextIO) -> "Console":
    """Return a Rich console for a stream; texts are printed as they are, without markup."""
    from rich.console import Console

    return Console(
        file=stream, highlight=False, markup=False, emoji=False, width=None if stream.isatty() else UNWRAPPED
    )


def show(lines: Iterable[tuple[str | None, str]], stream: TextIO | None = None) -> None:
    """Print lines of a key and a text, to standard output or a given stream.

    An empty key continues the line before; a key of None leaves out the column of keys.
    """
    stream = stream or sys.stdout
    if not (stream.isatty() or COLOURED & os.environ.keys()):
        _print_plain(lines, stream)
        return
    from rich.text import Text

    screen = console(stream)
    # Rich would wrap below the key; here each wrapped part stands beside it, at least 20 columns wide.
    for key, text in lines:
        indent = 0 if key is None else KEY_WIDTH
        for part in Text(text).wrap(screen, max(20, screen.width - indent)):
            part.rstrip()
            head = f"{key or '':{indent}}" if indent else ""
            screen.print(Text.assemble((head, KEY_STYLES.get(key or "", "bold")), part), soft_wrap=True)
            key = key and ""  # the key stands beside the first part only; None stays None


def _print_plain(lines: Iterable[tuple[str | None, str]], stream: TextIO) -> None:
    """Print the lines of `show` as Rich prints them in a pipe, without the import of Rich, which takes longer."""
    for key, text in lines:
        head = "" if key is None else f"{key:{KEY_WIDTH}}"
        for part in text.translate(CONTROLS).split("\n"):
            print(head + part.expandtabs().rstrip(), file=stream)
            head = " " * KEY_WIDTH if head else ""
    stream.flush()  # as Rich does: the lines are read at once, such as the address of a page


def show_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table under its headings; a column is as wide as its longest entry."""
    table = [tuple(headings), *(tuple(row) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in table]
    show([(None, line) for line in lines])


def print_json(value: Mapping[str, object]) -> None:
    """Print one JSON object to standard output; raises ValueError for NaN and infinities, which JSON does not have."""
    print(json_text({key: plain(member) for key, member in value.items()}, indent=2))


def show_result(
    lines: Iterable[tuple[str | None, str]],
    told: Callable[[], Mapping[str, object]],
    *,
    as_json: bool,
    plot: Path | None = None,
) -> None:
    """Print a result: its lines and the path of its picture, or the one JSON object that `told` returns."""
    if as_json:
        print_json(told())
    else:
        show([*lines, *([] if plot is None else [("plot", str(plot))])])
    sys.stdout.flush()


def json_text(value: "Mapping[str, Json]", indent: int | None = None) -> str:
    """Return a JSON object as text, with escapes if the encoding of standard output lacks characters."""
    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    return json.dumps(value, ensure_ascii=not unicode, indent=indent, allow_nan=False)


class ProgressBar:
    """Progress bar on standard error, drawn in the thread that reports progress: no thread disturbs the loop."""

    def __init__(self, duration: float) -> None:
        """Begin at 0 of `duration` [s]."""
        self.silent = False
        """Set it to True to draw nothing."""
        self._duration = duration
        self._progress: Progress | None = None
        self._drawn = 0.0

    def __call__(self, done: int, total: int) -> None:
        """Draw the bar after `done` of `total` periods, unless it was drawn less than `REDRAW` ago."""
        now = monotonic()
        # What a stopped terminal does not take would only gather.
        if self.silent or behind(sys.stderr) or (done < total and now - self._drawn < REDRAW):
            return
        self._drawn = now
        progress = self._progress or self._begin()
        progress.update(progress.task_ids[0], completed=self._duration * done / total, refresh=True)

    def _begin(self) -> "Progress":
        from rich.progress import BarColumn, Progress, TextColumn

        self._progress = Progress(
            BarColumn(bar_width=40),
            TextColumn("{task.completed:.1f} of {task.total:.1f} s"),
            console=console(sys.stderr),
            auto_refresh=False,
            transient=True,
        )
        self._progress.add_task("", total=self._duration)
        self._progress.start()
        return self._progress

    def close(self) -> None:
        """Remove the bar from the terminal."""
        if self._progress is not None:
            self._progress.stop()


@contextmanager
def moving_bar(*columns: str) -> Iterator[Callable[..., None]]:
    """Yield a function that updates a bar with these columns and the time left; it does nothing outside a terminal."""
    if not sys.stderr.isatty():
        yield lambda **changed: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    shown = (BarColumn(bar_width=30), *map(TextColumn, columns), TimeRemainingColumn())
    with Progress(*shown, console=console(sys.stderr), transient=True) as bar:
        yield partial(bar.update, bar.add_task("", total=None))


def plain(value: object) -> "Json":
    """Return a value for JSON: enums by value, tuples as lists, mappings and dataclasses as objects, else as text."""
    if isinstance(value, Enum):
        return plain(value.value)
    if is_dataclass(value) and not isinstance(value, type):
        return {each.name: plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [plain(member) for member in value]
    return value if isinstance(value, bool | int | float | str) or value is None else str(value)


# Common part of `profiles check` and `scenes check`.

FAULTY = 2
"""Exit status when any file has a fault."""
Told = tuple[str | None, Fault]
"""The path of a file, or the given name, or None without both; and a fault."""


def check_files(names: Sequence[str], load: Callable[[str], object], as_json: bool) -> None:
    """Load each file and print the faults of all of them, as lines or as one JSON object.

    Raises `typer.Exit` with status 2 when any file has a fault.
    """
    found: dict[str, list[Told]] = {}
    for name in names:
        try:
            load(name)
            found[name] = []
        except (DocumentError, UsageError) as error:
            found[name] = [*faults_told(name, error)]
    if as_json:
        print_json({"errors": faults_to_json(told for faults in found.values() for told in faults)})
    else:
        for name, faults in found.items():
            show((None, f"{source}: {fault}") for source, fault in faults)
            if not faults:
                show([(None, f"{name}: no fault")])
    if any(found.values()):
        raise typer.Exit(FAULTY)


def faults_told(name: str, error: DocumentError | UsageError) -> Iterator[Told]:
    """Yield each fault of a file with its path, or the fault of a name with that name."""
    if isinstance(error, DocumentError):
        yield from ((error.source, fault) for fault in error.faults)
    else:
        yield name, Fault("", str(error))


def faults_to_json(told: Iterable[Told]) -> list[dict[str, str | int | None]]:
    """Return the faults as `--json` lists them."""
    return [
        {"source": source, "key": fault.key or None, "line": fault.line, "message": fault.message}
        for source, fault in told
    ]

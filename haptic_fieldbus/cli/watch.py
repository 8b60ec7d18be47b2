"""Command `watch`: a live look at drives, without torque."""

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, TextIO

from haptic_fieldbus.cli.doctor import DriveOptions
from haptic_fieldbus.cli.options import RENDERING, note_assumed_bitrate, option, options_of, seconds
from haptic_fieldbus.cli.screen import KEY_WIDTH, console, json_text, show
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import in_unit, rounded

if TYPE_CHECKING:
    from haptic_fieldbus.api.bench import BenchRequest
    from haptic_fieldbus.running.watching import View

LOOK_EVERY = 0.1
"""Time between two looks [s]; on a terminal each is shown."""
LOOKS_PER_LINE = 10
"""Looks for each line in a pipe or a file: a line a second."""
Shown = Callable[[Mapping[str, "View"]], None]


@dataclass(frozen=True, kw_only=True)
class WatchOptions(DriveOptions):
    """Options of `watch`."""

    duration: Annotated[
        float | None, option("S", "Time to watch; until Ctrl-C unless given.", RENDERING, parser=seconds)
    ] = None


@options_of(WatchOptions)
def watch(options: WatchOptions) -> None:
    """Show position, velocity, torque and state of drives while nothing is enabled; Ctrl-C ends it."""
    duration = math.inf if options.duration is None else options.duration
    if not duration > 0.0:
        raise UsageError(f"--duration {options.duration}: expected seconds, more than 0")
    show(note_assumed_bitrate(options.bus), sys.stderr)
    look(options.bench(), duration, sys.stdout, as_json=options.as_json)


def look(bench: "BenchRequest", duration: float, stream: TextIO, *, as_json: bool = False) -> None:
    """Show the axes of a bench for `duration` [s]; raises BusError or DocumentError."""
    from haptic_fieldbus.api.bench import watched
    from haptic_fieldbus.clock import MonotonicClock
    from haptic_fieldbus.running.watching import watch_axes

    live = stream.isatty() and not as_json
    lines = _print_json_line if as_json else partial(_print_lines, stream=stream)
    with watched(bench) as (axes, onlookers), _live(stream) if live else nullcontext(lines) as tell:
        told: set[str] = set()
        show([("bus", onlooker.listened) for onlooker in onlookers], sys.stderr)
        for number, views in enumerate(watch_axes(axes, onlookers, MonotonicClock(), LOOK_EVERY, duration)):
            news = {onlooker.masters for onlooker in onlookers} - told - {""}
            show([("listening", sentence) for sentence in news], sys.stderr)
            told |= news
            if live or number % LOOKS_PER_LINE == 0:
                tell(views)


@contextmanager
def _live(stream: TextIO) -> Iterator[Shown]:
    """Yield a function that shows the axes in place, on a terminal."""
    from rich.live import Live
    from rich.text import Text

    with Live(console=console(stream), auto_refresh=False) as screen:
        yield lambda views: screen.update(Text("\n".join(_named_lines(views))), refresh=True)


def _named_lines(views: Mapping[str, "View"]) -> Iterator[str]:
    for name, view in views.items():
        yield from (f"{name:{KEY_WIDTH}}{line}" for line in lines_of(view))


def _print_json_line(views: Mapping[str, "View"]) -> None:
    print(json_text({"axes": {name: view.to_json() for name, view in views.items()}}), flush=True)


def _print_lines(views: Mapping[str, "View"], stream: TextIO) -> None:
    for name, view in views.items():
        show((("" if number else name, line) for number, line in enumerate(lines_of(view))), stream)
    stream.flush()


def lines_of(view: "View") -> Iterator[str]:
    """Yield the lines of one axis: its values, and a note where there is something to be told."""
    parts = [f"node {view.node}", view.state or "state unknown"]
    if view.statusword is not None:
        parts[1] += f" ({view.statusword:04X}h)"
    if view.error_code is not None:
        parts.append(f"error code {view.error_code:04X}h")
    parts += [*_motion(view), *_ages(view)]
    yield " · ".join(parts)
    if view.note is not None:
        yield view.note


def _motion(view: "View") -> Iterator[str]:
    if view.position_counts is not None:
        counts = f"{view.position_counts} counts"
        yield counts if view.position is None else f"{in_unit(view.position, view.unit or '')} ({counts})"
    if view.velocity is not None:
        yield in_unit(view.velocity, f"{view.unit}/s")
    if view.torque_actual is not None:
        yield in_unit(view.torque_actual, "N·m")
    elif view.torque_actual_raw is not None:
        yield f"torque {view.torque_actual_raw} (steps of the drive)"


def _ages(view: "View") -> Iterator[str]:
    if view.age_s is not None:
        yield f"{rounded(1e3 * view.age_s)} ms old"
    if view.nmt_state is not None and view.life_age_s is not None:
        yield f"{view.nmt_state}, heartbeat {rounded(1e3 * view.life_age_s)} ms ago"

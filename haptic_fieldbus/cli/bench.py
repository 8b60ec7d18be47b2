"""Commands that look at a bench without torque: `doctor`, `scan`, `watch`."""

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import typer

from haptic_fieldbus.cli.options import (
    BENCH,
    BUSES,
    DRIVE,
    RENDERING,
    JsonOption,
    ProfilesOption,
    given_by,
    note_bitrate,
    option_field,
    options_of,
    refuse_beside_rig,
)
from haptic_fieldbus.cli.screen import console, json_text, print_json, show, show_result, show_table
from haptic_fieldbus.defaults import DEFAULT_BUS, DEFAULT_NODE, DEFAULT_RATE, HIGHEST_NUMBER
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import KEY_WIDTH, in_unit, lines_of, object_of, rounded

if TYPE_CHECKING:
    from haptic_fieldbus.api.bench import BenchRequest
    from haptic_fieldbus.running.watch import View


# Command `scan`: the nodes of a bus, by reading alone.

KEYS = ("node", "vendor_id", "product_code", "revision", "serial", "name", "profile", "sure")
"""First keys of a node in `--json`, in their order."""


@dataclass(frozen=True, kw_only=True)
class BusOptions:
    """Options of a command that needs a bus alone."""

    bus: str | None = option_field("BUS", BUSES, BENCH, told=DEFAULT_BUS)
    rig: Path | None = option_field("FILE", "Rig file whose buses are examined.", BENCH)
    profiles: ProfilesOption = None
    as_json: JsonOption = False

    def bench(self) -> "BenchRequest":
        """Return the bench that the options name."""
        from haptic_fieldbus.api.bench import BenchRequest

        return given_by(self, BenchRequest)


@dataclass(frozen=True, kw_only=True)
class ScanOptions(BusOptions):
    """Options of `scan`."""

    asked: str | None = option_field(
        "IDS", "Nodes to read, as in 1-8 or 1,3.", BENCH, "--node", told="all on CAN, 1 on Modbus"
    )

    def nodes(self) -> list[int]:
        """Return the numbers to scan; raises UsageError for a text that is no number or range."""
        if self.asked is None:
            return []
        ranges = [part.partition("-") for part in self.asked.split(",")]
        try:
            ends = [(int(first), int(last or first)) for first, _, last in ranges]
        except ValueError:
            ends = []
        if not ends or not all(0 <= first <= last <= HIGHEST_NUMBER for first, last in ends):
            raise UsageError(f"--node {self.asked}: expected numbers up to {HIGHEST_NUMBER}, as in 1-8 or 1,3")
        return [node for first, last in ends for node in range(first, last + 1)]


@options_of(ScanOptions)
def scan(options: ScanOptions) -> None:
    """List the nodes of a bus with their profiles, by reading alone. For live values use `watch`."""
    from haptic_fieldbus.api.bench import scans

    note_bitrate(options.bus)
    found = list(scans(options.bench(), options.nodes()))
    if options.as_json:
        nodes = [{**object_of(node.rows(), KEYS), "bus": each.bus} for each in found for node in each.nodes]
        print_json({"nodes": nodes, "buses": [object_of(each.rows()) for each in found]})
        return
    for each in found:
        show(lines_of(each.rows()))
        if each.nodes:
            *columns, sure = zip(*(node.rows() for node in each.nodes), strict=True)
            cells = zip(*([" ".join(row.note) for row in column] for column in columns), strict=True)
            show_table([column[0].label for column in columns], cells)
            show(lines_of(sure))


# Command `doctor`: is this computer, its adapter and its bus fit for a loop?

FAILED = ("adapter", "round_trip")
"""Checks whose failure is a failure of the bus; all others are advice."""


@dataclass(frozen=True, kw_only=True)
class DriveOptions(BusOptions):
    """Options of a command that looks at drives without a scene."""

    drive: str | None = option_field("PROFILE", "Drive profile by name or path.", BENCH, told=DRIVE)
    node: int | None = option_field("ID", "Node-ID of the drive.", BENCH, told=DEFAULT_NODE)

    def bench(self) -> "BenchRequest":
        """Return the bench that the options name; raises UsageError when `--rig` meets `--drive` or `--node`."""
        refuse_beside_rig(self.rig, self.drive, self.node)
        return super().bench()


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(DriveOptions):
    """Options of `doctor`."""

    rate: float = option_field("HZ", "Planned loop rate.", RENDERING, default=DEFAULT_RATE)


@options_of(DoctorOptions)
def doctor(options: DoctorOptions) -> None:
    """Check adapter, bus and computer, with a remedy for each fault. To find the drives use `scan`."""
    from haptic_fieldbus.api.bench import examined

    note_bitrate(options.bus)
    checks = examined(options.bench())
    rows = [check.row for check in checks]
    show_result(lines_of(rows), lambda: {"checks": [row.value for row in rows]}, as_json=options.as_json)
    if any(check.ok is False and check.name in FAILED for check in checks):
        raise typer.Exit(1)


# Command `watch`: a live look at drives, without torque.

LOOK_EVERY = 0.1
"""Time between two readings [s]; a terminal shows each one."""
LOOKS_PER_LINE = 10
"""Readings per line in a pipe or a file: one line a second."""
Shown = Callable[[Mapping[str, "View"]], None]


@dataclass(frozen=True, kw_only=True)
class WatchOptions(DriveOptions):
    """Options of `watch`."""

    rig: Path | None = option_field("FILE", "Rig file whose drives are shown.", BENCH)
    duration: float | None = option_field("S", "Duration of watching; default: until Ctrl-C.", RENDERING)
    as_json: bool = option_field(None, "Print one JSON object per second, each on its own line.", None, "--json")


@options_of(WatchOptions)
def watch(options: WatchOptions) -> None:
    """Show position, speed and state of drives without torque, until Ctrl-C. To render use `run`."""
    duration = math.inf if options.duration is None else options.duration
    if not duration > 0.0:
        raise UsageError(f"--duration {options.duration}: expected a number of seconds above 0")
    note_bitrate(options.bus)
    look(options.bench(), duration, sys.stdout, as_json=options.as_json)


def look(bench: "BenchRequest", duration: float, stream: TextIO, *, as_json: bool = False) -> None:
    """Show the axes of a bench for `duration` [s]; raises BusError or DocumentError."""
    from haptic_fieldbus.api.bench import watched
    from haptic_fieldbus.clock import MonotonicClock
    from haptic_fieldbus.running.watch import watch_axes

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

    def named(views: Mapping[str, "View"]) -> Text:
        return Text("\n".join(f"{name:{KEY_WIDTH}}{line}" for name, view in views.items() for line in view_lines(view)))

    with Live(console=console(stream), auto_refresh=False) as screen:
        yield lambda views: screen.update(named(views), refresh=True)


def _print_json_line(views: Mapping[str, "View"]) -> None:
    print(json_text({"axes": {name: view.to_json() for name, view in views.items()}}), flush=True)


def _print_lines(views: Mapping[str, "View"], stream: TextIO) -> None:
    for name, view in views.items():
        show((("" if number else name, line) for number, line in enumerate(view_lines(view))), stream)
    stream.flush()


def view_lines(view: "View") -> Iterator[str]:
    """Yield the lines of one axis: its values, and a note if there is one."""
    yield " · ".join(_values(view))
    if view.note is not None:
        yield view.note


def _values(view: "View") -> Iterator[str]:
    yield f"node {view.node}"
    yield (view.state or "state unknown") + ("" if view.statusword is None else f" ({view.statusword:04X}h)")
    if view.error_code is not None:
        yield f"error code {view.error_code:04X}h"
    if view.position_counts is not None:
        counts = f"{view.position_counts} counts"
        yield counts if view.position is None else f"{in_unit(view.position, view.unit or '')} ({counts})"
    if view.velocity is not None:
        yield in_unit(view.velocity, f"{view.unit}/s")
    if view.torque_actual is not None:
        yield in_unit(view.torque_actual, "N·m")
    elif view.torque_actual_raw is not None:
        yield f"torque {view.torque_actual_raw} (steps of the drive)"
    if view.age_s is not None:
        yield f"{rounded(1e3 * view.age_s)} ms old"
    if view.nmt_state is not None and view.life_age_s is not None:
        yield f"{view.nmt_state}, heartbeat {rounded(1e3 * view.life_age_s)} ms ago"

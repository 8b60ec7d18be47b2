"""One run at a site: configured, asked for, rendered, recorded, and torque-free at its end whatever happens."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.assessing.record import ROW_SUFFIXES, Record, write_rows
from haptic_fieldbus.assessing.recording import Truth
from haptic_fieldbus.assessing.result import Result, known_before
from haptic_fieldbus.assessing.summary import Run, summarise
from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.buses.group import BusGroup
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.cycle.cycle import Cycle, columns
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.numerals import exactly, percent
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.selection import Selection
from haptic_fieldbus.running.loop import run_loop

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.running.changes import Changes

ENABLING_PERIODS = 4000
"""Rows kept for the time before operation enabled."""
LONGEST_RECORD = 2_000_000
"""Rows; of a longer run the last ones are kept."""


@dataclass(frozen=True)
class Request:
    """A compiled selection, and what happens while it runs; duration in s from operation enabled."""

    selection: Selection
    duration: float
    record: Path | None = None
    confirm: Callable[[str], bool] | None = None
    progress: Callable[[int, int], None] | None = None
    changes: "Changes | None" = None


@dataclass(frozen=True)
class Site:
    """Where a run takes place: a clock, and by name its buses and, when these are simulated, the worlds behind."""

    clock: Clock
    buses: Mapping[str, Bus]
    worlds: Mapping[str, Truth]


def render(request: Request, place: AbstractContextManager[Site]) -> Result:
    """Run and summarise; errors carry what is known by then as `result`."""
    plan = request.selection.plan
    cycles = max(1, round(request.duration * plan.rate))
    cycle, report = Cycle(plan), LoopReport()
    record = Record(columns(plan), min(cycles, LONGEST_RECORD) + ENABLING_PERIODS)
    started = perf_counter()
    try:
        with place as site:
            bus = _one_of(site.buses)
            try:
                bus.open(plan)
                _ask(request, plan, bus)
                run_loop(
                    plan,
                    cycle,
                    bus,
                    site.clock,
                    cycles=cycles,
                    record=record,
                    progress=_counted(request.progress, cycles),
                    report=report,
                    changes=request.changes,
                )
            finally:
                bus.close()
    except HapticFieldbusError as error:
        error.result = known_before(request.selection, report, cycle.trip, str(error))
        raise
    finally:
        _write_rows(record, request.record)
    elapsed = perf_counter() - started
    result = summarise(Run(request.selection, cycle, record, report, site.worlds, site.clock.name, elapsed))
    return replace(result, warnings=tuple(bus.warnings))


def _one_of(buses: Mapping[str, Bus]) -> Bus:
    """One bus as it is, several as a group."""
    return next(iter(buses.values())) if len(buses) == 1 else BusGroup(buses)


def _write_rows(record: Record, path: Path | None) -> None:
    if path is not None and path.suffix in ROW_SUFFIXES:
        write_rows(record, path)


def _ask(request: Request, plan: Plan, bus: Bus) -> None:
    """On a bus that is not simulated nothing moves until somebody says so."""
    if request.selection.bus.simulated:
        return
    question = "\n".join(_warning(plan, name, bus) for name in bus.facts)
    if request.confirm is None or not request.confirm(question):
        raise UsageError("not enabled: on a real bus nothing moves until it is confirmed (--yes for scripts)")


def _warning(plan: Plan, name: str, bus: Bus) -> str:
    axis = next(axis for axis in plan.axes if axis.name == name)
    facts = bus.facts[name]
    share = axis.limits.effort / axis.rated_effort
    serial = "" if facts.serial is None else f" (serial {facts.serial:#06x})"
    return (
        f"about to enable torque on {facts.title}, node {facts.node}, {plan.rig.bus[axis.rig.bus].channel}{serial}: "
        f"at most {percent(share)} of rated torque, {exactly(axis.limits.speed)} {axis.workspace.length_unit}/s; "
        f"{facts.link_loss}, confirmed in the drive."
    )


def _counted(progress: Callable[[int, int], None] | None, cycles: int) -> Callable[[int], None] | None:
    return None if progress is None else lambda done: progress(done, cycles)

"""One run at a site: configure, ask for confirmation, render, record, and end torque-free whatever happens."""

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
"""Rows reserved for the periods before operation enabled."""
LONGEST_RECORD = 2_000_000
"""Largest number of rows for the periods after it; of a longer run the last rows are kept."""


@dataclass(frozen=True)
class Request:
    """A compiled selection and the conditions of its run."""

    selection: Selection
    duration: float
    """Time in operation enabled [s]."""
    record: Path | None = None
    """File for the rows of the run; a file for frames (.log, .blf) is written by the buses instead."""
    confirm: Callable[[str], bool] | None = None
    """Function that gets a question and returns whether torque may be enabled on a real bus; None: it may not."""
    progress: Callable[[int, int], None] | None = None
    """Function that gets the periods done and the periods of the whole run."""
    changes: "Changes | None" = None


@dataclass(frozen=True)
class Site:
    """The place of a run: a clock, the buses by name and, behind simulated buses, their worlds by the same names."""

    clock: Clock
    buses: Mapping[str, Bus]
    worlds: Mapping[str, Truth]


def render(request: Request, place: AbstractContextManager[Site]) -> Result:
    """Run the selection at `place` and return the result.

    Raises UsageError when a real bus is not confirmed, and BusError, DriveFaultError or SafetyTripError of the run.
    Each error carries the facts known by then as `result`; rows are written to the record file in any case.
    """
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
        # A run that fails has a result too: the command line prints it beside the error.
        error.result = known_before(request.selection, report, cycle.trip, str(error))
        raise
    finally:
        _write_rows(record, request.record)
    elapsed = perf_counter() - started
    result = summarise(Run(request.selection, cycle, record, report, site.worlds, site.clock.name, elapsed))
    return replace(result, warnings=tuple(bus.warnings))


def _one_of(buses: Mapping[str, Bus]) -> Bus:
    """Return a single bus as it is, several buses as a group."""
    return next(iter(buses.values())) if len(buses) == 1 else BusGroup(buses)


def _write_rows(record: Record, path: Path | None) -> None:
    """Write the rows if the file is one for rows, not for frames."""
    if path is not None and path.suffix in ROW_SUFFIXES:
        write_rows(record, path)


def _ask(request: Request, plan: Plan, bus: Bus) -> None:
    """Ask for confirmation before torque is enabled on a real bus; raises UsageError without it."""
    if request.selection.bus.simulated:
        return
    question = "\n".join(_warning(plan, name, bus) for name in bus.facts)
    if request.confirm is None or not request.confirm(question):
        raise UsageError("not enabled: on a real bus nothing moves until it is confirmed (--yes for scripts)")


def _warning(plan: Plan, name: str, bus: Bus) -> str:
    """Return the sentence about one axis that is to be confirmed: drive, bus, limits, reaction to a link loss."""
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
    """Return `progress` with the number of all periods filled in; None when there is none."""
    return None if progress is None else lambda done: progress(done, cycles)

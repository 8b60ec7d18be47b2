"""Runs the loop to its end, without the session around it."""

from collections.abc import Callable

from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.loop import finished, loop_steps


def run_loop(
    plan: Plan,
    cycle: Cycle,
    bus: Bus,
    clock: Clock,
    *,
    cycles: int,
    record: Record | None = None,
    progress: Callable[[int], None] | None = None,
    report: LoopReport | None = None,
) -> LoopReport:
    """Run an opened bus as `loop_steps` without pauses, and return the report of the run."""
    return finished(loop_steps(plan, cycle, bus, clock, cycles=cycles, record=record, progress=progress, report=report))

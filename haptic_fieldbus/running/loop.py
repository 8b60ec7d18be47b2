"""The loop: wait, read, compute, write, record, once a period, until enough periods or a reason to stop.

Deadlines are absolute, t0 + k·T. A period that was slept through is skipped, never made up for in a burst. However the
loop ends, `bus.stop` has put torque-free set-points on the wire before an exception leaves it.
"""

import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING

from haptic_fieldbus.assessing.loop_report import SAMPLES, LoopReport
from haptic_fieldbus.assessing.record import Record
from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.trips import explained, moment, trip_error
from haptic_fieldbus.errors import BusError, BusTimeoutError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.realtime import no_garbage_collection, threads_give_way

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.running.changes import Changes

ENABLING_TIME = 2.0
"""[s]; on top of the drives' mode change time."""
LONGEST_SAMPLE = 1_000_000
"""Periods; of a longer run the last ones are kept."""
PROGRESS_EVERY = 0.1
"""[s]."""
UNCONFIRMED = "The drives did not confirm that their motors are off: switch the power off."


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
    changes: "Changes | None" = None,
) -> LoopReport:
    """Run an opened bus for `cycles` periods of operation enabled; Ctrl-C ends it early and is no error.

    Raises DriveFaultError, BusError or SafetyTripError; torque is off by then. `progress` gets the periods done.
    """
    report = LoopReport() if report is None else report
    report.samples = Record(SAMPLES, min(cycles, LONGEST_SAMPLE))
    report.period_ns = plan.period_ns
    if changes is not None:
        report.changes = changes.applied
        changes.open(cycle)
    failure: Exception | None = None
    try:
        with no_garbage_collection(), threads_give_way() if changes is not None else nullcontext():
            _run(plan, cycle, bus, clock, cycles, record, progress or _silent, report, changes)
    except KeyboardInterrupt:
        report.interrupted = True
    except BusError as error:
        failure = type(error)(f"{error}, {moment(clock.now_ns(), report.enabled_at_ns)}")
        failure.__cause__ = error
    except Exception as error:
        failure = error
    finally:
        report.released = bus.stop()
        if changes is not None:
            changes.close()
    if cycle.trip is not None:
        cycle.trip = explained(cycle.trip, bus.restarted)
        tripped = trip_error(cycle.trip, plan, report.enabled_at_ns)
        tripped.__cause__ = failure
        failure = tripped
    if failure is not None:
        if not report.released:
            failure.add_note(UNCONFIRMED)
        raise failure
    return report


def _run(
    plan: Plan,
    cycle: Cycle,
    bus: Bus,
    clock: Clock,
    cycles: int,
    record: Record | None,
    progress: Callable[[int], None],
    report: LoopReport,
    changes: "Changes | None",
) -> None:
    period_ns, compute_ns = plan.period_ns, plan.compute_ns
    feedback_ns = _feedback_time_ns(plan)
    enabling_periods = round(_enabling_time(plan) * plan.rate)
    progress_every = max(1, round(PROGRESS_EVERY * plan.rate))
    step = cycle.step
    deadline_ns = clock.now_ns()
    before_ns = deadline_ns - period_ns
    while report.cycles < cycles:
        late_ns = clock.sleep_until(deadline_ns)
        if late_ns >= period_ns:
            report.missed += late_ns // period_ns
            deadline_ns += late_ns // period_ns * period_ns
        image = bus.read(deadline_ns + late_ns % period_ns + feedback_ns)
        started_ns = time.perf_counter_ns()
        output = step(image)
        computed_ns = time.perf_counter_ns() - started_ns
        clock.compute(compute_ns)
        bus.write(output)
        if record is not None:
            record.push(cycle.row)
        latch_ns = report.last_ns = cycle.t_ns
        if cycle.trip is not None:
            return
        if report.first_ns is None:
            report.first_ns = latch_ns
        if cycle.enabled:
            if report.enabled_at_ns is None:
                report.enabled_at_ns = latch_ns
            report.samples.push((latch_ns - before_ns, cycle.age_ns, computed_ns))
            report.cycles += 1
            if report.cycles % progress_every == 0:
                progress(report.cycles)
            if changes is not None and changes.waiting:
                changes.make(latch_ns + period_ns - report.enabled_at_ns, latch_ns, period_ns)
        else:
            enabling_periods -= 1
            if enabling_periods < 0:
                raise _not_enabled(plan, cycle)
        before_ns = latch_ns
        deadline_ns += period_ns


def _silent(done: int) -> None:
    """Nobody wants to see progress."""


def _feedback_time_ns(plan: Plan) -> int:
    """How long to wait for feedback: what computing and set-points leave of the period, but at least half of it."""
    sending_ns = max(bus.traffic.sending_ns for bus in plan.buses)
    return max(plan.period_ns // 2, plan.period_ns - plan.compute_ns - round(sending_ns))


def _enabling_time(plan: Plan) -> float:
    return ENABLING_TIME + max(axis.profile.timing.mode_change_timeout for axis in plan.axes)


def _not_enabled(plan: Plan, cycle: Cycle) -> BusTimeoutError:
    states = ", ".join(f"axis {axis.name} is in the state {cycle.power_state(axis.name).value}" for axis in plan.axes)
    return BusTimeoutError(
        f"operation enabled was not reached within {exactly(_enabling_time(plan))} s: {states}. Check safe torque off "
        "(STO), the motor supply, and that no brake or enable input holds the drive back"
    )

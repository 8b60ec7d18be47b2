"""The loop: wait, read, compute, write and record once a period, until enough periods are done or the run must stop.

Deadlines are absolute, t0 + k·T. A missed period is skipped, never made up for in a burst. However the loop ends,
`bus.stop` sends zero-torque set-points before an exception leaves the loop.
"""

import gc
import sys
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from types import CodeType
from typing import TYPE_CHECKING, TypeVar

from haptic_fieldbus.assessing.loop_report import SAMPLES, LoopReport, Record
from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import LINK_TRIPS
from haptic_fieldbus.cycle.trips import TRIP_ERRORS, explained, failed_in, moment, trip_error
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.errors import BusError, BusTimeoutError, DriveFaultError
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.ending import EndSignals

if TYPE_CHECKING:
    from haptic_fieldbus.running.changes import Changes

T = TypeVar("T")

# Settings of the interpreter that keep it from delaying the loop.


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Switch the garbage collector off inside the block, and restore it afterwards.

    The loop allocates nothing that grows, so nothing needs to be collected while it runs. Nor is there a collection
    before the run: in a large process it would take longer than the rest of the start.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


GIVE_WAY = 2e-5
"""Switch interval of the interpreter during a run [s].

The default of 5 ms would cost a loop at 1 kHz five periods each time that another thread computes.
"""


@contextmanager
def threads_give_way() -> Iterator[None]:
    """Shorten the switch interval inside the block, so that the loop does not wait for a computing thread."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, GIVE_WAY))  # a shorter interval of the caller stays
    try:
        yield
    finally:
        sys.setswitchinterval(before)


LONGEST_SAMPLE = 500_000
"""Largest number of periods with kept times; a longer run keeps the last ones."""
ENABLING_PERIODS = 20
"""Fewest periods in which a drive may reach *operation enabled*: each step takes two or three."""
PROGRESS_EVERY = 0.1
"""Time between two reports of progress [s]."""
UNCONFIRMED = "The drives did not confirm that their motors are off. Switch the power off."


@dataclass
class Caller:
    """The caller that has the rest of each period of a session."""

    leaving: CodeType | None = None
    """Function by which it ends the run; a signal does not interrupt it."""
    stopping: bool = False
    """True when the caller wants no further period."""
    late_ns: int = 0
    """Lateness of the present period [ns]."""
    longest_ns: int = 0
    """Longest time that it took between two periods [ns]."""

    def slow_on(self, plan: Plan, report: LoopReport) -> list[str]:
        """Return a sentence if the caller took longer than a period of a real bus, and one if its functions did."""
        computing_ns = report.sample("compute_ns").max(initial=0.0)
        took = (("the block of the session", self.longest_ns), ("computing the force", computing_ns))
        period = f"between two periods of {rounded(1e-6 * plan.period_ns)} ms"
        return [
            f"{who} took up to {rounded(1e-6 * longest_ns)} ms {period}"
            for who, longest_ns in took
            if not plan.simulated and longest_ns > plan.period_ns
        ]


Steps = Generator[None, None, T]
"""A run cut open: it pauses after each period in operation enabled if it has a `Caller`, else never."""


def finished(steps: Steps[T]) -> T:
    """Go through all that is left of a run and return its result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: T = end.value
            return found


def loop_steps(
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
    ending: EndSignals | None = None,
    caller: Caller | None = None,
) -> Steps[LoopReport]:
    """Run an opened bus for `cycles` periods of operation enabled and return the report of the run.

    Ctrl-C, or a signal that `ending` has noted, ends the run early and is no error. `progress` is called with the
    number of periods done. A `report` that is passed in is filled during the run, so that it can be read after an
    exception too. Raises DriveFaultError, BusError or SafetyTripError; by then `bus.stop` was called, and a note says
    so when a drive did not confirm it. BusError also after a run without fault, if a drive did not confirm its end.

    With a `caller` it pauses after each period in operation enabled; what is raised there ends the run.
    """
    report = LoopReport() if report is None else report
    report.samples = Record(SAMPLES, min(cycles, LONGEST_SAMPLE))
    report.period_ns = plan.period_ns
    if changes is not None:
        report.changes = changes.applied
        changes.open(cycle)
    failure: Exception | None = None
    # The garbage of a caller in virtual time may grow, and nothing waits there. Elsewhere none is collected until
    # torque is off: to look through all that a caller has kept takes longer than a watchdog waits.
    collecting = caller is not None and plan.simulated
    with nullcontext() if collecting else no_garbage_collection():
        try:
            # Only changes are computed by another thread, so only a run with changes must make threads give way.
            with threads_give_way() if changes is not None else nullcontext():
                yield from _run(
                    plan, cycle, bus, clock, cycles, record, progress or (lambda done: None), report, changes,
                    ending or EndSignals(), caller,
                )  # fmt: skip
        except KeyboardInterrupt:
            report.interrupted = True
        except BusError as error:
            # The same class, so that callers can tell errors apart, with the moment added to the message.
            when = "" if report.enabled_at_ns is None else f", {moment(clock.now_ns(), report.enabled_at_ns)}"
            failure = type(error)(f"{error}{when}")
            failure.__cause__ = error
        except Exception as error:
            failure = error  # raised at the end, when torque is off
        finally:
            report.foreign_load = bus.foreign_load
            report.released = bus.stop()
            if changes is not None:
                report.unmade = changes.close(report.duration)
    if cycle.trip is not None:
        # After `bus.stop`, which may have received the emergency or boot-up message of a node that had fallen silent.
        cycle.trip = explained(cycle.trip, bus.causes)
        if cycle.failure is not None:
            cycle.trip = failed_in(cycle.trip, cycle.failure, plan.scene)
        tripped = trip_error(cycle.trip, plan, report.enabled_at_ns, released=report.released)
        tripped.__cause__ = cycle.failure or failure
        failure = tripped
    elif failure is None:
        report.late_faults = bus.causes
    if failure is not None:
        for note in [] if caller is None else caller.slow_on(plan, report):
            failure.add_note(note)
        if not report.released:
            failure.add_note(UNCONFIRMED)
        raise failure
    if not report.released:
        raise BusError(f"{UNCONFIRMED} {' '.join(f'{warning}.' for warning in bus.warnings)}".rstrip())
    return report


def _run(
    plan: Plan, cycle: Cycle, bus: Bus, clock: Clock, cycles: int, record: Record | None,
    progress: Callable[[int], None], report: LoopReport, changes: "Changes | None", ending: EndSignals,
    caller: Caller | None,
) -> Steps[None]:  # fmt: skip
    period_ns, compute_ns = plan.period_ns, plan.compute_ns
    feedback_ns = feedback_time_ns(plan)
    enabling_periods = round(enabling_time(plan) * plan.rate)
    progress_every = max(1, round(PROGRESS_EVERY * plan.rate))
    step, asked = cycle.step, set[str]()
    deadline_ns = clock.now_ns()  # t0: the first period begins at once
    before_ns = deadline_ns - period_ns
    while report.cycles < cycles:
        late_ns = clock.sleep_until(deadline_ns)
        if ending.signal is not None:
            report.interrupted = True
            return
        if late_ns >= period_ns:
            # Skip whole periods only, so that the deadlines stay on the grid t0 + k·T.
            if report.enabled_at_ns is not None:
                report.missed += late_ns // period_ns
            deadline_ns += late_ns // period_ns * period_ns
        # Feedback is waited for from the real start of the period, not from its deadline.
        image = bus.read(deadline_ns + late_ns % period_ns + feedback_ns)
        # The host's computing time is reported and never acts; in virtual time the plan's constant passes instead.
        started_ns = time.perf_counter_ns()
        output = step(image)
        computed_ns = time.perf_counter_ns() - started_ns
        clock.compute(compute_ns)
        if report.enabled_at_ns is None:
            _check_asked(cycle, asked)
        bus.write(output)
        # After the write, so that recording delays no set-point, and before the return, so that it holds the trip.
        if record is not None:
            record.push(cycle.row)
        latch_ns = report.last_ns = cycle.t_ns
        if cycle.trip is not None:
            return
        if report.first_ns is None:
            report.first_ns = latch_ns
        if cycle.enabled:
            enabled_ns = report.count(latch_ns, latch_ns - before_ns, cycle.age_ns, computed_ns, late_ns)
            if report.cycles % progress_every == 0:
                progress(report.cycles)
            if changes is not None and changes.waiting:
                try:
                    changes.make(latch_ns + period_ns - enabled_ns, latch_ns, period_ns)
                except Exception as error:  # of a law that is tried before it acts
                    cycle.fail(error)
                    return
            if caller is not None:
                caller.late_ns = late_ns
                began_ns = time.perf_counter_ns()
                try:
                    ending.resume()  # a signal raises in the code of the caller
                    yield
                finally:
                    ending.hold()
                    caller.longest_ns = max(caller.longest_ns, time.perf_counter_ns() - began_ns)
                if caller.stopping:
                    return
        else:
            enabling_periods -= 1
            if enabling_periods < 0:
                raise not_enabled(plan, {axis.name: cycle.axes[axis.name].state.power for axis in plan.axes})
        before_ns = latch_ns
        deadline_ns += period_ns


def _check_asked(cycle: Cycle, asked: set[str]) -> None:
    """Note the axes that are commanded to *operation enabled*; raises DriveFaultError for one that got there before."""
    for name, at in cycle.axes.items():
        if at.state.power is PowerState.OPERATION_ENABLED and name not in asked:
            raise enabled_by_itself(at.axis, at.state.power)
        if at.state.controlword in at.axis.power.enabling:
            asked.add(name)


def feedback_time_ns(plan: Plan) -> int:
    """Return how long to wait for feedback [ns]: the period less computing and sending, but at least half a period."""
    sending_ns = max(bus.traffic.sending_ns for bus in plan.buses)
    return max(plan.period_ns // 2, plan.period_ns - plan.compute_ns - round(sending_ns))


def enabling_time(plan: Plan) -> float:
    """Return the time allowed to reach operation enabled [s]: that of the slowest drive, but some periods at least."""
    timings = [axis.profile.timing for axis in plan.axes]
    slowest = max(timing.enabling_timeout + timing.mode_change_timeout for timing in timings)
    return max(slowest, ENABLING_PERIODS * plan.period)


def not_enabled(plan: Plan, states: Mapping[str, PowerState]) -> BusTimeoutError:
    """Return the error for drives that did not reach operation enabled; `states` is the power state of each axis."""
    listed = ", ".join(f"axis {name} is in the state {state.value}" for name, state in states.items())
    return BusTimeoutError(
        f"operation enabled was not reached within {exactly(enabling_time(plan))} s: {listed}. Check safe torque off "
        "(STO), the motor supply, and that no brake or enable input blocks the drive"
    )


def enabled_by_itself(axis: AxisPlan, state: PowerState) -> DriveFaultError:
    """Return the error for a drive that may feed its motor in this state, to which it was not commanded."""
    return DriveFaultError(
        f"axis {axis.name}: node {axis.node} changed to {state.value} by itself. No torque was commanded. Another "
        "program, or an input of the drive, may enable it"
    )


# What is done on a bus before the loop runs: drives are configured, looked at without torque, and stopped again.


@contextmanager
def started(plan: Plan, bus: Bus, ending: EndSignals) -> Iterator[None]:
    """Configure and start an inspected bus, and stop it at the end of the block in any case.

    Raises KeyboardInterrupt after a signal, and BusError when a drive does not confirm that it is off; a note says so
    if the block raised another error.
    """
    bus.configure(plan)
    try:
        bus.start()
        yield
    except BaseException as error:
        ending.hold()
        if not bus.stop():
            error.add_note(UNCONFIRMED)
        raise
    if not bus.stop():
        raise BusError(f"{UNCONFIRMED} {' '.join(f'{warning}.' for warning in bus.warnings)}".rstrip())
    if ending.signal is not None:
        raise KeyboardInterrupt


def check_link(axis: AxisPlan, found: int, code: int, moment: str) -> None:
    """Raise the error of the first link fault among these flags; `moment` ends the sentence."""
    for flag, kind in LINK_TRIPS.items():
        if found & flag:
            raise TRIP_ERRORS[kind](f"axis {axis.name}: {axis.traffic.fault_text(flag, code, axis.bus_name)}, {moment}")

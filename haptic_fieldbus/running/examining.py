"""Checks of this computer for a loop in real time: its clock, how late it wakes up, and the rights that it gives."""

import time
from collections.abc import Callable, Iterable, Sequence
from statistics import quantiles

from haptic_fieldbus.assessing.loop_report import LATE_SHARE
from haptic_fieldbus.assessing.rights import Right
from haptic_fieldbus.buses.found import Check
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.running.rights import real_time

MEASURED = 1.0
"""Time for which wake-ups are measured [s]."""
RESOLUTION = 1e-6
"""Coarsest clock by which periods can be told [s]."""


def examine(of_the_buses: Callable[[], Iterable[Check]], rate: float) -> list[Check]:
    """Return the checks of buses and computer for a run of `rate` [Hz], made with the rights that it would have."""
    with real_time() as rights:
        buses = list(of_the_buses())
        return [*buses, clock_check(), wake_up_check(lateness(MonotonicClock(), rate), rate), *map(right_check, rights)]


def right_check(right: Right) -> Check:
    """Return a right as a check."""
    return Check(right.name, right.granted, right.got, right.advice)


def clock_check() -> Check:
    """Check the resolution of the clock of the loop."""
    info = time.get_clock_info("monotonic")
    fine = info.monotonic and info.resolution <= RESOLUTION
    measured = f"{info.implementation}, steps of {rounded(1e9 * info.resolution)} ns"
    return Check("clock", fine, measured, "" if fine else "use Linux: this clock is too coarse for a loop")


def lateness(clock: Clock, rate: float, measured: float = MEASURED) -> list[float]:
    """Wait for the periods of `rate` [Hz] for so long [s], and return how late each began [s]."""
    period_ns, began_ns = round(1e9 / rate), clock.now_ns()
    number = max(2, round(measured * rate))
    return [clock.sleep_until(began_ns + at * period_ns) * 1e-9 for at in range(1, number + 1)]


def wake_up_check(late: Sequence[float], rate: float) -> Check:
    """Check that 99 of 100 periods of `rate` [Hz] begin late by no more than a tenth of the period."""
    cuts = quantiles(late, n=100, method="inclusive")
    punctual = cuts[98] <= LATE_SHARE / rate
    measured = (
        f"late by {rounded(1e6 * cuts[49])} µs as a rule, {rounded(1e6 * cuts[98])} µs in 1 of 100, "
        f"{rounded(1e6 * max(late))} µs at most, at {rounded(rate)} Hz"
    )
    advice = (
        "take load from this computer, give it real-time rights (scheduling, memory), or lower --rate: a period should "
        f"begin late by no more than {rounded(1e6 * LATE_SHARE / rate)} µs"
    )
    return Check("wake_up", punctual, measured, "" if punctual else advice)

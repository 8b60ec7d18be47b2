"""The longest time from an event to zero torque at the motor, for each cause of a torque-off.

There are three ways to zero torque. Each cause takes the first way that works for it:

- The loop sees the event in the feedback of the next period, and the set-points of that period are torque-free.
- If feedback is missing, the torque is held and then fades; feedback that becomes too old is a trip. If set-points wait
  for answers, nothing fades, and the trip comes first. Axes without a coupling to the axis without feedback do not
  fade; the trip takes their torque away.
- If no message of the host reaches the drive, the drive watchdog takes the torque away.

A torque loop of first order never reaches zero, so *zero* is `REMAINDER` of the torque at the event. The times assume a
host that is never late. A delay of the host adds to them; the drive watchdog bounds it, even if the host stops.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.planning import limits
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.guards import unguarded
from haptic_fieldbus.protocols.traffic import BusTraffic, Json, OtherMasters
from haptic_fieldbus.signals import Signal

# Warnings for the first enabling of a drive after power-on.


def first_enabling(profile: DriveProfile) -> str:
    """Return the warning for a drive that searches its commutation; empty for any other drive."""
    if not profile.drive.commutation_search:
        return ""
    timing = profile.timing
    longest = exactly(timing.enabling_timeout + timing.mode_change_timeout)
    return (
        "the first enabling after power-on may turn the shaft while the drive finds its commutation: keep hands off "
        f"and the way free for up to {longest} s"
    )


def enabling_lines(axes: Iterable[AxisPlan]) -> Iterator[str]:
    """Yield the warning of each axis that has one."""
    for axis in axes:
        if warning := first_enabling(axis.profile):
            yield f"{axis.name}: {warning}"


REMAINDER = 0.01
"""Share of the initial torque below which torque counts as zero."""
BESIDE = "switched off acyclically"
BY_PERSON = "a person who cuts the power"


class EndCause(Enum):
    """Cause of a torque-off; the value is the name that users and scripts see."""

    TRIP = "own limit or trip"
    FEEDBACK = "feedback lost"
    FAULT = "drive fault or emergency"
    RESET = "node reset"
    HEARTBEAT = "heartbeat of the drive lost"
    NOT_OPERATIONAL = "drive left operational"
    DISCONNECTED = "bus-off or cable off"
    KILLED = "master killed"
    STOPPED = "master stopped"
    NO_EFFECT = "set-points without effect"
    OTHER_MASTER = "set-points of another master"
    END = "Ctrl-C or ordinary end"


@dataclass(frozen=True)
class TorqueDeadline:
    """The longest time from an event to zero torque [s]; inf when the event is not detected."""

    cause: EndCause
    seconds: float
    how: str

    def to_json(self) -> dict[str, Json]:
        """Return the object of `plan --json`; the time is None when the event is not detected."""
        return {"cause": self.cause.value, "stated_ms": 1e3 * self.seconds if math.isfinite(self.seconds) else None}


def torque_deadlines(axes: Sequence[tuple[AxisPlan, BusTraffic]], period: float) -> tuple[TorqueDeadline, ...]:
    """Return the deadline for each cause, each that of the slowest axis."""
    slowest: dict[EndCause, TorqueDeadline] = {}
    others = "; the others: {}" if len(axes) > 1 else ""
    untied = len(axes) > 1 and not all(axis.couplings for axis, _ in axes)
    age = max(axis.limits.age for axis, _ in axes)
    for axis, traffic in axes:
        shared = sum(other is traffic for _, other in axes) > 1
        for each in _of_axis(axis, traffic, period, age, others, untied=untied, shared=shared):
            if each.cause not in slowest or each.seconds > slowest[each.cause].seconds:
                slowest[each.cause] = each
    return tuple(slowest.values())


def _of_axis(
    axis: AxisPlan, traffic: BusTraffic, period: float, age: float, others: str, *, untied: bool, shared: bool
) -> Iterable[TorqueDeadline]:
    """Yield the deadlines of one axis, in the order of `EndCause`.

    `others` is a format for the text on the other axes, empty for one axis. `age` is the largest feedback age before a
    trip of all axes [s]. `untied` axes do not fade with one another, and a `shared` line has other drives.
    """
    alone, end = bool(unguarded(axis.profile, axis.rig)), _end(axis, traffic)
    brakes = axis.rig.on_link_loss == "brake"
    watch = traffic.guard(axis.name)
    guard = math.inf if alone or brakes else watch
    # The event may happen just after a latch, so the next one shows it.
    seen = period + traffic.latch(axis.name) + axis.delay.transport + end
    faded, old = _missing(axis, period, age)
    by_loop = "zero torque sent in the next period"
    longest, after = f"{rounded(1e3 * watch)} ms", ", then the drive brakes for an unknown time" if brakes else ""
    by_guard = BY_PERSON if alone else f"drive watchdog {longest}{after}"
    after_trip = f"by {BY_PERSON}" if alone else f"by the drive watchdog within {longest} of the trip{after}"
    yield TorqueDeadline(EndCause.TRIP, seen + traffic.doubted_periods * period, by_loop)
    by_age = f"trip when feedback is older than {rounded(1e3 * age)} ms"
    lost, by_loss = min(faded, old) + end, "held for one period, then faded out"
    if untied:
        lost, by_loss = old + end, f"{by_loss}; axes without a coupling to it: {by_age}"
    elif shared and math.isinf(traffic.silence):  # drives that only answer are asked one after another
        lost, by_loss = old + end, f"{by_loss}; other drives of the line wait for the silent one: {by_age}"
    if traffic.waits_for_answers:
        lost, by_loss = old + end, f"held, because nothing is sent before the drive answers; {by_age}"
        if shared:  # a gateway may wait for the silent drive, and forward nothing to the others
            lost, by_loss = max(lost, period + guard + end), f"{by_loss}; behind a gateway: {by_guard}"
    yield TorqueDeadline(EndCause.FEEDBACK, lost, by_loss)
    # A profile without a reaction to the loss of the master has none to a fault either: the drive may brake.
    by_drive = "the drive by itself" if axis.profile.guarded else "the drive by itself after an unknown time"
    yield TorqueDeadline(EndCause.FAULT, seen if axis.profile.guarded else math.inf, by_drive + others.format(by_loop))
    yield TorqueDeadline(EndCause.RESET, lost, "the drive by itself" + others.format("as for lost feedback"))
    if math.isfinite(traffic.silence):
        how = f"{rounded(1e3 * traffic.silence)} ms without a heartbeat, then {by_loop}"
        yield TorqueDeadline(EndCause.HEARTBEAT, traffic.silence + period + seen, how)
    how = f"{by_age}, then {BESIDE}, or {after_trip}"
    yield TorqueDeadline(EndCause.NOT_OPERATIONAL, old + guard + end, how)
    # If only one of several drives is disconnected, the others lose their torque as with lost feedback.
    yield TorqueDeadline(EndCause.DISCONNECTED, max(guard + end, lost if untied or shared else 0.0), by_guard)
    yield TorqueDeadline(EndCause.KILLED, guard + end, by_guard)
    yield TorqueDeadline(EndCause.STOPPED, guard + end, by_guard)
    echo, how = axis.limits.echo, "not detected: the drive does not return its set-points"
    if math.isfinite(echo):  # a constant set-point shows no difference
        how = f"trip when not followed for {rounded(1e3 * echo)} ms after a change, then {BESIDE}, or {after_trip}"
    yield TorqueDeadline(EndCause.NO_EFFECT, echo + period + guard + end, how)
    if axis.other_masters is not None:
        acting, how = _replaced(axis.other_masters, period)
        yield TorqueDeadline(EndCause.OTHER_MASTER, acting + seen, how)
    yield TorqueDeadline(EndCause.END, seen, "zero torque sent at once")


def _replaced(others: OtherMasters, period: float) -> tuple[float, str]:
    """Return how long set-points of another master act until enough of them are detected [s], and by which signal.

    Each acts until our set-point replaces it. The content of a gateway may be a period old.
    """
    if others.shown_by is None:
        return math.inf, "not detected: no register shows them before ours replace them"
    within = f"{limits.FOREIGN_TIMES} within {exactly(limits.FOREIGN_WITHIN)} s"
    shown = f"{others.shown_by.value} shows them; {within} are a trip"
    acting = limits.FOREIGN_TIMES * limits.foreign_gap(period, others.every) + period
    return acting, f"sum of the times until ours replace them; {shown}"


def unseen_text(axis: AxisPlan, period: float) -> str:
    """Return the undetected set-points of another master, in words; empty if its messages are received."""
    others = axis.other_masters
    if others is None:
        return ""
    who = f"set-points of another master on {axis.bus_name}"
    if others.shown_by is None:
        return f"{who}: all of them; no register of {axis.profile.title} shows them before ours replace them"
    measured = others.shown_by is Signal.TORQUE_ACTUAL
    recent = limits.recent_time(period, axis.limits.age, axis.delay.torque_loop if measured else 0.0)
    overshoot = f" and {percent(limits.OVERSHOOT)} of their range" if measured else ""
    turns = "" if others.every == 1 else f", checked in one of {others.every} periods"
    return (
        f"{who}: those that act for less than {rounded(1e3 * others.blind)} ms (period "
        f"{rounded(1e3 * period)} ms){turns}; those outside the range of ours in the last "
        f"{rounded(1e3 * recent)} ms by less than {percent(limits.FOREIGN_SHARE)} of rated torque{overshoot}. Fewer "
        f"than {limits.FOREIGN_TIMES} within {exactly(limits.FOREIGN_WITHIN)} s do not trip"
    )


def _end(axis: AxisPlan, traffic: BusTraffic) -> float:
    """Return the time added to every way [s]: messages in between, one tick of the drive, lag of its torque loop."""
    lag = -math.log(REMAINDER) * axis.delay.torque_loop
    return traffic.disturbance + axis.profile.timing.control_period + lag


def _missing(axis: AxisPlan, period: float, age: float) -> tuple[float, float]:
    """Return the time from the last feedback to torque-free set-points [s]: by the fade, and by the trip at `age`."""
    # A loop without feedback waits for it nearly to the end of its period. Set-points at SYNC then act a period later.
    answered = period * (2.0 if axis.delay.transport >= period else 1.0)
    faded = (1 + limits.fade_periods(period)) * period
    return faded + answered, age + period + answered

"""The proof that set-points act: what was sent is compared with what the drive shows.

A drive whose set-points are lost (its RPDO disabled by another tool, or frames that no longer reach it) holds its last
torque, while feedback and signs of life go on. The sign is that its echo does not follow:

- A torque demand equals the target that was sent, to within a step, one period later; where it acts at a SYNC, at which
  the feedback is sampled before, or at a control tick beside one, the target of the period before may still be there.
- A target torque that is asked for is one of those that were in force between question and answer.
- A torque actual value follows through the lag of the torque loop, a first order whose output is worked out here. Its
  tolerance is for noise and ripple of the current. Friction does not enter: the value is that of the motor's current.

A difference raises a doubt. The doubt ends when the echo has moved and agrees with one of the last targets, or when it
has agreed for a whole deadline; it becomes a trip when the echo still differs after the deadline. That the echo must
have moved is for torques that swing: a frozen torque agrees with a swinging one now and then. While the torque is
constant nothing can be proved: the deadline runs from the first change that does not come back. An echo that is asked
for may also stay away altogether; after its own deadline that is a trip too, because nothing is proved any more.
The first sample after missing ones is not compared: on Modbus TCP nothing is sent while an answer is outstanding.

While there is a doubt the motor may give what was not sent. The work of the difference is booked by the energy ledger
as forgiven when the doubt ends, if it was given to the hand.

Where set-points of another master cannot be heard (Modbus), they are counted besides. Each acts until ours replaces it,
so that the echo is right again soon and no doubt lasts. What a drive shows is theirs when it is more than any of our
targets of late, in either direction, by more than a hand may be left alone with and an overshoot. Targets of late are
those of a whole deadline and of the age at which feedback is a trip: set-points that were lost, a torque loop with a
lag, and a gateway that answers with what is a period old, show one of them. Less torque than was sent is no sign of
another master: a drive at the limit of its current or its supply gives less, too.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from itertools import islice

from haptic_fieldbus.cycle.axis_checks import STATUSWORD, T_NS, TripOff
from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.cycle.sensing import Feedback, PeriodStep
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limits import (
    ECHO_SHARE,
    ECHO_STEPS,
    FOREIGN_SHARE,
    FOREIGN_TIMES,
    FOREIGN_WITHIN,
    OVERSHOOT,
    doubt_time,
    foreign_gap,
    recent_time,
)
from haptic_fieldbus.signals import Signal

LAGS = 3.0
"""After so many time constants of the torque loop a target counts as reached."""
FEWEST_TARGETS = 3
"""Of the last targets that an echo may agree with: acting on reception or at a SYNC, and one frame that was lost."""


def bind_echo(
    axis: AxisPlan,
    state: AxisState,
    period: float,
    trip: TripOff,
    forgive: Callable[[float], None],
    feedback: Feedback,
    render: PeriodStep,
) -> PeriodStep:
    """Return a step that checks the echo and then renders; `render` alone when the drive shows nothing of its targets.

    The check comes first, while the state still has the target that was sent last. `forgive` takes the energy that was
    given beyond what was sent while there was a doubt [J].
    """
    echo = axis.profile.echo
    if echo is None or math.isinf(axis.limits.echo):
        return render
    place = STATUSWORD + [mapped.signal for mapped in axis.incoming].index(echo)
    lags = echo is Signal.TORQUE_ACTUAL
    shown = {Signal.TORQUE_ACTUAL: axis.shown_unit, Signal.TORQUE_DEMAND: axis.demand_unit}.get(echo, axis.effort_unit)
    tolerance = ECHO_STEPS * max(1.0, shown / axis.effort_unit)
    if lags:
        tolerance = max(tolerance, ECHO_SHARE * axis.rated_effort / axis.effort_unit)
    doubt = EchoMismatch(axis, state, period, tolerance, trip, forgive)
    bind = _bind_asked if echo is Signal.TARGET_ASKED else _bind_actual if lags else _bind_demand
    return bind(axis, state, period, place, doubt, feedback, render)


def bind_other_masters(
    axis: AxisPlan, state: AxisState, period: float, trip: TripOff, feedback: Feedback, render: PeriodStep
) -> PeriodStep:
    """Return a step that counts set-points of another master, then renders; `render` alone where none can be seen."""
    shown_by = None if axis.other_masters is None else axis.other_masters.shown_by
    if shown_by is None:
        return render
    signals = [mapped.signal for mapped in axis.incoming]
    place = STATUSWORD + signals.index(shown_by)
    # A target that is read back comes in some periods only; a value without it counts in every period.
    came = STATUSWORD + (signals.index(Signal.ASKED_PERIODS) if shown_by is Signal.TARGET_ASKED else 0)
    always = shown_by is not Signal.TARGET_ASKED
    unit = {Signal.TORQUE_ACTUAL: axis.shown_unit, Signal.TORQUE_DEMAND: axis.demand_unit}.get(
        shown_by, axis.effort_unit
    )
    sign = axis.rig.mechanism.sign * _ratio(unit, axis)
    others = OtherMaster(axis, period, shown_by, trip)
    sent, tolerance, look = others.sent, others.tolerance, others.look

    def check() -> None:
        target = state.target
        sent.append(target)
        if state.steps:
            now = feedback()
            shown = sign * now[place]
            if not -tolerance <= shown - target <= tolerance and (always or now[came]):
                look(now[T_NS], shown)
        render()

    return check


class OtherMaster:
    """Count of the set-points of another master that were seen; values in steps of target torque."""

    def __init__(self, axis: AxisPlan, period: float, shown_by: Signal, trip: TripOff) -> None:
        limits, measured = axis.limits, shown_by is Signal.TORQUE_ACTUAL
        recent = recent_time(period, limits.age, axis.delay.torque_loop if measured else 0.0)
        self.sent = deque([0], maxlen=math.ceil(recent / period) + FEWEST_TARGETS)
        """Targets that may still be what the drive shows, the last one at the end."""
        self.tolerance = FOREIGN_SHARE * axis.rated_effort / axis.effort_unit
        self._overshoot = OVERSHOOT if measured else 0.0
        self._unit, self._trip = axis.effort_unit, trip
        every = 1 if axis.other_masters is None else axis.other_masters.every
        self._apart_ns = 1e9 * (foreign_gap(period, every) - period)
        self._seen: deque[int] = deque(maxlen=FOREIGN_TIMES)

    def look(self, now_ns: int, shown: float) -> None:
        """Count what the drive shows, if it is no target of ours; trip when that is often."""
        low, high = min(0, *self.sent), max(0, *self.sent)
        slack, seen = self.tolerance + self._overshoot * (high - low), self._seen
        if low - slack <= shown <= high + slack or (seen and now_ns - seen[-1] < self._apart_ns):
            return
        seen.append(now_ns)
        passed = (now_ns - seen[0]) * 1e-9
        if len(seen) == FOREIGN_TIMES and passed <= FOREIGN_WITHIN:
            often = f"{FOREIGN_TIMES} times within {rounded(passed)} s"
            most = low if shown < 0.0 else high
            self._trip(TripKind.SET_POINTS_FOREIGN, shown * self._unit, most * self._unit, often)


def _bind_demand(
    axis: AxisPlan,
    state: AxisState,
    period: float,
    place: int,
    doubt: "EchoMismatch",
    feedback: Feedback,
    render: PeriodStep,
) -> PeriodStep:
    """Compare with the target that must be in force by now, or with the nearer one of two where it may be either."""
    sign, tolerance = axis.rig.mechanism.sign * _ratio(axis.demand_unit, axis), doubt.tolerance
    waits = axis.delay.transport > (1.0 - 1e-9) * period and not axis.delay.acts_first
    before = deque([0] * (FEWEST_TARGETS - 1), maxlen=FEWEST_TARGETS - 1)
    missed = False

    def check() -> None:
        nonlocal missed
        sent = state.target
        if missed or not state.steps:
            missed = not state.steps
        else:
            now = feedback()
            shown = sign * now[place]
            expected = before[0] if waits and abs(shown - before[0]) < abs(shown - sent) else sent
            if doubt.open or not -tolerance <= shown - expected <= tolerance:
                doubt.look(now[T_NS], shown, expected, (sent, *before))
        before.appendleft(sent)
        render()

    return check


def _bind_asked(
    axis: AxisPlan,
    state: AxisState,
    period: float,
    place: int,
    doubt: "EchoMismatch",
    feedback: Feedback,
    render: PeriodStep,
) -> PeriodStep:
    """Compare an answer with the targets that were in force between question and answer."""
    sign, longest_ns = axis.rig.mechanism.sign, axis.limits.echo * 1e9
    asked = STATUSWORD + [mapped.signal for mapped in axis.incoming].index(Signal.ASKED_PERIODS)
    # Where set-points act at a SYNC, the one before the question may still have been in force.
    waits = axis.delay.transport > (1.0 - 1e-9) * period
    remembered = math.ceil(axis.limits.echo / period) + 1
    sent = deque([0] * remembered, maxlen=remembered)
    heard_ns: int | None = None

    def check() -> None:
        nonlocal heard_ns
        sent.appendleft(state.target)
        now = feedback()
        periods, t_ns = now[asked], now[T_NS]
        if periods:
            heard_ns = t_ns
            shown = sign * now[place]
            nearest = min(islice(sent, periods + waits), key=lambda target: abs(target - shown))
            if doubt.open or abs(nearest - shown) > doubt.tolerance:
                doubt.look(t_ns, shown, nearest, tuple(islice(sent, periods + FEWEST_TARGETS - 1)))
        elif heard_ns is None:
            heard_ns = t_ns
        elif t_ns - heard_ns > longest_ns:
            doubt.unanswered(t_ns - heard_ns, sent[0])
        render()

    return check


def _bind_actual(
    axis: AxisPlan,
    state: AxisState,
    period: float,
    place: int,
    doubt: "EchoMismatch",
    feedback: Feedback,
    render: PeriodStep,
) -> PeriodStep:
    """Compare with the target that must be in force by now, after the lag of the torque loop."""
    sign, tolerance, lag = (
        axis.rig.mechanism.sign * _ratio(axis.shown_unit, axis),
        doubt.tolerance,
        axis.delay.torque_loop,
    )
    late = min(axis.delay.transport, period)
    # From the sample before on, the target before the last was in force, then the last one.
    kept, own = math.exp(-period / lag), 1.0 - math.exp(-(period - late) / lag)
    older = 1.0 - own - kept
    remembered = FEWEST_TARGETS - 1 + math.ceil(LAGS * lag / period)
    before = deque([0] * remembered, maxlen=remembered)
    torque, missed = 0.0, False

    def check() -> None:
        nonlocal torque, missed
        sent = state.target
        torque = kept * torque + older * before[0] + own * sent
        if missed or not state.steps:
            missed = not state.steps
        else:
            now = feedback()
            shown = sign * now[place]
            if doubt.open or not -tolerance <= shown - torque <= tolerance:
                doubt.look(now[T_NS], shown, torque, (sent, *before))
        before.appendleft(sent)
        render()

    return check


def _ratio(unit: float, axis: AxisPlan) -> float:
    """Return how many steps of the target are one step of the echo; the integer 1 where both have one unit."""
    ratio = unit / axis.effort_unit
    return 1 if abs(ratio - 1.0) < 1e-9 else ratio


class EchoMismatch:
    """The doubt whether set-points act, and its way to a trip; values in steps of target torque."""

    def __init__(
        self,
        axis: AxisPlan,
        state: AxisState,
        period: float,
        tolerance: float,
        trip: TripOff,
        forgive: Callable[[float], None],
    ) -> None:
        self.tolerance = tolerance
        self.open = False
        self._state, self._trip, self._forgive = state, trip, forgive
        self._given = 0.0
        """Work of the motor in this doubt beyond that of what was sent [J]."""
        self._unit = axis.effort_unit
        self._period_ns = round(period * 1e9)
        # A sample that comes a little early still ends the deadline.
        self._deadline_ns = doubt_time(period) * 1e9 - self._period_ns // 2
        self._since_ns = self._differed_ns = 0
        self._stuck = 0.0

    def unanswered(self, waited_ns: int, sent: int) -> None:
        """Trip when the drive does not answer any more what torque it was sent."""
        self._trip(TripKind.SET_POINTS_DEAD, math.nan, sent * self._unit, f"{waited_ns * 1e-6:.0f}")

    def look(self, now_ns: int, shown: float, expected: float, targets: Sequence[int]) -> None:
        """Raise, keep or end the doubt; trip when the drive still shows another torque after the deadline."""
        differs = abs(shown - expected) > self.tolerance
        if not self.open:
            self.open, self._stuck = True, shown
            # The target that does not come back was sent in the period before.
            self._since_ns, self._differed_ns = now_ns - self._period_ns, now_ns
            return
        moved = abs(shown - self._stuck) > self.tolerance
        agrees = min(targets) - self.tolerance <= shown <= max(targets) + self.tolerance
        if (moved and agrees) or (not differs and now_ns - self._differed_ns > self._deadline_ns):
            self._end()
        elif differs:
            # The first sample does not count: after a gap a set-point may act a period later than usual.
            self._given += (shown - expected) * self._unit * self._state.way
            self._differed_ns = now_ns
            waited_ns = now_ns - self._since_ns
            if waited_ns > self._deadline_ns:
                self._end()
                sent = round(expected) * self._unit
                self._trip(TripKind.SET_POINTS_DEAD, shown * self._unit, sent, f"{waited_ns * 1e-6:.0f}")

    def _end(self) -> None:
        """End the doubt, and tell what was given to the hand meanwhile."""
        self.open, given, self._given = False, self._given, 0.0
        if given > 0.0:
            self._forgive(given)

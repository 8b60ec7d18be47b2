"""Plausibility of a drive: the torque sent is compared with the echo of the drive and with the motion of the handle.

Echo. A drive whose set-points are lost (its RPDO disabled by another tool, or frames that no longer reach it) holds its
last torque, while feedback and signs of life go on. The symptom is an echo that does not follow. These rules hold for a
drive that does follow:

- A torque demand equals the sent target, to within a step, one period later. If the drive samples its feedback before
  the set-point acts, at a SYNC or at a control tick near it, it may still show the target of the period before.
- A target torque that is read back is one of the targets in force between question and answer.
- A torque actual value follows with the lag of the torque loop, a first-order lag that is computed here. The tolerance
  covers noise and ripple of the current. Friction has no effect: the value is derived from the motor current.

A difference raises a doubt. The doubt ends when the echo has moved and agrees with one of the last targets, or when it
has agreed for a whole deadline. It becomes a trip when the echo still differs after the deadline. The echo must have
moved because a frozen torque agrees with an oscillating torque from time to time. While the torque is constant nothing
can be proved: the deadline runs from the first change that the echo does not show. An echo that is read back may also
fail to arrive; after a deadline of its own this is a trip too. The first sample after missing samples is not compared:
on Modbus TCP nothing is sent while an answer is outstanding.

During a doubt the torque of the motor may differ from the torque sent. When the doubt ends, the energy ledger books the
work of this difference as forgiven, if the hand got it.

Other masters. If the messages of other masters cannot be received (Modbus), their set-points are counted by the echo.
Each of them acts until our set-point replaces it; the echo is then right again, and no doubt lasts. A shown torque
counts as foreign if it exceeds all our recent targets, in either direction, by more than the holding torque plus an
overshoot. Recent targets are those of a whole deadline plus the age at which feedback is a trip. After lost set-points,
behind the lag of a torque loop, or from a gateway whose answer is a period old, a drive still shows one of them. Less
torque than was sent does not indicate another master: a drive at the limit of its current or its supply gives less,
too.

Sign watch. A change of torque must show in the acceleration while the scene runs.

In a scene torque follows motion, so torque and position are correlated whatever the sign is. The time scale separates
them. Within blocks of 5 ms a hand changes its force little, while contact changes the torque much. With the mean torque
u and the mean acceleration a of two blocks, and their changes δu and δa from one pair of blocks to the next,

    S = Σ m·δa·δu,   N = Σ δu²     (m: mass of the bench; the sums forget within 0.1 s)

S/N is the share of a change of torque that appears in the motion: 1 for a free handle, less with the mass of a hand, −1
when the sign has turned. If S/N is below −½ and N is as large as in strong contact, the sign is in doubt. The force is
then limited to the holding force, and pulses test the sign again (`cycle.sign`). A wrong sign ends the run. A blow of a
hand raises the same doubt, because it changes the force against the torque by more than the torque changes. The test
then confirms the sign, and the force rises again. None of the shipped hands raises a doubt
(`tests/system/test_sign.py`).

The watch does not prove that the sign is right. It detects a later change, such as a drive that another tool reverses.
An axis has no watch if a count is too coarse for an acceleration within a block, if a period is too long, or if the
scene itself reacts to acceleration: a virtual mass gives torque against every knock of a hand.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from itertools import islice

from haptic_fieldbus.cycle.laws import AxisState, PeriodStep
from haptic_fieldbus.cycle.safety import TripKind, TripOff
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import T_NS
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
from haptic_fieldbus.planning.sign_probe import virtual_mass
from haptic_fieldbus.signals import Signal, Workspace

LAGS = 3.0
"""Number of time constants of the torque loop after which a target counts as reached."""
FEWEST_TARGETS = 3
"""Smallest number of last targets with which an echo may agree: on reception or at a SYNC, and one lost frame."""
SHORTEST_BLOCK, LONGEST_BLOCK = 0.005, 0.01
"""[s]"""
COARSENESS = 0.05
"""Largest error of the encoder within a block, as a share of rated torque."""
MEMORY = 0.1
"""Time constant with which the sums decay [s]."""
STRONG = 0.1
KNOCK = {Workspace.LINEAR: 5.0, Workspace.ROTARY: 0.25}
"""Share of rated torque, and half the knock of a hand [N or N·m]; contact is strong if √N is above both."""
AGAINST = -0.5
"""S/N below which the motion goes against the torque."""
HEAVIEST = 0.05
"""Largest virtual mass with which the watch works, as a share of the mass of the bench."""
WORST_ERROR = 3.0
"""Largest error of the change of a second difference [counts]: readings with the weights 1, −2, 2 and −1."""


Forgive = Callable[[float], None]
"""Function that gets the energy [J] of torque beyond the set-points during a doubt, if the hand got it."""


def torque_echo(
    axis: AxisPlan, state: AxisState, period: float, trip: TripOff, forgive: Forgive
) -> "TorqueEcho | None":
    """Return the check of an echo that comes in each period; None if the drive has none."""
    echo = _echo_of(axis)
    return None if echo in (None, Signal.TARGET_ASKED) else TorqueEcho(axis, state, period, trip, forgive)


def bind_asked_echo(
    axis: AxisPlan, state: AxisState, period: float, trip: TripOff, forgive: Forgive, render: PeriodStep
) -> PeriodStep:
    """Return a step that compares a target that is read back with those in force between question and answer.

    Then it renders. It is `render` alone if none is read back.
    """
    if _echo_of(axis) is not Signal.TARGET_ASKED:
        return render
    doubt = EchoMismatch(axis, state, period, ECHO_STEPS, trip, forgive)
    sign, longest_ns = axis.rig.mechanism.sign, axis.limits.echo * 1e9
    place, asked = axis.place_of(Signal.TARGET_ASKED), axis.place_of(Signal.ASKED_PERIODS)
    # If set-points act at a SYNC, the set-point before the question may still have been in force.
    waits = axis.delay.transport > (1.0 - 1e-9) * period
    remembered = math.ceil(axis.limits.echo / period) + 1
    sent = deque([0] * remembered, maxlen=remembered)
    heard_ns: int | None = None

    def check() -> None:
        nonlocal heard_ns
        sent.appendleft(state.target)
        now = state.feedback
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


def _echo_of(axis: AxisPlan) -> Signal | None:
    """Return the signal in which set-points come back; None if there is none, or none is compared."""
    return None if math.isinf(axis.limits.echo) else axis.profile.echo


def bind_other_masters(axis: AxisPlan, state: AxisState, period: float, trip: TripOff) -> PeriodStep | None:
    """Return a step that counts set-points of another master; None if none can be detected.

    It must be called before `render`, while the state still has the last target sent.
    """
    shown_by = None if axis.other_masters is None else axis.other_masters.shown_by
    if shown_by is None:
        return None
    always = shown_by is not Signal.TARGET_ASKED
    # A target that is read back arrives in some periods only; any other value counts in every period.
    place, came = axis.place_of(shown_by), axis.place_of(Signal.STATUSWORD if always else Signal.ASKED_PERIODS)
    sign = axis.rig.mechanism.sign * _ratio(_shown_unit(axis, shown_by), axis)
    others = OtherMaster(axis, period, shown_by, trip)
    sent, tolerance, look = others.sent, others.tolerance, others.look

    def check() -> None:
        target = state.target
        sent.append(target)
        if state.steps:
            now = state.feedback
            shown = sign * now[place]
            if not -tolerance <= shown - target <= tolerance and (always or now[came]):
                look(now[T_NS], shown)

    return check


class OtherMaster:
    """Counter of the detected set-points of another master; values in steps of target torque."""

    def __init__(self, axis: AxisPlan, period: float, shown_by: Signal, trip: TripOff) -> None:
        limits, measured = axis.limits, shown_by is Signal.TORQUE_ACTUAL
        recent = recent_time(period, limits.age, axis.delay.torque_loop if measured else 0.0)
        self.sent = deque([0], maxlen=math.ceil(recent / period) + FEWEST_TARGETS)
        """Targets that the drive may still show, the last one at the end."""
        self.tolerance = FOREIGN_SHARE * axis.rated_effort / axis.effort_unit
        self._overshoot = OVERSHOOT if measured else 0.0
        self._unit, self._trip = axis.effort_unit, trip
        every = 1 if axis.other_masters is None else axis.other_masters.every
        self._apart_ns = 1e9 * (foreign_gap(period, every) - period)
        self._seen: deque[int] = deque(maxlen=FOREIGN_TIMES)

    def look(self, now_ns: int, shown: float) -> None:
        """Count the shown torque if it is none of our targets; trip if this happens often."""
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


class TorqueEcho:
    """Compares the echo of each period with the targets in force, behind the lag of the torque loop.

    A torque demand has no lag, but may be that of the nearer of two possible targets. Values in steps of target torque.
    """

    def __init__(self, axis: AxisPlan, state: AxisState, period: float, trip: TripOff, forgive: Forgive) -> None:
        echo = axis.profile.echo or Signal.TORQUE_ACTUAL
        measured, shown = echo is Signal.TORQUE_ACTUAL, _shown_unit(axis, echo)
        tolerance = ECHO_STEPS * max(1.0, shown / axis.effort_unit)
        if measured:
            tolerance = max(tolerance, ECHO_SHARE * axis.rated_effort / axis.effort_unit)
        lag, late = axis.delay.torque_loop if measured else 0.0, min(axis.delay.transport, period)
        # After the sample before, first the second last target was in force, then the last one.
        self.kept = math.exp(-period / lag) if measured else 0.0
        self.own = 1.0 - math.exp(-(period - late) / lag) if measured else 1.0
        self.older = 1.0 - self.own - self.kept
        """Weights in the expected torque: of the torque before, of the last and of the second last target."""
        self.torque = 0.0
        """Expected torque of the last period."""
        remembered = FEWEST_TARGETS - 1 + (math.ceil(LAGS * lag / period) if measured else 0)
        self.before = deque([0] * remembered, maxlen=remembered)
        """Targets before the last one, newest first."""
        self.place, self.ratio = axis.place_of(echo), axis.rig.mechanism.sign * _ratio(shown, axis)
        self.doubt = EchoMismatch(axis, state, period, tolerance, trip, forgive)
        waits = axis.delay.transport > (1.0 - 1e-9) * period and not axis.delay.acts_first
        self._waits, self._state = waits and not measured, state

    def bind(self, render: PeriodStep) -> PeriodStep:
        """Return a step that checks the echo and then renders: the state must still have the last target sent."""
        state, before, doubt, tolerance, waits = self._state, self.before, self.doubt, self.doubt.tolerance, self._waits
        kept, own, older, place, ratio, missed = self.kept, self.own, self.older, self.place, self.ratio, False

        def check() -> None:
            nonlocal missed
            sent = state.target
            self.torque = torque = kept * self.torque + older * before[0] + own * sent
            if missed or not state.steps:
                missed = not state.steps
            else:
                now = state.feedback
                shown = ratio * now[place]
                expected = before[0] if waits and abs(shown - before[0]) < abs(shown - sent) else torque
                if doubt.open or not -tolerance <= shown - expected <= tolerance:
                    doubt.look(now[T_NS], shown, expected, (sent, *before))
            before.appendleft(sent)
            render()

        return check


def _shown_unit(axis: AxisPlan, shown_by: Signal) -> float:
    """Return one step of the shown torque, in the workspace [N or N·m]."""
    units = {Signal.TORQUE_ACTUAL: axis.shown_unit, Signal.TORQUE_DEMAND: axis.demand_unit}
    return units.get(shown_by, axis.effort_unit)


def _ratio(unit: float, axis: AxisPlan) -> float:
    """Return the number of steps of the target in one step of the echo; the integer 1 if both have the same unit."""
    ratio = unit / axis.effort_unit
    return 1 if abs(ratio - 1.0) < 1e-9 else ratio


class EchoMismatch:
    """Doubt whether set-points act, which may become a trip; values in steps of target torque."""

    def __init__(
        self, axis: AxisPlan, state: AxisState, period: float, tolerance: float, trip: TripOff, forgive: Forgive
    ) -> None:
        self.tolerance = tolerance
        self.open = False
        self._state, self._trip, self._forgive = state, trip, forgive
        self._given = 0.0
        """Work of the motor during this doubt, minus the work of the torque sent [J]."""
        self._unit = axis.effort_unit
        self._period_ns = round(period * 1e9)
        # A sample that comes a little early still ends the deadline.
        self._deadline_ns = doubt_time(period) * 1e9 - self._period_ns // 2
        self._since_ns = self._differed_ns = 0
        self._stuck = 0.0

    def unanswered(self, waited_ns: int, sent: int) -> None:
        """Trip because the drive no longer answers with its target torque."""
        self._trip(TripKind.SET_POINTS_DEAD, math.nan, sent * self._unit, f"{waited_ns * 1e-6:.0f}")

    def look(self, now_ns: int, shown: float, expected: float, targets: Sequence[int]) -> None:
        """Raise, keep or end the doubt; trip when the drive still shows another torque after the deadline."""
        differs = abs(shown - expected) > self.tolerance
        if not self.open:
            self.open, self._stuck = True, shown
            # The target that the echo does not show was sent in the period before.
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
        """End the doubt, and forgive the energy that the hand got during it."""
        self.open, given, self._given = False, self._given, 0.0
        if given > 0.0:
            self._forgive(given)


def sign_watch(axis: AxisPlan, state: AxisState, period: float, doubt: Callable[[], None]) -> "SignWatch | None":
    """Return the watch, which calls `doubt`; None if the sign cannot be watched."""
    periods = _block(axis, period)
    return None if periods is None else SignWatch(axis, state, period, periods, doubt)


def _block(axis: AxisPlan, period: float) -> int | None:
    """Return the shortest block in which accelerations can be measured [periods]; None if there is none."""
    if axis.plant is None or not axis.plant.mass or virtual_mass(axis.elements) > HEAVIEST * axis.plant.mass:
        return None
    least = (WORST_ERROR * axis.plant.mass * axis.plant.resolution / (COARSENESS * axis.rated_effort)) ** 0.5
    periods = max(1, round(max(least, SHORTEST_BLOCK) / period + 0.49))
    return periods if periods * period <= LONGEST_BLOCK * (1.0 + 1e-9) else None


class SignWatch:
    """Sign watch of one axis: its sums S and N."""

    def __init__(
        self, axis: AxisPlan, state: AxisState, period: float, periods: int, doubt: Callable[[], None]
    ) -> None:
        self.agreement = self.excitation = 0.0
        """S and N, in steps of target torque squared."""
        self._state, self._doubt, self._periods = state, doubt, periods
        self.total, self.left = 0, periods
        """Sum of the targets of the present block, and the number of its periods to come."""
        length = periods * period
        mass = 0.0 if axis.plant is None else axis.plant.mass
        self._inertial = mass / length**2 / axis.effort_unit
        self._kept = math.exp(-length / MEMORY)
        strong = max(STRONG * axis.rated_effort, KNOCK[axis.workspace])
        self._strong = (strong / axis.effort_unit) ** 2
        self._places: deque[float] = deque(maxlen=5)
        """Positions of the handle at the begin of the last blocks."""
        self._torques: deque[float] = deque(maxlen=4)
        """Mean target torques of the last blocks."""

    def bind(self, render: PeriodStep) -> PeriodStep:
        """Return a step that renders, and adds up the torque of a block."""
        state, add = self._state, self.add

        def look() -> None:
            render()
            left = self.left
            if left and state.steps == 1:
                self.total += state.target
                self.left = left - 1
            else:
                add()

        return look

    def add(self) -> None:
        """End a block that is full, or drop one that a gap spoils; begin the next one with the target of a period."""
        if self._state.steps != 1:
            self._places.clear()
        else:
            self._block(self.total / self._periods)
        self.total, self.left = self._state.target, self._periods - 1

    def _block(self, torque: float) -> None:
        """End a block with this mean torque, in steps, and compare torque and motion."""
        self._torques.append(torque)
        self._places.append(self._state.position)
        if len(self._places) < 5 or self._state.permitted_ns is None:
            return
        oldest, old, _, late, last = self._places
        inertial = self._inertial * (last - 2.0 * late + 2.0 * old - oldest)
        first, second, third, fourth = self._torques
        change = 0.5 * (fourth + third - second - first)
        self.agreement = self._kept * self.agreement + inertial * change
        self.excitation = self._kept * self.excitation + change * change
        if self.excitation > self._strong and self.agreement < AGAINST * self.excitation:
            self.agreement = self.excitation = 0.0
            self._doubt()

"""Does the drive do what it was told? What was sent is compared with what it shows, and with how the handle moves.

Echo. A drive whose set-points are lost (its RPDO disabled by another tool, or frames that no longer reach it) holds its
last torque, while feedback and signs of life go on. The sign is that its echo does not follow:

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

Other masters. Where their set-points cannot be heard (Modbus), they are counted besides. Each acts until ours replaces
it, so that the echo is right again soon and no doubt lasts. What a drive shows is theirs when it is more than any of
our targets of late, in either direction, by more than a hand may be left alone with and an overshoot. Targets of late
are those of a whole deadline and of the age at which feedback is a trip: set-points that were lost, a torque loop with
a lag, and a gateway that answers with what is a period old, show one of them. Less torque than was sent is no sign of
another master: a drive at the limit of its current or its supply gives less, too.

Sign watch. A change of torque must show in the acceleration while the scene runs.

In a scene torque answers motion, so that torque and position go together whatever the sign is. What differs is how
fast hands are. Within blocks of 5 ms a hand changes its force little, while contact changes the torque much. With the
mean torque u and the mean acceleration a of two blocks, and their changes δu and δa from one pair of blocks to the
next,

    S = Σ m·δa·δu,   N = Σ δu²     (m: mass of the bench; the sums forget within 0.1 s)

S/N is the share of a change of torque that shows in the motion: 1 for a free handle, less where a hand adds its mass,
−1 when the sign has turned. When S/N is below −½ and N is that of strong contact, the sign is in doubt: from then on
no more is permitted than a hand may hold, and pulses look for the sign again (`cycle.sign`). A wrong one ends the
run. A blow of a hand raises the same doubt, because it changes its force against the torque by more than the torque
changes; then the sign is seen, and the force rises again. Of the shipped hands none does
(`tests/system/test_sign.py`).

This is no proof that the sign is right. It is there for what happens later, such as a drive that is turned round by
another tool. There is none where a count is too coarse for an acceleration within a block, or a period too long, nor
where the scene itself answers acceleration: a virtual mass gives torque against every knock of a hand.
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
"""After so many time constants of the torque loop a target counts as reached."""
FEWEST_TARGETS = 3
"""Of the last targets that an echo may agree with: acting on reception or at a SYNC, and one frame that was lost."""
SHORTEST_BLOCK, LONGEST_BLOCK = 0.005, 0.01
"""[s]"""
COARSENESS = 0.05
"""Share of rated torque that the encoder may be off by within a block."""
MEMORY = 0.1
"""[s] after which the sums have forgotten all but 1/e."""
STRONG = 0.1
KNOCK = {Workspace.LINEAR: 5.0, Workspace.ROTARY: 0.25}
"""Share of rated torque, and half the knock of a hand [N or N·m]: √N counts above both."""
AGAINST = -0.5
"""S/N below which the motion goes against the torque."""
HEAVIEST = 0.05
"""Mass that the scene may add, as a share of that of the bench."""
WORST_ERROR = 3.0
"""Counts by which the change of a second difference may be off: readings with the weights 1, −2, 2 and −1."""


def bind_echo(
    axis: AxisPlan,
    state: AxisState,
    period: float,
    trip: TripOff,
    forgive: Callable[[float], None],
    render: PeriodStep,
) -> PeriodStep:
    """Return a step that checks the echo and then renders; `render` alone when the drive shows nothing of its targets.

    The check comes first, while the state still has the target that was sent last. `forgive` takes the energy that was
    given beyond what was sent while there was a doubt [J].
    """
    echo = axis.profile.echo
    if echo is None or math.isinf(axis.limits.echo):
        return render
    place = axis.place_of(echo)
    lags = echo is Signal.TORQUE_ACTUAL
    shown = _shown_unit(axis, echo)
    tolerance = ECHO_STEPS * max(1.0, shown / axis.effort_unit)
    if lags:
        tolerance = max(tolerance, ECHO_SHARE * axis.rated_effort / axis.effort_unit)
    doubt = EchoMismatch(axis, state, period, tolerance, trip, forgive)
    bind = _bind_asked if echo is Signal.TARGET_ASKED else _bind_actual if lags else _bind_demand
    return bind(axis, state, period, place, doubt, render)


def bind_other_masters(
    axis: AxisPlan, state: AxisState, period: float, trip: TripOff, render: PeriodStep
) -> PeriodStep:
    """Return a step that counts set-points of another master, then renders; `render` alone where none can be seen."""
    shown_by = None if axis.other_masters is None else axis.other_masters.shown_by
    if shown_by is None:
        return render
    always = shown_by is not Signal.TARGET_ASKED
    # A target that is read back comes in some periods only; a value without it counts in every period.
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
    axis: AxisPlan, state: AxisState, period: float, place: int, doubt: "EchoMismatch", render: PeriodStep
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
            now = state.feedback
            shown = sign * now[place]
            expected = before[0] if waits and abs(shown - before[0]) < abs(shown - sent) else sent
            if doubt.open or not -tolerance <= shown - expected <= tolerance:
                doubt.look(now[T_NS], shown, expected, (sent, *before))
        before.appendleft(sent)
        render()

    return check


def _bind_asked(
    axis: AxisPlan, state: AxisState, period: float, place: int, doubt: "EchoMismatch", render: PeriodStep
) -> PeriodStep:
    """Compare an answer with the targets that were in force between question and answer."""
    sign, longest_ns = axis.rig.mechanism.sign, axis.limits.echo * 1e9
    asked = axis.place_of(Signal.ASKED_PERIODS)
    # Where set-points act at a SYNC, the one before the question may still have been in force.
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


def _bind_actual(
    axis: AxisPlan, state: AxisState, period: float, place: int, doubt: "EchoMismatch", render: PeriodStep
) -> PeriodStep:
    """Compare with the target that must be in force by now, after the lag of the torque loop."""
    sign, tolerance = axis.rig.mechanism.sign * _ratio(axis.shown_unit, axis), doubt.tolerance
    lag = axis.delay.torque_loop
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
            now = state.feedback
            shown = sign * now[place]
            if doubt.open or not -tolerance <= shown - torque <= tolerance:
                doubt.look(now[T_NS], shown, torque, (sent, *before))
        before.appendleft(sent)
        render()

    return check


def _shown_unit(axis: AxisPlan, shown_by: Signal) -> float:
    """Return one step of what the drive shows, in the workspace [N or N·m]."""
    units = {Signal.TORQUE_ACTUAL: axis.shown_unit, Signal.TORQUE_DEMAND: axis.demand_unit}
    return units.get(shown_by, axis.effort_unit)


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


def bind_sign_watch(
    axis: AxisPlan, state: AxisState, period: float, doubt: Callable[[], None], render: PeriodStep
) -> PeriodStep:
    """Return a step that renders and watches the sign, and calls `doubt`; `render` alone where it cannot be seen."""
    periods = _block(axis, period)
    return render if periods is None else SignWatch(axis, state, period, periods, doubt).bind(render)


def _block(axis: AxisPlan, period: float) -> int | None:
    """Return the shortest block in which accelerations are seen [periods]; None where none is."""
    if axis.plant is None or not axis.plant.mass or virtual_mass(axis.elements) > HEAVIEST * axis.plant.mass:
        return None
    least = (WORST_ERROR * axis.plant.mass * axis.plant.resolution / (COARSENESS * axis.rated_effort)) ** 0.5
    periods = max(1, round(max(least, SHORTEST_BLOCK) / period + 0.49))
    return periods if periods * period <= LONGEST_BLOCK * (1.0 + 1e-9) else None


class SignWatch:
    """The sums of one axis."""

    def __init__(
        self, axis: AxisPlan, state: AxisState, period: float, periods: int, doubt: Callable[[], None]
    ) -> None:
        self.agreement = self.excitation = 0.0
        """S and N, in steps of target torque squared."""
        self._state, self._doubt, self._periods = state, doubt, periods
        length = periods * period
        mass = 0.0 if axis.plant is None else axis.plant.mass
        self._inertial = mass / length**2 / axis.effort_unit
        self._kept = math.exp(-length / MEMORY)
        strong = max(STRONG * axis.rated_effort, KNOCK[axis.workspace])
        self._strong = (strong / axis.effort_unit) ** 2
        self._places: deque[float] = deque(maxlen=5)
        """Of the handle at the begin of the last blocks."""
        self._torques: deque[float] = deque(maxlen=4)
        """Mean target torques of the last blocks."""

    def bind(self, render: PeriodStep) -> PeriodStep:
        """Return a step that renders, and adds up the torque of a block."""
        state, periods, block = self._state, self._periods, self._block
        total, left = 0, periods

        def look() -> None:
            nonlocal total, left
            render()
            if state.steps != 1:
                self._places.clear()
                total, left = 0, periods
            elif not left:
                block(total / periods)
                total, left = 0, periods
            total += state.target
            left -= 1

        return look

    def _block(self, torque: float) -> None:
        """Take the mean torque of the block that ends here, in steps, and compare."""
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

"""Effect of feedback gaps on the law of a scene, and the number of gaps that the loop tolerates.

A gap is two or more missing samples. The law of the scene pauses in it: when feedback returns, the law goes on from
the place y at which it was before, and the scene stands beside its place by the shift

    δ = x − y   (x: where the handle is)

The law then has not seen the way of the handle in the gap, so it can give back nothing for that way. While the force
that faded comes back at its slew, it goes on pausing on the way against its force, which would otherwise store more
than the hand brings in. After that y moves as the handle does, and is drawn back to x
where the law itself does not resist that, F(y)·δ ≥ 0: there the energy that it stores falls or stays, and nobody is
given it. A law that depends on the present motion alone is drawn back in steps no longer than the mean motion of a
period, and is asked for its force at rest at both ends of each step. Where an element has a memory, all are drawn back
by at most the motion of the period, and its present force is added. Two kinds of forces have no say: those that do not
depend on the place, such as weight, and friction, which opposes the motion of y and with it that of x. The proof that
no energy comes of this stands in `docs/explanation/stability.md`.

|δ| has a bound (`planning.limits.LARGEST_SHIFT`). Beyond that, as after a long gap, the force before the gap is the cap
(`cycle.safety`). While the cap cuts the force, y pauses too on the way against it: the law would take up energy for
which the hand has not paid.

Force is held between two samples, and a held force grows old. A spring K gives more energy in a gap of s periods than
in s single periods, by ½·K·T²·(s² − s)·v² at the speed v. Gaps may fall where the handle is fastest, once in each half
turn of its motion, and then each of them finds twice the mean of v². So gaps divide the limit of the stiffness by

    stretch = 1 + Σ(s² − s)/Σs/a   (s: periods between two samples, a: mean age of the force, ½ + td/T + λ/T)

at most, whatever their timing; the proof is in `margins.linear`. Without delay a is ½, and gaps that come at any time
cost half of it, Σs²/Σs. Two axes that a coupling ties together move in modes, which diagonalise the stiffness: the work
of both held torques is the sum of that of the modes, and the bound is that of each.

The loop is given up when the stretch is above `AxisPlan.largest_stretch`, or when more than a fifth of the samples is
missing. The stretch is that of the last second. Of rare gaps it is that from the third last one to the last one: one or
two gaps are no pattern, because after them the handle comes to rest again.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence

from haptic_fieldbus.cycle.laws import Field
from haptic_fieldbus.cycle.safety import Permission
from haptic_fieldbus.planning.limits import LARGEST_MISSING_SHARE

WINDOW = 1.0
"""[s]; the share of missing samples is that of a window."""
FEWEST_PERIODS = 20
FEWEST_GAPS = 3
"""So many gaps are a pattern."""
MOST_STEPS = 16
"""Of drawing the law back within a period."""


class LawPlace:
    """Keeps the place at which the law of one axis is asked: where the handle is, or beside it after gaps.

    `bounds` are the smallest shift that counts and the largest that is permitted [m or rad]. `resting` returns the
    force at rest at a place of the elements without memory, two of them during a change, between which it lies.
    `present` returns the force of those with a memory in the last period; None where there are none.
    """

    def __init__(
        self,
        permission: Permission,
        bounds: tuple[float, float],
        resting: Callable[[], Sequence[Field]],
        present: Callable[[], float] | None,
    ) -> None:
        self._permission, (self._least, self._largest) = permission, bounds
        self._resting, self._present = resting, present
        self._clipped = 0
        """Periods in which a limit had cut the force when it was looked at last."""
        self.moved: Callable[[float], None] = lambda before: None
        """Tells the energy ledger the shift before one by which the law was drawn back; the cycle sets it."""

    def follow(self, here: float, way: float, steps: int) -> None:
        """Take in that the handle came `here` by a `way` [m or rad] within so many periods, after a gap."""
        permission = self._permission
        cut, self._clipped = permission.capped and permission.clipped != self._clipped, permission.clipped
        in_gap = permission.pauses and not permission.returning
        if in_gap or ((permission.pauses or cut) and not self._pushes(here - way, way)):
            permission.shift += way
        before = permission.shift
        if before:
            self._draw_back(here, abs(way) / steps)
        if permission.shift != before:
            self.moved(before)
        permission.astray = abs(permission.shift) > self._largest
        if permission.astray and not permission.capped:
            permission.give_up_place()
        permission.beside = permission.blind or permission.shift != 0.0 or permission.capped
        permission.gaps.shifted += permission.shift != 0.0
        permission.gaps.farthest = max(permission.gaps.farthest, abs(permission.shift))

    def _draw_back(self, here: float, step: float) -> None:
        """Draw the law back towards the handle by steps of this length [m or rad] while it does not resist."""
        permission = self._permission
        if step == 0.0 or self._resists(here - permission.shift):
            return
        for _ in range(MOST_STEPS if self._present is None else 1):
            nearer = self._nearer(step)
            if self._resists(here - nearer):
                step *= 0.5  # so that it ends at the edge of what resists
            else:
                permission.shift = nearer
                if not nearer:
                    return

    def _resists(self, place: float) -> bool:
        """Return whether the force at a place is against drawing the law back."""
        shift = self._permission.shift
        return any(force * shift < 0.0 for force in self._forces(place))

    def _pushes(self, before: float, way: float) -> bool:
        """Return whether the law pushed the handle on its way [m or rad]: what it stores then falls on that way."""
        return all(force * way > 0.0 for force in self._forces(before - self._permission.shift))

    def _forces(self, place: float) -> list[float]:
        """Return the forces between which that of the law at a place lies [N or N·m]."""
        force = 0.0 if self._present is None else self._present()
        return [field(place) + force for field in self._resting()]

    def _nearer(self, step: float) -> float:
        """Return a shift that is smaller by a step."""
        shift = self._permission.shift
        size = abs(shift) - step
        return math.copysign(size, shift) if size > self._least else 0.0


class Gaps:
    """The gaps of the last second; `age` is the mean age of the force in periods, `largest` the largest stretch.

    Axes that couplings tie together share one, because a gap of one holds the torque of all.
    """

    def __init__(self, period: float, age: float, largest: float) -> None:
        self._periods = max(FEWEST_PERIODS, round(WINDOW / period))
        self._period_ns = period * 1e9
        self._window_ns = round(self._periods * self._period_ns)
        self._age, self._largest = age, largest
        self._gaps: deque[tuple[int, int]] = deque()
        self._last: deque[tuple[int, int]] = deque(maxlen=FEWEST_GAPS)
        """The last gaps, however long ago: time and s² − s."""
        self._missing = 0
        self._surplus = 0
        """Σ(s² − s) over the gaps."""

    def note(self, t_ns: int, steps: int) -> None:
        """Count a sample that came `steps` periods after the one before; `steps` is 2 or more.

        Of the gaps of several axes that end together the longest counts.
        """
        gaps = self._gaps
        if gaps and gaps[-1][0] == t_ns:
            if steps <= gaps[-1][1]:
                return
            self._forget(*gaps.pop())
            self._last.pop()
        gaps.append((t_ns, steps))
        self._last.append((t_ns, steps * (steps - 1)))
        self._missing += steps - 1
        self._surplus += steps * (steps - 1)
        while gaps[0][0] < t_ns - self._window_ns:
            self._forget(*gaps.popleft())

    def _forget(self, t_ns: int, steps: int) -> None:
        self._missing -= steps - 1
        self._surplus -= steps * (steps - 1)

    @property
    def tolerance(self) -> float:
        """Largest Σ(s² − s)/Σs, by which the mean age of the force may grow [periods]."""
        return (self._largest - 1.0) * self._age

    @property
    def share(self) -> float:
        """Share of the window's samples that are missing."""
        return self._missing / self._periods

    @property
    def stretch(self) -> float:
        """Factor by which the gaps divide the stiffness limit at the worst timing."""
        surplus, periods = self._surplus, float(self._periods)
        if len(self._gaps) < FEWEST_GAPS == len(self._last):  # from the end of the first of them on
            (first_ns, _), (_, second), (last_ns, third) = self._last
            surplus, periods = second + third, (last_ns - first_ns) / self._period_ns
        return 1.0 + surplus / (periods * self._age)

    @property
    def too_many(self) -> bool:
        """Whether the loop is to be given up."""
        if self.share > LARGEST_MISSING_SHARE:
            return True
        return len(self._last) >= FEWEST_GAPS and self.stretch > self._largest

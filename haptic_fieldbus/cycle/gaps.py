"""Effect of feedback gaps on the law of a scene, and the number of gaps that the loop tolerates.

A gap is two or more missing samples. In a gap the law of the scene pauses: when feedback returns, the law goes on from
its place y before the gap. The scene is then shifted by

    δ = x − y   (x: where the handle is)

The law does not follow the motion of the handle in the gap, so it gives back no energy for this motion. After the gap
the faded force comes back with the slew limit. Meanwhile the law still pauses on motion against its force, because it
would otherwise store more energy than the hand brings in. After that y moves with the handle, and is drawn back to x
wherever the law does not resist, F(y)·δ ≥ 0: there its stored energy falls or stays constant, and the handle does not
get it. A law that depends on the present motion alone is drawn back in steps no longer than the mean motion of a
period, and its force at rest is checked at both ends of each step. If an element has a memory, the law is drawn back by
at most the motion of the period, and the present force of the element is added in the check. Two kinds of forces do not
count in the check: forces that do not depend on the place, such as weight; and friction, which opposes the motion of y
and therefore that of x. `docs/explanation/stability.md` has the proof that this generates no energy.

|δ| has a bound (`planning.limits.LARGEST_SHIFT`). Above this bound, and after a long gap, the force before the gap is
the cap (`cycle.safety`). While the cap cuts the force, y also pauses on motion against the force: otherwise the law
would store energy that the hand did not bring in.

Force is held between two samples, and a held force gets older. A spring K gives more energy in a gap of s periods than
in s single periods, by ½·K·T²·(s² − s)·v² at the speed v. If each gap comes where the handle is fastest, once in each
half cycle of its motion, v² is twice its mean in all of them. Gaps therefore divide the stiffness limit by

    stretch = 1 + Σ(s² − s)/Σs/a   (s: periods between two samples, a: mean age of the force, ½ + td/T + λ/T)

at most, whatever their timing; the proof is in `margins.linear`. Without delay a is ½, and gaps at random times cost
half of it, Σs²/Σs. Two coupled axes move in modes, which diagonalise the stiffness. The work of both held torques is
the sum of the work of the modes, and each mode has this bound.

The loop trips when the stretch is above `AxisPlan.largest_stretch`, or when more than a fifth of the samples is
missing. The stretch is computed over the last second. If gaps are rarer, it is computed from the third last gap to the
last one: one or two gaps are no pattern, because the handle comes to rest after them.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence

from haptic_fieldbus.cycle.laws import Field
from haptic_fieldbus.cycle.safety import Permission
from haptic_fieldbus.planning.limits import LARGEST_MISSING_SHARE

WINDOW = 1.0
"""Window in which the share of missing samples is counted [s]."""
FEWEST_PERIODS = 20
FEWEST_GAPS = 3
"""Smallest number of gaps that counts as a pattern."""
MOST_STEPS = 16
"""Largest number of steps in a period by which the law is drawn back."""


class LawPlace:
    """Place at which the law of one axis is evaluated: the position of the handle, or a shifted position after gaps.

    `bounds` are the smallest shift that counts and the largest that is permitted [m or rad]. `resting` returns the
    fields of the force at rest of the elements without memory; during a change two fields, between which the force
    lies. `present` returns the force of the elements with a memory in the last period; None if there are none.
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
        """`Permission.clipped` at the last call: periods in which a limit cut the force."""
        self.moved: Callable[[float], None] = lambda before: None
        """Tells the energy ledger the shift before the law was drawn back; the cycle sets it."""

    def follow(self, here: float, way: float, steps: int) -> None:
        """Follow the handle to `here` by the motion `way` [m or rad] within `steps` periods, after a gap."""
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
                step *= 0.5  # to end at the edge of the resisting places
            else:
                permission.shift = nearer
                if not nearer:
                    return

    def _resists(self, place: float) -> bool:
        """Return whether the force at a place resists drawing the law back."""
        shift = self._permission.shift
        return any(force * shift < 0.0 for force in self._forces(place))

    def _pushes(self, before: float, way: float) -> bool:
        """Return whether the law pushed along the motion `way` [m or rad]: its stored energy then falls."""
        return all(force * way > 0.0 for force in self._forces(before - self._permission.shift))

    def _forces(self, place: float) -> list[float]:
        """Return forces between which the force of the law at a place lies [N or N·m]."""
        force = 0.0 if self._present is None else self._present()
        return [field(place) + force for field in self._resting()]

    def _nearer(self, step: float) -> float:
        """Return a shift that is smaller by a step."""
        shift = self._permission.shift
        size = abs(shift) - step
        return math.copysign(size, shift) if size > self._least else 0.0


class Gaps:
    """The gaps of the last second; `age` is the mean age of the force in periods, `largest` the largest stretch.

    Coupled axes share one object, because a gap of one axis holds the torque of all.
    """

    def __init__(self, period: float, age: float, largest: float) -> None:
        self._periods = max(FEWEST_PERIODS, round(WINDOW / period))
        self._period_ns = period * 1e9
        self._window_ns = round(self._periods * self._period_ns)
        self._age, self._largest = age, largest
        self._gaps: deque[tuple[int, int]] = deque()
        self._last: deque[tuple[int, int]] = deque(maxlen=FEWEST_GAPS)
        """Time and s² − s of the last gaps, of any age."""
        self._missing = 0
        self._surplus = 0
        """Σ(s² − s) over the gaps."""

    def note(self, t_ns: int, steps: int) -> None:
        """Count a sample that came `steps` periods after the one before; `steps` is 2 or more.

        If gaps of several axes end together, the longest counts.
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
        """Largest permitted Σ(s² − s)/Σs, the growth of the mean age of the force [periods]."""
        return (self._largest - 1.0) * self._age

    @property
    def share(self) -> float:
        """Share of the window's samples that are missing."""
        return self._missing / self._periods

    @property
    def stretch(self) -> float:
        """Factor by which the gaps divide the stiffness limit at the worst timing."""
        surplus, periods = self._surplus, float(self._periods)
        if len(self._gaps) < FEWEST_GAPS == len(self._last):  # from the end of the first gap on
            (first_ns, _), (_, second), (last_ns, third) = self._last
            surplus, periods = second + third, (last_ns - first_ns) / self._period_ns
        return 1.0 + surplus / (periods * self._age)

    @property
    def too_many(self) -> bool:
        """Whether the loop must trip."""
        if self.share > LARGEST_MISSING_SHARE:
            return True
        return len(self._last) >= FEWEST_GAPS and self.stretch > self._largest

"""Stability check of elements that state no bounds: their force is sampled over the travel of the handle.

A shipped element states bounds of its slope between any two positions (`scenes.element`). An element of another package
may state only its force and `linearised`, and the two may disagree. Its force is therefore sampled at places of the
whole travel: the force at rest, the slope to either side, and the change per speed. The places are spaced unevenly, so
that a periodic force cannot hide between them. Where force or slope changes, the intervals are halved, down to the step
of a difference quotient. A place counts if the force at rest is at most the effort limit.

Sampling proves nothing between two places. The verdict on such a law is "stable" at best, never "passive". The linear
model of `linearised` is judged too, and counts wherever it is stiffer.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.margins.closed_loop import keeping
from haptic_fieldbus.margins.stiffness_map import OwnLaw
from haptic_fieldbus.scenes.element import Interval, Local, abilities, is_dynamic, is_sampled, is_shipped, is_varying
from haptic_fieldbus.signals import Signal

Array = NDArray[np.float64]
FURTHEST = 1e4
"""Largest position that is sampled when the travel has no limit [m or rad]."""
NEAR = 2.0 * math.pi
"""Largest position of dense sampling in a travel without limits [m or rad]: a turn to either side."""
MANY, FEW = 768, 96
"""Number of places of the first sampling, and of each further sampling with another stiffness of the same element."""
MORE = {MANY: 768, FEW: 160}
"""Largest number of places that are added by halving."""
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
STEP, SPEED = 1e-7, 1e-6
"""Steps of difference quotients: a share of |position|, at least of 1 [m or rad]; and a speed [m/s, rad/s]."""
ROUNDING = 64 * 2.0**-52
"""Share of a force below which a difference is rounding."""
GROWS = 1.5
"""Force at `FURTHEST` divided by the force at a tenth of this distance; a push above this ratio grows without bound."""
UNBOUNDED = Local((-math.inf, math.inf), (-math.inf, math.inf), math.inf)
UNREAD = Local((math.nan, math.nan), (math.nan, math.nan))


@dataclass(frozen=True, eq=False)
class SampledLaw:
    """Sampled force of an element without bounds, with the methods of `Varying`; sampling begins at `start`."""

    element: Any
    start: tuple[float, ...] = ()
    _read: dict[float, Local] = field(default_factory=dict)
    _found: dict[tuple[float, float, float], tuple[float, ...]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return str(self.element.name)

    @property
    def axis(self) -> str:
        return str(self.element.axis)

    @property
    def needs(self) -> tuple[Signal, ...]:
        return tuple(self.element.needs)

    def linearised(self) -> Any:
        return self.element.linearised()

    def local(self, lower: float, upper: float) -> Local:
        """Return force, stiffness and damping at one place; between two places nothing is known."""
        return self.at(lower) if lower == upper else UNBOUNDED

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return the sampled places within the travel, closest together where force or slope changes."""
        asked = lower, upper, effort
        if asked not in self._found:
            (lower, upper), few = reach(*asked), FEW if self.start else MANY
            places = sorted({*uneven(lower, upper, few), *(each for each in self.start if lower <= each <= upper)})
            places = [each for each in places if math.isfinite(self.at(each).force[0])]
            most = len(places) + MORE[few]
            while 1 < len(places) < most and (more := self._halved(places, effort, most - len(places))):
                places = sorted({*places, *more})
            self._found[asked] = tuple(places)
        return self._found[asked]

    def at(self, place: float) -> Local:
        """Return force, slopes to both sides, and damping for a handle at rest; not-a-number without a force."""
        if place not in self._read:
            self._read[place] = self._felt(place)
        return self._read[place]

    def _felt(self, place: float) -> Local:
        force, step = self._force, STEP * max(1.0, abs(place))
        x = place - step, place, place + step
        before, here, after = (force(each, 0.0) for each in x)
        slopes = [_quotient(before, here, x[1] - x[0]), _quotient(here, after, x[2] - x[1])]
        slopes = [each for each in slopes if math.isfinite(each)]
        if not slopes or not math.isfinite(here):
            return UNREAD
        # On the surface of a contact the damping is that of its inside.
        damping = max((self._damping(each) for each in x), key=abs) if Signal.VELOCITY in self.element.needs else 0.0
        return Local((here, here), (min(slopes), max(slopes)), damping)

    def _damping(self, place: float) -> float:
        """Return the change of the force per speed of a handle at rest, the larger of both directions."""
        force = self._force
        back, here, on = force(place, -SPEED), force(place, 0.0), force(place, SPEED)
        found = [_quotient(back, here, SPEED), _quotient(here, on, SPEED)]
        return max((each for each in found if math.isfinite(each)), key=abs, default=0.0)

    @cached_property
    def _force(self) -> Callable[[float, float], float]:
        """Position and velocity → force; not-a-number where the law gives no number."""
        # A copy: sampling must not change the run, even if a force wrongly keeps a state, such as a count of its calls.
        law, needs = copy(self.element).force, self.element.needs

        def force(position: float, velocity: float) -> float:
            values = [position if each is Signal.POSITION else velocity for each in needs]
            try:
                return float(law(*values))
            except (ArithmeticError, ValueError, TypeError) as error:
                if isinstance(error, TypeError) and "complex" not in str(error):
                    raise
                return math.nan

        return force

    def _halved(self, places: Sequence[float], effort: float, most: int) -> list[float]:
        """Return the middles of the intervals with the largest changes of force or slope, at most `most`."""
        x = np.array(places)
        read = [self.at(each) for each in places]
        force = np.array([each.force[0] for each in read])
        low, high = np.array([each.stiffness for each in read]).T
        limit = effort if math.isfinite(effort) else float(np.abs(force).max(initial=0.0))
        cut = np.clip(force, -1.1 * limit, 1.1 * limit)
        within = np.minimum(np.abs(force[1:]), np.abs(force[:-1])) <= limit
        held = np.abs(force) <= limit
        steepest = float(np.maximum(np.abs(low), np.abs(high))[held].max(initial=0.0))
        turns = np.maximum(np.abs(low[1:] - high[:-1]), np.abs(high[1:] - low[:-1]))
        turns = np.where(turns < 4.0 * steepest, turns / (steepest or 1.0), np.where(turns > 0.0, 4.0, 0.0))
        change = np.maximum(np.abs(np.diff(cut)) / max(limit, 1e-300) * 16.0, turns * 16.0)
        change[held[1:] != held[:-1]] *= 10.0  # the steepest place is often the last one that the motor holds
        crosses = (np.abs(np.diff(cut)) > 0.0) | within
        (rows,) = np.nonzero((change > 1.0) & crosses & (np.diff(x) > STEP * np.maximum(1.0, np.abs(x[1:]))))
        rows = rows[np.argsort(change[rows])[::-1]][: min(most, max(len(places) // 4, 8))]
        return [0.5 * (places[row] + places[row + 1]) for row in rows.tolist()]


_kept = keeping(128, SampledLaw)


def read(element: Any, start: tuple[float, ...] = ()) -> SampledLaw:
    """Return the sampled law of an element; the samples of an equal element are reused."""
    return _kept(element, start)


def _quotient(before: float, after: float, step: float) -> float:
    """Return −ΔF/step, 0 where the difference is rounding."""
    change = before - after
    return 0.0 if abs(change) <= ROUNDING * max(abs(before), abs(after)) else change / step


def reach(lower: float, upper: float, effort: float) -> Interval:
    """Return the travel to sample: without a limit to `FURTHEST`, or to `NEAR` if the motor has no limit either."""
    far = FURTHEST if math.isfinite(effort) else NEAR
    return max(lower, -far) if math.isinf(lower) else lower, min(upper, far) if math.isinf(upper) else upper


def uneven(lower: float, upper: float, count: int) -> Iterable[float]:
    """Yield unevenly spaced places from edge to edge; of a long travel most lie near position 0."""
    yield lower
    yield upper
    near = max(lower, -NEAR), min(upper, NEAR)
    if near[0] < near[1]:
        yield from (near[0] + (near[1] - near[0]) * ((number + 0.5) * GOLDEN % 1.0) for number in range(count))
    for sign, far in ((-1.0, -lower), (1.0, upper)):
        if far > NEAR:
            yield from (sign * NEAR * (far / NEAR) ** ((number + GOLDEN) / 48.0) for number in range(47))
    if lower < 0.0 < upper:
        yield 0.0


def thinned(law: SampledLaw, travel: Interval, effort: float) -> tuple[float, ...]:
    """Return the places with which a further sampling begins: some of the last one, with its steepest and flattest."""
    places = law.places(*travel, effort)
    kept = {places[row] for row in np.linspace(0, len(places) - 1, min(FEW, len(places))).round().astype(int)}
    by_slope = sorted(places, key=lambda place: law.at(place).stiffness[1])
    return tuple(sorted({*kept, *by_slope[:4], *by_slope[-16:]}))


def runs_off(elements: Sequence[Any], travel: Interval) -> bool:
    """Return whether a force of position pushes the handle away, ever more strongly, in a direction without a limit."""
    laws = [read(each) for each in elements if _is_static(each)]
    for sign, end in ((-1.0, -travel[0]), (1.0, travel[1])):
        places = [sign * float(place) for place in np.geomspace(0.1 * FURTHEST, FURTHEST, 12)]
        pushes = [sign * sum(law.at(place).force[0] for law in laws) for place in places]
        if math.isinf(end) and pushes == sorted(pushes) and pushes[-1] > GROWS * pushes[0] > 0.0:
            return True
    return False


def own_laws(elements: Sequence[Any], travel: Interval, effort: float) -> tuple[OwnLaw, ...]:
    """Return the stability check of each element that states no bounds."""
    off = runs_off(elements, travel)
    return tuple(_own_law(each, travel, effort, off) for each in elements if _is_told(each, off))


def _is_told(element: Any, runs_off: bool) -> bool:
    is_own = not is_shipped(element)
    return is_sampled(element) or (is_own and (not _is_bounded(element) or (runs_off and _is_static(element))))


def _own_law(element: Any, travel: Interval, effort: float, runs_off: bool) -> OwnLaw:
    space = element.linearised()
    stated = -float(space.d[0, 0])
    beyond = tuple(each.value for each in element.needs if each is not Signal.POSITION)
    law = read(element)
    places = law.places(*travel, effort) if _is_static(element) else ()
    if not places:
        remembers = () if hasattr(type(element), "force") else ("memory",)
        return OwnLaw(element.name, 0, travel, math.nan, math.nan, stated, (*remembers, *beyond), False)
    held = [place for place in places if abs(law.at(place).force[0]) <= effort] or list(places)
    at = max(held, key=lambda place: law.at(place).stiffness[1])
    ends = reach(*travel, effort)
    return OwnLaw(element.name, len(places), ends, law.at(at).stiffness[1], at, stated, beyond, runs_off)


def _is_bounded(element: Any) -> bool:
    """Return whether an element states its stiffness and damping at all places and phases, or is linear."""
    if is_varying(element) or is_dynamic(element) or hasattr(type(element), "increments"):
        return True
    return bool(abilities(element).phases) or not element.needs


def _is_static(element: Any) -> bool:
    needs = {*element.needs}
    return hasattr(type(element), "force") and bool(needs) and needs <= {Signal.POSITION, Signal.VELOCITY}

"""An environment at all places where the handle may rest, for the eigenvalues of one period.

At each place the elements without memory are a spring K and a damper B; those with memory or virtual states act in
parallel, in every combination of sticking and sliding, touching and not touching. The matrix of the loop depends
linearly on K and B, so three matrices give the matrices of all places.

At a place with K < 0 the force pushes the handle away: the crest between two detents, the edge of a magnet. There even
the ideal scene is unstable: with the positive root s of m·s² + (b + B)·s + K = 0 a motion grows by e^(s·T) in a period,
and no loop can hold the handle. The report shows both growths, of the loop and of the ideal scene. The place counts as
unstable only if another eigenvalue is.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.margins.linear import crossings
from haptic_fieldbus.margins.passivity import Increments
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.numerics.sampled import SampledPlant, estimated
from haptic_fieldbus.scenes.element import CouplingElement, Interval, Varying

# All places of an axis: force, stiffness and damping of its elements without memory, at places and between them.
#
# A single stiffness does not describe a contact that stiffens with depth, a magnet, or stops beside detents. `survey`
# asks every element for its bounds (`scenes.element`) at a set of places, and on the intervals between neighbours. The
# places are the possible equilibria, for the eigenvalues. The intervals cover the whole travel, also an unlimited one.
# They bound slope and damping for the proof of passivity (`margins.passivity`).
#
# A place counts if the force at rest is at most the effort limit: beyond it the force of the motor is constant, with
# the slope 0.

Array = NDArray[np.float64]
EVERYWHERE: Interval = (-math.inf, math.inf)
"""Travel without limits."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Bounds on each of n intervals, or at n places; a row for each element, shape (elements, n)."""

    least_force: Array
    most_force: Array
    least_stiffness: Array
    most_stiffness: Array
    damping: Array
    loss: Array

    def scaled(self, row: int, factor: float) -> "Survey":
        """Return the same with `factor` times the force of one element."""
        by = np.ones((len(self.loss), 1))
        by[row] = factor
        forces = {"least_force": by * self.least_force, "most_force": by * self.most_force}
        slopes = {"least_stiffness": by * self.least_stiffness, "most_stiffness": by * self.most_stiffness}
        return replace(self, **forces, **slopes)

    @cached_property
    def smallest_force(self) -> Array:
        """Smallest magnitude of the force of all elements together, (n,)."""
        low, high = self.least_force.sum(axis=0), self.most_force.sum(axis=0)
        return np.asarray(np.maximum(np.maximum(low, -high), 0.0), dtype=np.float64)

    @cached_property
    def one_sided(self) -> NDArray[np.bool_]:
        """True where all elements push in the same direction, (n,)."""
        same = (self.least_force >= 0.0).all(axis=0) | (self.most_force <= 0.0).all(axis=0)
        return np.asarray(same, dtype=np.bool_)

    @cached_property
    def largest_forces(self) -> Array:
        """Largest magnitude of the force of each element, (elements, n)."""
        return np.maximum(np.abs(self.least_force), np.abs(self.most_force))

    def lossy_damping(self, effort: float) -> Array:
        """Return the damping of all elements when the motor gives at most `effort` [N or N·m], (n,)."""
        limited = np.minimum(self.largest_forces, effort)
        forces = np.where(self.one_sided & np.isfinite(effort), limited, self.largest_forces)
        with np.errstate(invalid="ignore"):
            return np.asarray((self.damping + np.where(self.loss > 0.0, self.loss * forces, 0.0)).sum(axis=0))

    def damping_at(self, stiffness: Array, effort: float) -> Array:
        """Return the damping (n,) of the elements with this `stiffness`, (elements, n).

        At the surface of a contact it is that of the side with this stiffness. A damper without any stiffness acts.
        """
        acts = (stiffness != 0.0) | ((self.least_stiffness == 0.0) & (self.most_stiffness == 0.0))
        return replace(self, damping=acts * self.damping, loss=acts * self.loss).lossy_damping(effort)

    def slope(self, effort: float) -> Array:
        """Return the largest slope of either sign when the motor gives at most `effort` [N or N·m], (n,)."""
        steepest = np.maximum(np.abs(self.least_stiffness.sum(axis=0)), np.abs(self.most_stiffness.sum(axis=0)))
        # Where an interval begins at the effort limit, rounding may put its force just below.
        return np.where(self.smallest_force >= (1.0 - 1e-9) * effort, 0.0, steepest)


def survey(elements: Sequence[Varying], intervals: Sequence[Interval]) -> Survey:
    """Return the bounds of each element on each interval; the interval of a place is (place, place)."""
    found = (each.local(*interval) for each in elements for interval in intervals)
    rows = [(*each.force, *each.stiffness, each.damping, each.loss) for each in found]
    columns = np.array(rows, dtype=float).reshape(len(rows), 6).T
    return Survey(*np.ascontiguousarray(columns).reshape(6, len(elements), len(intervals)))


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """The places of an axis and the intervals between them."""

    position: Array
    """Places [m or rad], (n,)."""
    places: Survey
    find_between: Callable[[], Survey]
    """Function that computes `between`; the eigenvalues do not need it."""
    is_open: bool = False
    """Whether there is an interval before the first place."""

    def hides(self, effort: float) -> bool:
        """Return whether the handle may rest between two places, at neither of which it can."""
        held = self.places.smallest_force <= effort * ROUNDED
        # Without a limit of the travel the first interval lies before the first place.
        may_hold = self.between.smallest_force[int(self.is_open) :][: len(held) - 1] <= effort
        return bool(np.any(may_hold & ~held[:-1] & ~held[1:]))

    @cached_property
    def between(self) -> Survey:
        """Bounds on the n + 1 intervals before, between and after the places, within the travel."""
        return self.find_between()

    def scaled(self, row: int, factor: float) -> "StiffnessMap":
        """Return the same with `factor` times the force of one element."""
        places = self.places.scaled(row, factor)
        return StiffnessMap(self.position, places, lambda: self.between.scaled(row, factor), self.is_open)


def terrain(elements: Sequence[Varying], travel: Interval, effort: float, *, fine: bool = False) -> StiffnessMap:
    """Return the stiffness map of these elements within `travel`; `effort`: largest force of the motor [N or N·m].

    A `fine` map has places between neighbours of very different slopes: beside virtual states a spring may be unstable
    although a softer and a stiffer one are not.
    """
    lower, upper = travel
    marks = {place for each in elements for place in each.places(lower, upper, effort)}
    grid = sorted(place for place in {*marks, *travel} if lower <= place <= upper and math.isfinite(place))
    if len(elements) > 1:
        grid = sorted([*grid, *places_between(elements, grid, effort)])
    if fine:
        slopes = survey(elements, [(place, place) for place in grid]).most_stiffness.sum(axis=0)
        with np.errstate(invalid="ignore"):  # a contact without an end may be infinitely steep
            steps = np.abs(np.diff(slopes)) / max(float(np.abs(slopes).max(initial=0.0)), 1e-300)
        parts = np.ceil(FINE * np.nan_to_num(steps)).astype(int)
        cuts = zip(pairwise(grid), parts.tolist(), strict=True)
        more = [low + (high - low) * at / count for (low, high), count in cuts for at in range(1, count)]
        grid = sorted([*grid, *more])
    edges = [lower, *grid, upper]
    return StiffnessMap(
        np.array(grid),
        survey(elements, [(place, place) for place in grid]),
        lambda: survey(elements, [(low, high) for low, high in pairwise(edges) if low < high]),
        bool(grid) and lower < grid[0],
    )


ROUNDED = 1.0 + 1e-9
"""Factor by which a force may be above the effort limit by rounding."""
FINE = 32
"""Number of steps into which a fine map cuts the largest slope."""
HALVINGS, MOST_PLACES = 24, 3000
"""Largest number of halvings of an interval, and of places that are added by them."""


def places_between(elements: Sequence[Varying], grid: Sequence[float], effort: float) -> list[float]:
    """Return further places at which these elements together may rest.

    The marks of each element alone say nothing of their sum. An interval between two marks in which the sum of the
    forces may be small is halved until a place in it is found where the motor can hold the handle, or until the bounds
    exclude one. It is also halved while its slope may be steeper than that of all places that were found.
    """

    def held_at(places: Sequence[float]) -> tuple[list[bool], float]:
        found = survey(elements, [(place, place) for place in places])
        held = found.smallest_force <= effort * ROUNDED
        return held.tolist(), float(found.most_stiffness.sum(axis=0)[held].max(initial=0.0))

    held, steepest = held_at(grid)
    todo = [*pairwise(zip(grid, held, strict=True))]
    more = list[float]()
    for _ in range(HALVINGS):
        bounds = survey(elements, [(low, high) for (low, _), (high, _) in todo])
        may_hold = bounds.smallest_force <= effort * ROUNDED
        steeper = bounds.most_stiffness.sum(axis=0) > STEEPER * steepest
        known = zip(todo, may_hold, steeper, strict=True)
        todo = [(low, high) for (low, high), may, steep in known if may and (steep or not (low[1] or high[1]))]
        if not todo or len(more) + len(todo) > MOST_PLACES:
            break
        middles = [0.5 * (low + high) for (low, _), (high, _) in todo]
        held, slope = held_at(middles)
        steepest, more = max(steepest, slope), [*more, *middles]
        between = zip(middles, held, strict=True)
        todo = [half for (low, high), at in zip(todo, between, strict=True) for half in ((low, at), (at, high))]
    return more


FLAT = 1e-12
"""Share of the steepest slope of all places below which a slope counts as rounding."""
MOST_ALIKE, MOST_WITH_STATES = 12, 48
"""Largest number of stiffnesses that are tried with the same damping: the smallest, the largest, and some between. The
second number is for places beside virtual states."""


LARGEST_EXPONENT = 700.0
"""Largest x for which a double can hold eˣ."""
KEPT = 1e-300
"""Damping in place of 0, so that the states of the estimator are kept [N·s/m or N·m·s/rad]."""
STEEPER = 1.02
"""Ratio of slope to stated stiffness from which the report calls the slope steeper than stated."""


@dataclass(frozen=True)
class RestingPlace:
    """Equilibrium at which a loop was judged: position [m or rad], stiffness, damping, growth per period.

    `ideal` is the growth of the ideal environment in continuous time; it is above 1 only for a negative stiffness.
    """

    position: float | None
    """None where the position does not matter."""
    stiffness: float
    damping: float
    growth: float
    ideal: float | None = None
    among: int = 1
    """Number of different places that were tried."""

    def to_json(self) -> dict[str, float | None]:
        told = {"position": self.position, "stiffness": self.stiffness, "virtual_damping": self.damping}
        return {**told, "growth": self.growth, "ideal_growth": self.ideal}


@dataclass(frozen=True)
class OwnLaw:
    """Stability check of an element that states no bounds: by its force at positions, or by `linearised` alone."""

    element: str
    places: int
    """Number of places at which its force was read; 0: judged by `linearised` alone."""
    travel: Interval
    """Range of positions at which the force was read [m or rad]."""
    steepest: float
    """Largest slope of the force where the motor can hold the handle [N/m or N·m/rad]."""
    position: float
    """Position of `steepest` [m or rad]."""
    stated: float
    """Stiffness that `linearised` states [N/m or N·m/rad]."""
    beyond: tuple[str, ...]
    """Inputs of its force besides the position: names of signals, "memory", or "two axes"."""
    runs_off: bool
    """True if its force away from rest grows without bound on an axis without position limits."""

    @property
    def is_steeper(self) -> bool:
        """Whether its force is steeper than `linearised` states."""
        return self.places > 0 and self.steepest > STEEPER * max(self.stated, 0.0) + 1e-12

    def to_json(self) -> dict[str, object]:
        read = {"travel": list(self.travel), "steepest": self.steepest, "position": self.position}
        told = {"element": self.element, "places": self.places, **(read if self.places else dict.fromkeys(read))}
        return {**told, "stated": self.stated, "beyond": list(self.beyond), "runs_off": self.runs_off}


def stated_law(coupling: CouplingElement) -> OwnLaw:
    """Return the stability check of a coupling of another package: `linearised` alone."""
    stated = -float(coupling.linearised().d[0, 0])
    return OwnLaw(coupling.name, 0, EVERYWHERE, math.nan, math.nan, stated, ("two axes",), False)


@dataclass(frozen=True, eq=False)
class ParallelStates:
    """Discrete elements with states that act at the same time, as x_k → F_k beside a spring K and a damper B."""

    spaces: tuple[StateSpace, ...]
    """Systems (position, velocity)_k → F_k."""
    period: float
    estimator: str | None
    """Velocity estimator; None when neither the elements nor a damper need the velocity."""

    @cached_property
    def free(self) -> StateSpace:
        """The elements without spring and damper."""
        return self._beside(0.0, 0.0)

    @cached_property
    def spring(self) -> StateSpace:
        """The elements with a spring K = 1."""
        return self._beside(1.0, 0.0)

    @cached_property
    def damper(self) -> StateSpace:
        """The elements with a damper B = 1; equal to `free` when nothing needs the velocity."""
        return self.free if self.estimator is None else self._beside(0.0, 1.0)

    def _beside(self, stiffness: float, damping: float) -> StateSpace:
        # A damper, however small, keeps the states of the estimator, which all three systems must have.
        kept = 0.0 if self.estimator is None else damping or KEPT
        return estimated(parallel([*self.spaces, gain([[-stiffness, -kept]])]), self.period, self.estimator)

    def still(self) -> "ParallelStates":
        """Return the same with the velocity 0 for all elements."""
        inputs = np.array([1.0, 0.0])
        spaces = (StateSpace(each.a, each.b * inputs, each.c, each.d * inputs) for each in self.spaces)
        return ParallelStates(tuple(spaces), self.period, None)

    def at(self, stiffness: float, damping: float) -> StateSpace:
        """Return the environment with this spring and damper."""
        free, spring, damper = self.free, self.spring, self.damper
        if not (stiffness or damping):
            return free
        c = free.c + stiffness * (spring.c - free.c) + damping * (damper.c - free.c)
        d = free.d + stiffness * (spring.d - free.d) + damping * (damper.d - free.d)
        return StateSpace(free.a, free.b, c, d)


@dataclass(frozen=True, eq=False)
class Places(StateSpace):
    """Environment x_k → F_k with all of its places; its own matrices are those of the stiffest contact."""

    position: Array
    """Position of each place [m or rad], (n,); not-a-number if it does not matter."""
    stiffness: Array
    """(n,)"""
    damping: Array
    """(n,)"""
    together: tuple[ParallelStates, ...]
    """Combinations of the elements with states; each is tried at each place."""
    find_increments: Callable[[], Increments]
    """Function that computes `increments`; the eigenvalues do not need them."""
    swept: StateSpace | None
    """Linear elements with virtual states x_k → F_k, for a frequency sweep of the needed damping; None without any."""
    runs_off: bool = False
    """Whether the elements push the handle away without bound; the loop is then unstable."""

    @cached_property
    def felt(self) -> float:
        """Largest stiffness that a single count meets, with that of the elements with states."""
        with_states = (sum(max(-float(space.d[0, 0]), 0.0) for space in each.spaces) for each in self.together)
        return max(float(self.stiffness.max()), 0.0) + max(with_states)

    @property
    def has_states(self) -> bool:
        """Whether an element has states, whose stiffness `stiffness` leaves out."""
        return any(each.spaces for each in self.together)

    @cached_property
    def increments(self) -> Increments:
        """Bounds of the law; ∞ if it has none."""
        return self.find_increments()

    def worst(self, device: SampledPlant) -> tuple[RestingPlace, StateSpace]:
        """Return the equilibrium with the largest growth, and its environment; growth below 1 is stable.

        At a place where the ideal is unstable, this unstable eigenvalue does not count.
        """
        found = [self._worst(device, each) for each in self.together]
        return max(found, key=lambda pair: pair[0].growth)

    def crest(self, device: SampledPlant, mass: float, damping: float, period: float) -> RestingPlace | None:
        """Return the equilibrium with the largest growth of the ideal scene, with both growths; None without growth."""
        if not (self.stiffness < 0.0).any():
            return None
        at = int(self.stiffness.argmin())
        stiffness, virtual = float(self.stiffness[at]), float(self.damping[at])
        whole = damping + virtual
        fall = -2.0 * stiffness / (whole + math.sqrt(whole**2 - 4.0 * mass * stiffness))
        loops = [sampled.loop_matrix(device, each.at(stiffness, virtual)) for each in self.together]
        grown = max(map(sampled.spectral_radius, loops))
        ideal = math.exp(fall * period) if fall * period < LARGEST_EXPONENT else math.inf
        return RestingPlace(_known(self.position[at]), stiffness, virtual, grown, ideal)

    def crossings(self, others: Sequence[StateSpace], step: float, device: SampledPlant) -> list[float] | None:
        """Return all stiffnesses K at which an eigenvalue has the modulus 1 at any place; None without a closed form.

        This environment has K = `step`, the two `others` have 2·`step` and 3·`step`. The slopes of the places must be
        linear in K, and nothing else may depend on it.
        """
        known = [self, *(each for each in others if isinstance(each, Places))]
        if any(each.together is not self.together or not np.array_equal(each.damping, self.damping) for each in known):
            return None
        one, two, three = (each.stiffness for each in known)
        share, offset = (two - one) / step, 2.0 * one - two
        if np.abs(three - two - (two - one)).max() > 1e-9 * np.abs(three).max():
            return None
        found: list[float] = []
        for together, damping in product(self.together, dict.fromkeys(self.damping.tolist())):
            systems = together.free, together.spring, together.damper
            free, spring, damper = (sampled.loop_matrix(device, each) for each in systems)
            damped = free + damping * (damper - free)
            slopes = crossings([damped + multiple * step * (spring - free) for multiple in (1.0, 2.0, 3.0)], step)
            if slopes is None:
                return None
            varied = (self.damping == damping) & (np.abs(share) > FLAT * np.abs(share).max())
            found += (np.subtract.outer(slopes, offset[varied]) / share[varied]).ravel().tolist()
        return found

    def environments(self, most: int) -> list[StateSpace]:
        """Return the environment at each different place; with more than `most`, some that cover all stiffnesses."""
        pairs = np.unique(np.round(np.column_stack([self.stiffness, self.damping]), 12), axis=0, return_counts=True)[0]
        kept = max(most // len(self.together), 2)
        if len(pairs) > kept:
            pairs = pairs[np.linspace(0, len(pairs) - 1, kept).round().astype(int)]
        return [each.at(float(stiffness), float(damping)) for each in self.together for stiffness, damping in pairs]

    def _worst(self, device: SampledPlant, together: ParallelStates) -> tuple[RestingPlace, StateSpace]:
        growths = self._growths(device, together)
        at, growth = int(self._tried[growths.argmax()]), float(growths.max())
        stiffness, damping = float(self.stiffness[at]), float(self.damping[at])
        place = RestingPlace(_known(self.position[at]), stiffness, damping, growth, among=len(growths))
        return place, together.at(stiffness, damping)

    @cached_property
    def _tried(self) -> NDArray[np.intp]:
        """Rows of the places that are tried; duplicates, and places where nothing acts, are left out."""
        if len(self.stiffness) == 1:
            return np.zeros(1, dtype=np.intp)
        pairs = np.round(np.column_stack([self.damping, self.stiffness]), 12)
        # As complex numbers pairs sort in the same order, and much faster.
        _, rows = np.unique(pairs.view(np.complex128).ravel(), return_index=True)
        if not any(each.free.c.any() or each.free.d.any() for each in self.together):
            acting = rows[pairs[rows].any(axis=1)]
            rows = acting if len(acting) else rows[:1]
        dampings, counts = np.unique(pairs[rows, 0], return_counts=True)
        most = MOST_WITH_STATES if self.has_states else MOST_ALIKE
        if counts.max() <= most:
            return np.asarray(rows)
        found: list[int] = []
        for damping in dampings:
            alike = rows[pairs[rows, 0] == damping]  # np.unique sorts them by their stiffness
            if len(alike) > most:
                alike = alike[np.linspace(0, len(alike) - 1, most).round().astype(int)]
            found += alike.tolist()
        return np.array(found, dtype=np.intp)

    def _growths(self, device: SampledPlant, together: ParallelStates) -> Array:
        """Return the growth at each place that is tried."""
        stiffness, damping = self.stiffness[self._tried], self.damping[self._tried]
        # A slope within rounding has an eigenvalue of 1 up to rounding, which could be above 1.
        stiffness = np.where(np.abs(stiffness) < FLAT * np.abs(stiffness).max(initial=0.0), 0.0, stiffness)
        if len(stiffness) == 1 and stiffness[0] >= 0.0:
            return np.array([sampled.growth(device, together.at(float(stiffness[0]), float(damping[0])))])
        free = sampled.loop_matrix(device, together.free)
        springs, dampers = (sampled.loop_matrix(device, each) - free for each in (together.spring, together.damper))
        modes = np.linalg.eigvals(free + stiffness[:, None, None] * springs + damping[:, None, None] * dampers)
        moduli = np.abs(modes)
        # At a crest the ideal grows too: the largest real eigenvalue above 1 does not count.
        falls = np.where((np.abs(modes.imag) < 1e-9) & (modes.real > 1.0 - 1e-9), modes.real, 0.0)
        for row in np.flatnonzero((stiffness < 0.0) & falls.any(axis=1)):
            moduli[row, falls[row].argmax()] = 0.0
        growths = moduli.max(axis=1)
        # Without a spring the handle may rest anywhere. This is an eigenvalue of 1, which does not count.
        for row in np.flatnonzero(stiffness == 0.0):
            growths[row] = sampled.growth(device, together.at(0.0, float(damping[row])))
        return np.asarray(growths)


@lru_cache(maxsize=64)
def _known(position: float) -> float | None:
    return None if math.isnan(position) else float(position)

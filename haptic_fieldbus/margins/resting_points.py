"""The environment of one axis from its elements: spring and damper at every place, in parallel with virtual states."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import Any

import numpy as np

from haptic_fieldbus.margins import closed_loop
from haptic_fieldbus.margins.passivity import Increments, sum_of_bounds, weight
from haptic_fieldbus.margins.stiffness_map import (
    EVERYWHERE,
    ROUNDED,
    Array,
    OwnLaw,
    ParallelStates,
    Places,
    StiffnessMap,
    survey,
    terrain,
)
from haptic_fieldbus.numerics.linear import StateSpace, parallel
from haptic_fieldbus.numerics.sampled import discretised, estimated
from haptic_fieldbus.scenes.element import (
    Element,
    Interval,
    StaticElement,
    Varying,
    abilities,
    is_dynamic,
    is_sampled,
    is_shipped,
    is_varying,
)
from haptic_fieldbus.signals import Signal

MOST_COMBINED = 4
"""Largest number of elements with a memory whose combinations are all tried; beyond it only all together, and none."""
KEPT_AXES, KEPT_ENVIRONMENTS = 16, 8
"""Number of axes whose elements are kept, and of their environments that are kept for each."""
MOST_PIECES = 3
"""Largest number of different stiffnesses of a piecewise linear element: one on each side, and 0."""


Resting = tuple[Array, Array, Array]
"""Position [m or rad], stiffness and damping of places, (n,) each."""


@dataclass(frozen=True, eq=False)
class AxisElements:
    """Elements of one axis as the loop runs them; the stiffness of the stiffest element varies."""

    elements: tuple[Element, ...]
    period: float
    method: str | None
    estimator: str | None
    effort: float = math.inf
    """Largest force of the motor [N or N·m]."""
    travel: Interval = EVERYWHERE
    """Positions that the handle can have [m or rad]."""
    loses_velocity: bool = False
    """Whether the estimator may stay far behind the handle; the loop is then also judged with the velocity 0."""

    @cached_property
    def stiffest(self) -> Element | None:
        return closed_loop.stiffest_of(self.elements)

    def environment(self, **changes: float) -> Places:
        """Return the environment at all places after `changes` to the stiffest element.

        Raises UsageError as `numerics.sampled.environment`.
        """
        return self._kept_environment(tuple(changes.items()))

    @cached_property
    def _kept_environment(self) -> Callable[[tuple[tuple[str, float], ...]], Places]:
        """`_changed_environment`, with the last results: the corners of the ranges ask for the same stiffnesses."""
        return lru_cache(maxsize=KEPT_ENVIRONMENTS)(lambda changes: self._changed_environment(dict(changes)))

    def _changed_environment(self, changes: Mapping[str, float]) -> Places:
        beside, scaled = self._beside(changes), self._scaled(changes)
        ground = self._ground(changes) if scaled is None else None
        position, stiffness, damping = self._stated(self._resting(ground) if scaled is None else scaled, changes)
        if not len(stiffness):  # the motor can hold no place: a free handle
            position, stiffness, damping = np.array([math.nan]), np.zeros(1), np.zeros(1)
        springs, dampers = np.array(beside.options).T
        stiffness, damping = np.add.outer(stiffness, springs).ravel(), np.add.outer(damping, dampers).ravel()
        stiffest = int(stiffness.argmax())
        nominal = beside.together[0].at(float(stiffness[stiffest]), float(damping[stiffest]))
        return Places(
            nominal.a,
            nominal.b,
            nominal.c,
            nominal.d,
            position=np.repeat(position, len(springs)),
            stiffness=stiffness,
            damping=damping,
            together=beside.together,
            find_increments=lambda: self._increments(self._ground(changes) if ground is None else ground, beside),
            swept=beside.swept,
            runs_off=self._runs_off,
        )

    def _changed(self, changes: Mapping[str, float]) -> list[Element]:
        return [closed_loop.with_parameters(each, changes) if each is self.stiffest else each for each in self.elements]

    @cached_property
    def _varies(self) -> bool:
        """Whether the stiffest element has no memory; the states beside the places then do not change with it."""
        return _is_at_places(self.stiffest)

    @cached_property
    def own_laws(self) -> tuple[OwnLaw, ...]:
        """Stability check of each element that states no bounds."""
        if all(is_shipped(each) and not is_sampled(each) for each in self.elements):
            return ()
        from haptic_fieldbus.margins.own_laws import own_laws  # not needed by shipped elements

        return own_laws(self.elements, self.travel, self.effort)

    @cached_property
    def _runs_off(self) -> bool:
        """Whether the elements push the handle away without bound; shipped elements alone never do."""
        if all(map(is_shipped, self.elements)) or not any(map(math.isinf, self.travel)):
            return False
        from haptic_fieldbus.margins.own_laws import runs_off

        return runs_off(self.elements, self.travel)

    def _at_places(self, element: Element) -> Varying:
        """Return the element if it states bounds, otherwise its sampled law."""
        if is_varying(element):
            return element
        from haptic_fieldbus.margins.own_laws import read

        is_nominal = any(element is each for each in self.elements)
        return read(element, () if is_nominal else self._thinned[element.name])

    @cached_property
    def _thinned(self) -> dict[str, tuple[float, ...]]:
        """Places at which a further sampling of an element begins when its stiffness changes."""
        from haptic_fieldbus.margins.own_laws import read, thinned

        return {each.name: thinned(read(each), self.travel, self.effort) for each in self.elements if is_sampled(each)}

    def _ground(self, changes: Mapping[str, float]) -> StiffnessMap | None:
        """Return the stiffness map of the elements without memory; None if there are none."""
        if not changes or not self._varies or self._nominal is None:
            return self._nominal
        if set(changes) == {"stiffness"} and self._scales is not None:
            row, stiffness = self._scales
            scaled = self._nominal.scaled(row, changes["stiffness"] / stiffness)
            if len(self.elements) == 1 or not scaled.hides(self._held):
                return scaled
        if all(getattr(self.stiffest, name, None) == value for name, value in changes.items()):
            return self._nominal
        return self._terrain(self._changed(changes))

    def _terrain(self, elements: Sequence[Element]) -> StiffnessMap | None:
        varying = [self._at_places(each) for each in elements if _is_at_places(each)]
        return terrain(varying, self.travel, self._held, fine=self._has_states) if varying else None

    @cached_property
    def _has_states(self) -> bool:
        """Whether an element with states acts beside the places."""
        return any(not _is_at_places(each) and closed_loop.linearised(each, {}).order for each in self.elements)

    @cached_property
    def _held(self) -> float:
        """Largest force of elements at places that the handle can rest against [N or N·m].

        That of the motor, and what others give by themselves: the motor limits the sum.
        """
        sources = [each for each in self.elements if not ({Signal.POSITION, Signal.VELOCITY} & {*each.needs})]
        constant = [each.force() for each in sources if isinstance(each, StaticElement) and not each.needs]
        return self.effort + sum(map(abs, constant)) + sum(abilities(each).strongest for each in sources if each.needs)

    @cached_property
    def _nominal(self) -> StiffnessMap | None:
        return self._terrain(self.elements)

    @cached_property
    def _scales(self) -> tuple[int, float] | None:
        """Return (row, stiffness) of the stiffest element if its force scales with stiffness at fixed places, else
        None.

        For example, the places of a contact that stiffens with depth move with its stiffness.
        """
        element: Any = self.stiffest
        nominal = self._nominal
        if not is_varying(element) or nominal is None:
            return None
        doubled = closed_loop.with_parameters(element, {"stiffness": 2.0 * closed_loop.stiffness_of(element)})
        varying = [each for each in self.elements if _is_at_places(each)]
        row = next(place for place, each in enumerate(varying) if each is element)
        changed = [doubled if each is element else self._at_places(each) for each in varying]
        other = terrain(changed, self.travel, self._held, fine=self._has_states)
        slopes = set(nominal.places.most_stiffness[row].tolist())  # np.unique would import numpy.ma
        if len(slopes) > MOST_PIECES and not np.array_equal(nominal.position, other.position):
            return None
        again = survey([doubled], [(place, place) for place in nominal.position.tolist()])
        if not np.allclose(again.largest_forces[0], 2.0 * nominal.places.largest_forces[row]):
            return None
        # An element of another package may scale its damping too.
        kept = (again.damping[0], nominal.places.damping[row]), (again.loss[0], nominal.places.loss[row])
        if not all(np.array_equal(*each) for each in kept):
            return None
        return row, closed_loop.stiffness_of(element)

    def _beside(self, changes: Mapping[str, float]) -> "ElementStates":
        """Return the elements that act in parallel with the places."""
        is_nominal = not changes or (self._varies and set(changes) == {"stiffness"})
        return self._nominal_beside if is_nominal else self._beside_of(self._changed(changes))

    @cached_property
    def _nominal_beside(self) -> "ElementStates":
        return self._beside_of(self.elements)

    def _beside_of(self, elements: Sequence[Element]) -> "ElementStates":
        others = [each for each in elements if not _is_at_places(each)]
        rest = [self._discrete(each) for each in others]
        options = product(*(_options(each, space) for each, space in zip(others, rest, strict=True) if not space.order))
        sums = list(dict.fromkeys((sum(k for k, _ in each), sum(b for _, b in each)) for each in options))
        with_states = any(space.order for space in rest)
        uses_velocity = any(Signal.VELOCITY in each.needs for each in elements)
        together = self._together(elements) if with_states else self._without_states[uses_velocity]
        bounds = [_bounds(each) for each in others if not self._is_linear(each)]
        return ElementStates(tuple(sums), together, tuple(bounds), self._swept(others))

    @cached_property
    def _without_states(self) -> tuple[tuple[ParallelStates, ...], tuple[ParallelStates, ...]]:
        """`ParallelStates` without elements: for elements that need no velocity, and for elements that need it."""
        none, estimated = (ParallelStates((), self.period, each) for each in (None, self.estimator))
        return (none,), (estimated, none) if self.loses_velocity else (estimated,)

    def _scaled(self, changes: Mapping[str, float]) -> "Resting | None":
        """Return the places of a single element whose force scales with its stiffness; None for any other."""
        if len(self.elements) > 1 or set(changes) != {"stiffness"} or self._scales is None:
            return None
        position, stiffness, damping = self._unscaled
        return position, changes["stiffness"] / self._scales[1] * stiffness, damping

    @cached_property
    def _unscaled(self) -> "Resting":
        """Places of a single element, one for each pair of stiffness and damping other than 0."""
        position, stiffness, damping = self._resting(self._nominal)
        pairs = np.round(np.column_stack([stiffness, damping]), 12)
        _, rows = np.unique(pairs, axis=0, return_index=True)
        rows = rows[pairs[rows].any(axis=1)]
        return position[rows], stiffness[rows], damping[rows]

    def _resting(self, ground: StiffnessMap | None) -> "Resting":
        """Return position, stiffness and damping of the places where the motor can hold the handle, (n,) each."""
        if ground is None or not (within := ground.places.smallest_force <= self._held * ROUNDED).any():
            return np.array([math.nan]), np.zeros(1), np.zeros(1)
        either = [
            (each.sum(axis=0)[within], ground.places.damping_at(each, self._held)[within])
            for each in (ground.places.least_stiffness, ground.places.most_stiffness)
        ]
        stiffness, damping = (np.concatenate(each) for each in zip(*either, strict=True))
        return np.tile(ground.position[within], 2), stiffness, damping

    def _stated(self, places: "Resting", changes: Mapping[str, float]) -> "Resting":
        """Return the places, and the linear models of elements without bounds as one place each."""
        spaces = [closed_loop.linearised(each, {}) for each in self._changed(changes) if is_sampled(each)]
        stated = [-space.d[0] for space in spaces if not space.order]
        if not stated:
            return places
        stiffness, damping = np.array(stated, dtype=float).T
        position = np.concatenate([places[0], np.full(len(stated), math.nan)])
        return position, np.concatenate([places[1], stiffness]), np.concatenate([places[2], damping])

    def _discrete(self, element: Element) -> StateSpace:
        method = self.method if is_dynamic(element) else None
        return discretised(closed_loop.linearised(element, {}), self.period, method)

    def _together(self, elements: Sequence[Element]) -> tuple[ParallelStates, ...]:
        """Return the combinations of the elements with states; elements with virtual states are in each of them."""
        pairs = [(each, self._discrete(each)) for each in elements if not _is_at_places(each)]
        always = [space for each, space in pairs if is_dynamic(each)]
        leaving = [
            (space, *(discretised(other, self.period, None) for other in abilities(each).other_regimes), None)
            for each, space in pairs
            if space.order and not is_dynamic(each)
        ]
        chosen = list(product(*leaving))
        if len(leaving) > MOST_COMBINED:
            chosen = [chosen[0], chosen[-1]]
        estimator = self.estimator if any(Signal.VELOCITY in each.needs for each in elements) else None
        found = [
            ParallelStates((*always, *(space for space in each if space is not None)), self.period, estimator)
            for each in chosen
        ]
        return (*found, *(each.still() for each in found if self.loses_velocity and estimator is not None))

    def _increments(self, ground: StiffnessMap | None, beside: "ElementStates") -> Increments:
        slope, damping = sum_of_bounds(beside.bounds)
        if ground is not None:
            # Other elements may hold the handle at places where the force of these alone would be cut.
            effort = math.inf if any(each is None or any(each) for each in beside.bounds) else self._held
            slope += float(ground.between.slope(effort).max(initial=0.0))
            damping += float(ground.between.lossy_damping(effort).max(initial=0.0))
        if 0.0 < damping < math.inf:
            damping *= weight(self.estimator, self.period)
        return Increments(slope, damping)

    def _is_linear(self, element: Element) -> bool:
        """Return whether the element is linear for any motion: with virtual states, and never cut by a limit."""
        return is_dynamic(element) and math.isinf(self.effort)

    def _swept(self, others: Sequence[Element]) -> StateSpace | None:
        spaces = [self._discrete(each) for each in others if self._is_linear(each)]
        return estimated(parallel(spaces), self.period, self.estimator) if spaces else None


axis_elements = closed_loop.keeping(KEPT_AXES, AxisElements)
"""Return the elements of an axis; those of an equal axis are reused, because they do not depend on its device."""


@dataclass(frozen=True, eq=False)
class ElementStates:
    """Elements with a memory or virtual states, which act in parallel with the places."""

    options: tuple[tuple[float, float], ...]
    """(K, B) in all combinations of sticking and sliding, touching and not touching."""
    together: tuple[ParallelStates, ...]
    bounds: tuple[tuple[float, float] | None, ...]
    """Increments of each element; None for one that states none."""
    swept: StateSpace | None
    """Linear elements x_k → F_k; None without any."""


def _is_at_places(element: Element | None) -> bool:
    """Return whether an element is judged at places: it states bounds, or its force is sampled."""
    return element is not None and (is_varying(element) or is_sampled(element))


def _options(element: Element, space: StateSpace) -> list[tuple[float, float]]:
    """Return (stiffness, damping) of an element for each of its phases: sticking, sliding, without contact."""
    told = abilities(element)
    if told.phases:
        return list(dict.fromkeys(told.phases))
    stiffness, damping = (-float(value) for value in space.d[0])
    if told.reserve is not None:  # its spring slides, with the same damping
        return list(dict.fromkeys([(stiffness, damping), (0.0, damping)]))
    # A damper acts everywhere, except for slow motions in a dead band; a handle may leave a contact.
    leaves = stiffness or getattr(element, "dead_band", 0.0)
    return [(stiffness, damping), (0.0, 0.0)] if leaves else [(stiffness, damping)]


def _bounds(element: Element) -> tuple[float, float] | None:
    """Return the bounds of the increments of an element without places; None when it states none."""
    stated = abilities(element).increments
    if stated is None or stated:
        return stated
    space = element.linearised()
    return None if space.order or space.d.any() else (0.0, 0.0)

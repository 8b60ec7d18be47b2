"""Energy that the loop may give through an axis: the terms of the ledger, from the plan of the axis.

The theory is at the beginning of `cycle.energy`.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from haptic_fieldbus.margins.group import connected
from haptic_fieldbus.margins.stiffness_map import EVERYWHERE, terrain
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limits import ENERGY_LIMIT, LARGEST_MISSING_SHARE, EffortLimits
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element, abilities, is_varying
from haptic_fieldbus.signals import Signal

TWIST = 2.0
"""The twist of two axes is at most the sum of their motions, and its square twice the sum of their squares."""
BESIDE = 2.0
"""Largest effort at which slopes count if another element may push against them, in effort limits."""


def energy_limit(axis: AxisPlan) -> float:
    """Return the energy [J] above which the loop is active: hardly felt by a hand, plus one count times the effort."""
    return ENERGY_LIMIT + axis.limits.effort * axis.resolution


def forgiven_limit(axis: AxisPlan) -> float:
    """Return the energy [J] that gaps in the feedback of this axis can give to a hand within a second.

    After a gap no force is above the force before it, which is at most the limit F. In a gap of the length t the handle
    moves at most v·t, with its speed limit v. So the gap gives at most F·v·t above the stored energy. All gaps of a
    second together last at most a fifth of it. A power limit below F·v replaces F·v.
    """
    limits = axis.limits
    return LARGEST_MISSING_SHARE * min(limits.effort * limits.speed, limits.power)


@dataclass(frozen=True)
class ByPlace:
    """A damping on each interval of the travel; n edges [m or rad] make n + 1 intervals."""

    edges: tuple[float, ...]
    dampings: tuple[float, ...]
    """K·(T/2 + td + λ) with the largest slope K on the interval [N·s/m or N·m·s/rad]."""

    def largest(self, low: float, high: float) -> float:
        """Return the largest damping between two positions."""
        return max(self.dampings[bisect_left(self.edges, low) : bisect_right(self.edges, high) + 1])


@dataclass(frozen=True)
class AxisTerms:
    """Terms of one axis: the granted force, and the damping that compensates the leak."""

    active: float
    """Largest force of all active elements together [N or N·m]; the granted energy is this force times the motion."""
    damping: float
    """K·(T/2 + td + λ), the damping that compensates the leak of the held force of stiffness K [N·s/m or N·m·s/rad]."""
    age: float
    """Mean age of the force, T/2 + td + λ, in periods: a changing force leaks its change times motion and age."""
    by_place: tuple[ByPlace, ...] = ()
    """`damping` by place, if an element is steeper than its linear model; the largest value counts."""

    def damping_between(self, low: float, high: float) -> float:
        """Return the damping that compensates the leak between two positions [N·s/m or N·m·s/rad]."""
        return max([each.largest(low, high) for each in self.by_place]) if self.by_place else self.damping


@dataclass(frozen=True)
class MemoryTerms:
    """Energy that a set of elements can store besides the energy that follows from the positions."""

    reserve: float
    """Largest energy in memories of a stated size [J]."""
    silence: int
    """Periods at rest without force after which elements that state no energy hold none; 0: all elements state it."""


def axis_terms(
    axis: AxisPlan, elements: Sequence[Element], couplings: Iterable[CouplingElement], period: float
) -> AxisTerms:
    """Return the terms of an axis under these elements, and those of the couplings that act on it; `period` in s."""
    tied = [each for each in couplings if axis.name in each.axes]
    stiffness = sum(map(_stiffness, elements)) + sum(_twisted(each, axis.name) for each in tied)
    active = sum(abilities(element).strongest for element in elements)
    age = 0.5 * period + axis.delay.total
    return AxisTerms(active, stiffness * age, age / period, _by_place(axis, elements, tied, stiffness, age))


def _stiffness(element: Element) -> float:
    """Return the stiffness of the linear model of an element [N/m or N·m/rad]."""
    return max(-float(element.linearised().d[0, 0]), 0.0)


def _twisted(coupling: CouplingElement, axis: str) -> float:
    """Return the stiffness of a coupling at one of its axes, for the share of this axis in the twist."""
    place = coupling.axes.index(axis)
    return TWIST * abs(float(coupling.linearised().d[place, 2 * place]))


def _by_place(
    axis: AxisPlan, elements: Sequence[Element], tied: Sequence[CouplingElement], stiffness: float, age: float
) -> tuple[ByPlace, ...]:
    """Return the damping by place if an element is steeper than its linear model; `stiffness` is the sum of the models.

    A body that stiffens with depth is such an element. The effort limit bounds its slope.
    """
    varying = [each for each in elements if is_varying(each)]
    if not varying:
        return ()
    is_alone = len(varying) == len(elements) and not tied
    effort, travel = axis.limits.effort * (1.0 if is_alone else BESIDE), axis.limits.position or EVERYWHERE
    ground = terrain(varying, travel, effort)
    steepest = np.maximum(ground.between.most_stiffness.sum(axis=0), 0.0)
    slopes = np.where(ground.between.smallest_force < (1.0 - 1e-9) * effort, steepest, 0.0)
    slopes += stiffness - sum(map(_stiffness, varying))
    if slopes.max() <= stiffness * (1.0 + 1e-9):
        return ()
    edges = tuple(place for place in ground.position.tolist() if travel[0] < place < travel[1])
    return (ByPlace(edges, tuple((slopes * age).tolist())),)


def larger_of(one: AxisTerms, other: AxisTerms) -> AxisTerms:
    """Return terms that allow for either of two sets of elements."""
    by_place: tuple[ByPlace, ...] = ()
    if one.by_place or other.by_place:
        by_place = tuple(each for terms in (one, other) for each in terms.by_place or (ByPlace((), (terms.damping,)),))
    active, damping = max(one.active, other.active), max(one.damping, other.damping)
    return AxisTerms(active, damping, max(one.age, other.age), by_place)


def memory_terms(elements: Iterable[AnyElement], period: float) -> MemoryTerms:
    """Return the energy that these elements and couplings can hold in their memories; `period` in s."""
    reserve, silence = 0.0, 0
    for element in elements:
        told = abilities(element)
        if told.reserve is not None:
            reserve += told.reserve
        elif told.stored is None and not told.strongest:
            silence = max(silence, _silence(element.linearised(), period))
    return MemoryTerms(reserve, silence)


def _silence(space: StateSpace, period: float) -> int:
    """Return the longest oscillation period of the virtual states, in periods of the loop.

    With the handle at rest, states that hold energy cause a force within one oscillation. A mode that does not return,
    and an element without visible states, may hold energy for ever.
    """
    rates = np.abs(np.linalg.eigvals(space.a)) if space.order else np.zeros(1)
    slowest = float(rates.min())
    return math.ceil(2.0 * math.pi / (slowest * period)) if slowest * period > 1e-6 else NEVER


NEVER = 2**62
"""Number of periods for a silence that is never reached."""


def with_energy_limits(axes: Sequence[AxisPlan], couplings: Sequence[CouplingElement]) -> tuple[AxisPlan, ...]:
    """Return the axes with the energy that each may give together with the axes coupled with it."""
    limits: dict[str, EffortLimits] = {}
    for group in _groups(axes, couplings):
        # The energy can be judged where there is an element, and each element is bounded.
        is_judged = any(axis.elements or axis.couplings for axis in group) and not any(map(unbounded, group))
        energy = max(map(energy_limit, group)) if is_judged else math.inf
        forgiven = sum(map(forgiven_limit, group)) if is_judged else math.inf
        limits |= {axis.name: replace(axis.limits, energy=energy, forgiven=forgiven) for axis in group}
    return tuple(replace(axis, limits=limits[axis.name]) for axis in axes)


def judged_groups(axes: Sequence[AxisPlan], couplings: Sequence[CouplingElement]) -> list[tuple[AxisPlan, ...]]:
    """Return the axes of each ledger: a group of coupled axes, or a single axis."""
    return [group for group in _groups(axes, couplings) if math.isfinite(group[0].limits.energy)]


def _groups(axes: Sequence[AxisPlan], couplings: Sequence[CouplingElement]) -> list[tuple[AxisPlan, ...]]:
    named = {axis.name: axis for axis in axes}
    return [tuple(named[name] for name in names) for names in connected(named, couplings)]


def ledger_elements(
    plan: Plan, axes: Sequence[AxisPlan]
) -> tuple[list[tuple[Element, ...]], tuple[CouplingElement, ...]]:
    """Return the elements of each of these axes in `plan`, and the couplings between them."""
    names = {axis.name for axis in axes}
    couplings = tuple(each for each in plan.scene.couplings if names & {*each.axes})
    return [plan.axis(axis.name).elements for axis in axes], couplings


def unbounded(axis: AxisPlan) -> list[str]:
    """Return the names of the elements on this axis whose own force has no bound."""
    return [each.name for each in (*axis.elements, *axis.couplings) if not math.isfinite(abilities(each).strongest)]


def bind_stored(
    axes: Sequence[AxisPlan], elements: Sequence[Sequence[Element]], couplings: Sequence[CouplingElement]
) -> Callable[[Sequence[float], Sequence[float]], float]:
    """Return a function from the positions of the axes and the places of their laws to the stored energy [J].

    Elements that do not depend on the place, such as a weight, use the position.
    """
    numbers = {axis.name: number for number, axis in enumerate(axes)}
    own = [
        (number, Signal.POSITION in each.needs, energy)
        for number, of in enumerate(elements)
        for each in of
        if (energy := abilities(each).stored)
    ]
    tied = [
        (tuple(numbers[name] for name in each.axes), both) for each in couplings if (both := abilities(each).stored)
    ]

    def stored(positions: Sequence[float], places: Sequence[float]) -> float:
        total = 0.0
        for number, placed, energy in own:
            total += energy((places if placed else positions)[number])
        for (first, second), energy in tied:
            total += energy(places[first], places[second])
        return total

    return stored

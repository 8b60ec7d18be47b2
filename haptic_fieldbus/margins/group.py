"""Groups of coupled axes: their devices, their own elements in sustained contact, and the couplings between them.

A single axis is a group of one. One stiffness varies: that of the stiffest coupling, or of the stiffest element of an
axis without couplings. Everything else is kept.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from haptic_fieldbus.margins import closed_loop
from haptic_fieldbus.margins.closed_loop import Axis, ClosedLoop, OneAxis
from haptic_fieldbus.margins.limit import (
    DELAYS,
    ENDS,
    FACTOR,
    PRECISION,
    Limit,
    Obstacle,
    Suggestion,
    Values,
    corners,
    least_friction,
    neighbours,
    suggest,
)
from haptic_fieldbus.margins.linear import ROUNDING, SCAN_FACTOR, EnvironmentOf, crossing
from haptic_fieldbus.margins.plant import Basis, Plant, Ranges, exact_bench, weakened
from haptic_fieldbus.margins.resting_points import AxisElements, axis_elements
from haptic_fieldbus.margins.stiffness_map import EVERYWHERE, stated_law
from haptic_fieldbus.margins.verdict import Stability, judge
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element, Interval, is_dynamic, is_shipped
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:
    from haptic_fieldbus.margins.bodies import HungBody

WINDOW, WINDOWS = 0.93, 43
"""Ratio of stiffnesses that are tried beside virtual masses, and how many: down to 0.044 of the limit."""
LOWER, MANY_LOWER = (1.0, 0.6, 0.2), tuple(0.6**number for number in range(7))
"""Stiffnesses at which a corner is checked before its limit is computed, as shares of the smallest limit so far; the
second ones beside virtual masses."""


@dataclass(frozen=True)
class Member:
    """An axis of a group: its device, its delay [s], and its own elements with their method and estimator."""

    name: str
    plant: Plant
    delay: float
    elements: tuple[Element, ...]
    method: str | None
    estimator: str
    bodies: "tuple[HungBody, ...]" = ()
    """Masses behind a compliant transmission; the plant is then the motor alone."""
    ranges: Ranges | None = None
    """Ranges of its values; None: all are exact."""
    effort: float = math.inf
    """Largest force of its motor [N or N·m]."""
    travel: Interval = EVERYWHERE
    """Positions that its handle can have [m or rad]."""
    unit: str = ""
    """Unit of its stiffness."""

    @property
    def known_ranges(self) -> Ranges:
        """Ranges of its values."""
        lag = self.plant.torque_lag
        return self.ranges or exact_bench((lag, lag), (self.delay, self.delay), Basis.STATED)

    @property
    def loses_velocity(self) -> bool:
        """Whether the motor can accelerate the handle by more than the velocity of the estimator follows."""
        if self.estimator == TACHOMETER or not any(Signal.VELOCITY in each.needs for each in self.elements):
            return False
        from haptic_fieldbus.numerics import estimators  # only scenes that use velocity need it

        return self.effort > estimators.most_acceleration(self.estimator) * self.plant.mass

    def at(self, values: Values) -> "Member":
        """Return the same axis with these values; the mass of further bodies scales with that of the plant."""
        share, spring = values.plant.mass / self.plant.mass if self.plant.mass else 1.0, values.coupling
        bodies = (replace(each, mass=share * each.mass, stiffness=spring * each.stiffness) for each in self.bodies)
        return replace(self, plant=values.plant, delay=values.delay, bodies=tuple(bodies))


def connected(names: Iterable[str], couplings: Sequence[CouplingElement]) -> Iterator[tuple[str, ...]]:
    """Yield groups of axes that couplings connect, in the order of `names`; an uncoupled axis is a group of one."""
    rest = list(names)
    while rest:
        group = {rest[0]}
        while more := {name for each in couplings if group & {*each.axes} for name in each.axes} - group:
            group |= more
        yield tuple(name for name in rest if name in group)
        rest = [name for name in rest if name not in group]


def groups_of(members: Sequence[Member], couplings: Sequence[CouplingElement], period: float) -> Iterator["Group"]:
    """Yield the groups that couplings make of the members; a group with a missing member is left out."""
    known = {member.name: member for member in members}
    for names in connected(known, couplings):
        tied = tuple(each for each in couplings if {*each.axes} & {*names})
        if all(name in known for each in tied for name in each.axes):
            yield Group(tuple(known[name] for name in names), tied, period)


@dataclass(frozen=True)
class Group:
    """Axes that couplings connect, and these couplings; `period` in s."""

    members: tuple[Member, ...]
    couplings: tuple[CouplingElement, ...]
    """Empty for a single member."""
    period: float

    def __getstate__(self) -> dict[str, object]:
        """Return what a copy or another process needs: the fields, from which all that is cached follows."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @property
    def varied(self) -> tuple[AnyElement, ...]:
        """The couplings, or the elements of a single axis; the stiffness of the stiffest varies."""
        return self.couplings or self.members[0].elements

    @cached_property
    def stiffest(self) -> AnyElement | None:
        """The coupling or element whose stiffness varies; None when none has a stiffness."""
        return closed_loop.stiffest_of(self.varied)

    @property
    def reference_axis(self) -> str:
        """Name of the axis whose units the verdict uses: the first axis of the stiffest coupling."""
        coupling = closed_loop.stiffest_of(self.couplings)
        return self.members[0].name if coupling is None else coupling.axes[0]

    def stabilities(self) -> dict[str, Stability]:
        """Return the verdict on the group for each axis by name, with the plant and delay of that axis.

        Raises UsageError for a stiffness that is not a finite number from 0 up.
        """
        return dict(self._stabilities)

    @cached_property
    def _stabilities(self) -> dict[str, Stability]:
        stiffness = None if self.stiffest is None else closed_loop.stiffness_of(self.stiffest)
        verdicts = judge(self.loop, self._varied(), stiffness, closed_loop.damping_of(self.varied))
        unit = next(member.unit for member in self.members if member.name == self.reference_axis)
        laws = tuple(law for member in self.members for law in self._axle_of(member).own_laws)
        laws += tuple(stated_law(each) for each in self.couplings if not is_shipped(each))
        found = {}
        for member, verdict in zip(self.members, verdicts, strict=True):
            known = replace(verdict, unit=unit, effort=member.effort, own_laws=laws)
            found[member.name] = replace(known, find_limit=self.limit_over_ranges)
        return found

    @property
    def stability(self) -> Stability:
        """Verdict on the group, in the units of its reference axis."""
        return self.stabilities()[self.reference_axis]

    def limit_over_ranges(self) -> Limit:
        """Return the limit over the ranges of all values.

        It is computed on demand, because it takes several times as long as a limit of stability.
        """
        return self._limit

    @cached_property
    def _limit(self) -> Limit:
        ranges = [(member.plant, member.known_ranges) for member in self.members]
        bases = {each.basis for _, each in ranges}
        basis = next(each for each in (Basis.STATED, Basis.IDENTIFIED, Basis.SIMULATED) if each in bases)
        delays, lower = (DELAYS, MANY_LOWER) if self._has_masses else (ENDS, LOWER)
        if self.stiffest is None:
            grown = any(self._at(values).growth() > 1.0 + ROUNDING for values in corners(ranges, delays))
            return Limit(0.0 if grown else math.inf, basis)
        found, at = least(((values, self._at(values)) for values in corners(ranges, delays)), lower)
        before = math.inf
        if self._has_masses and not self.couplings and 0.0 < found < math.inf:
            found, at = least_window([(values, self._at(values)) for values in corners(ranges, delays)], found, at)
        # Springs alone between free handles have no worst corner for each axis of its own.
        is_more = any(member.elements or member.bodies for member in self.members)
        may_differ = is_more or any(Signal.VELOCITY in each.needs for each in self.couplings)
        while self.couplings and may_differ and 0.0 < found < before:
            before = found
            found, at = least(((values, self._at(values)) for values in neighbours(ranges, at)), lower, found, at)
        # The delay and lag of the plan lie inside their ranges, so no corner has these values.
        found = min(found, self.stability.stiffness_limit.stable or 0.0)
        rough = self._at(least_friction(ranges))
        obstacle = None if found else self._obstacle(self.stiffest)
        return Limit(found, basis, rough.loop.quantisation_limit(rough._varied()), at, obstacle)

    def _obstacle(self, varied: AnyElement) -> Obstacle | None:
        """Return the stiffest other element if it exceeds its limit without `varied`; None with couplings."""
        if self.couplings:
            return None
        (alone,) = self.members
        others = tuple(each for each in alone.elements if each is not varied)
        rest = replace(self, members=(replace(alone, elements=others),))
        if rest.stiffest is None:
            return None
        found = rest.limit_over_ranges()
        if found.obstacle is not None:
            return replace(found.obstacle, beside=varied.name)
        is_too_stiff = 0.0 < found.value < closed_loop.stiffness_of(rest.stiffest)
        return Obstacle(rest.stiffest, found.value, varied.name) if is_too_stiff else None

    def _at(self, values: Sequence[Values]) -> "Group":
        """Return the same axes with these values."""
        pairs = zip(self.members, values, strict=True)
        return replace(self, members=tuple(member.at(each) for member, each in pairs))

    def bears(self, stiffness: float) -> bool:
        """Return whether the group is stable with this stiffness of the stiffest [N/m or N·m/rad]."""
        return self.loop.bears(self.environment(stiffness=stiffness))

    def crossing(self, low: float, high: float) -> float:
        """Return the stiffness between these at which the group begins to grow; it grows at `high`, not at `low`."""
        return crossing(
            lambda stiffness: self.loop.growth(self.environment(stiffness=stiffness)) - 1.0, low, high, PRECISION
        )

    def further_age(self, most: float) -> float:
        """Return the largest additional age of all forces in a stable loop [s], to 2 %; at most `most`.

        Gaps make the force of every element older, but the margin of stiffness varies the stiffest element alone.
        """
        if not math.isfinite(most) or self._bears_age(most):
            return most
        low, high = 0.0, most
        # Not 0.02: there high / (high - low) can be equal to 50, and rounding would decide about a last step.
        while high - low > max(0.0198 * high, 1e-3 * self.period):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._bears_age(middle) else (low, middle)
        return low

    def _bears_age(self, further: float) -> bool:
        older = replace(self, members=tuple(replace(each, delay=each.delay + further) for each in self.members))
        return older.loop.bears(older.environment())

    def uncoupled(self) -> tuple["Group", ...]:
        """Return each axis as a group of one without its couplings; empty when the group has no couplings."""
        return tuple(replace(self, members=(each,), couplings=()) for each in self.members if self.couplings)

    def weakened(self, share: float) -> "Group":
        """Return the same axes with this share of their friction."""
        return replace(self, members=tuple(replace(each, plant=weakened(each.plant, share)) for each in self.members))

    def growth(self) -> float:
        """Return the largest modulus of the loop's eigenvalues, free shifts of the handles left out."""
        return self.loop.growth(self.environment())

    def limit(self, damping: float) -> float:
        """Return the limit of stability [N/m or N·m/rad] when the stiffest has this damping [N·s/m or N·m·s/rad]."""
        return self.loop.limit(self._varied(damping=damping))

    def rough_limit(self) -> float:
        """Return the limit of stability [N/m or N·m/rad] with the precision of a limit over ranges."""
        factor = SCAN_FACTOR if self._has_masses else FACTOR
        return self.loop.limit(self._varied(), factor=factor, precision=PRECISION)

    @property
    def _has_masses(self) -> bool:
        """Whether an element has virtual states; it may grow at one stiffness and not at a larger one."""
        return any(is_dynamic(element) for member in self.members for element in member.elements)

    def rough_margin(self) -> float:
        """Return `rough_limit` divided by the stiffness (by 1 for a stiffness of 0); ∞ without a stiffness to vary."""
        if self.stiffest is None:
            return math.inf
        return self.rough_limit() / (closed_loop.stiffness_of(self.stiffest) or 1.0)

    def passive_limit(self, damping: float, stable: float) -> float:
        """Return the limit of passivity [N/m or N·m/rad] with this damping; `stable` bounds it."""
        return self.loop.passive_limit(self._varied(damping=damping), stable)

    @property
    def largest_damping(self) -> float:
        """Smallest m/T of the devices [N·s/m or N·m·s/rad], referred to the stiffest coupling or element."""
        return self.loop.largest_damping(self._varied())

    def suggested(self) -> Suggestion:
        """Return round values that make an unstable group stable; all None when there is no stiffness to vary."""
        if self.stiffest is None:
            return Suggestion(None, None, None)
        return suggest(
            self.loop,
            lambda stiffness, damping: self.environment(stiffness=stiffness, damping=damping),
            closed_loop.stiffness_of(self.stiffest),
            getattr(self.stiffest, "damping", None),
            self._limit_with,
        )

    def _limit_with(self, damping: float) -> float:
        """Return the limit over ranges with this damping of the stiffest; an element without a damping is unchanged."""
        own = getattr(self.stiffest, "damping", None)
        return (self if own is None or damping == own else self._damped(damping)).limit_over_ranges().value

    def _damped(self, damping: float) -> "Group":
        """Return the same axes with this damping of the stiffest."""
        return self if self.stiffest is None else self._changed(self.stiffest, damping=damping)

    def with_stiffness(self, element: AnyElement, stiffness: float) -> "Group":
        """Return the same single axis with this stiffness [N/m or N·m/rad] of one of its elements."""
        return self._changed(element, stiffness=stiffness)

    def _changed(self, element: AnyElement, **changes: float) -> "Group":
        """Return the same axes after `changes` to one of the elements that may vary."""
        varied: Any = self.varied
        varied = tuple(closed_loop.with_parameters(each, changes) if each is element else each for each in varied)
        if self.couplings:
            return replace(self, couplings=varied)
        (alone,) = self.members
        return replace(self, members=(replace(alone, elements=varied),))

    @cached_property
    def loop(self) -> ClosedLoop:
        """The axes under their delayed holds, with the elements that do not vary."""
        axes = []
        for member in self.members:
            own = self._axle_of(member).environment() if self.couplings and member.elements else None
            axes.append(Axis(member.plant, member.delay, own, member.bodies))
        if len(axes) == 1:
            return OneAxis(axes, self.period)
        from haptic_fieldbus.margins import coupled  # a scene without couplings does without it

        ties, efforts = self.couplings, {member.name: member.effort for member in self.members}
        are_alone = not any(member.elements for member in self.members)
        is_linear, has_potential = coupled.are_linear(ties, efforts), coupled.has_potential(ties, efforts, are_alone)
        return coupled.CoupledAxes(axes, self.period, coupled.may_slacken(ties), is_linear, has_potential)

    @cached_property
    def _axle(self) -> AxisElements:
        """The elements of the single axis."""
        (alone,) = self.members
        return self._axle_of(alone)

    def _axle_of(self, member: Member) -> AxisElements:
        return axis_elements(
            member.elements, self.period, member.method, member.estimator, member.effort, member.travel,
            member.loses_velocity,
        )  # fmt: skip

    def environment(self, **changes: float) -> StateSpace:
        """Return the environment of the loop after `changes`: the elements of one axis, or the couplings of several."""
        if not self.couplings:
            return self._axle.environment(**changes)
        from haptic_fieldbus.margins.coupled import between

        estimators = {member.name: member.estimator for member in self.members}
        return between(self.couplings, self.stiffest, changes, estimators, self.period)

    def _varied(self, **changes: float) -> EnvironmentOf:
        return lambda stiffness: self.environment(stiffness=stiffness, **changes)


def least_window(
    loops: Sequence[tuple[tuple[Values, ...], Group]], limit: float, at: tuple[Values, ...]
) -> tuple[float, tuple[Values, ...]]:
    """Return the smallest stiffness below `limit` from which on one of these loops grows, and its values.

    A loop with a virtual mass may grow in a window of stiffnesses alone. Stiffnesses of a dense row are tried, each
    with all loops. Without growth `limit` and `at` are returned.
    """
    row = [limit * WINDOW**number for number in range(WINDOWS, -1, -1)]
    for low, stiffness in zip([0.0, *row], row, strict=False):
        grown = [(values, loop) for values, loop in loops if not loop.bears(stiffness)]
        if grown:
            return min(((loop.crossing(low, stiffness), values) for values, loop in grown), key=lambda pair: pair[0])
    return limit, at


def least(
    found: Iterable[tuple[tuple[Values, ...], Group]],
    lower: Sequence[float],
    limit: float = math.inf,
    at: tuple[Values, ...] = (),
) -> tuple[float, tuple[Values, ...]]:
    """Return the smallest limit of these loops, and its values; `limit` and `at` are those of a loop before them.

    A loop that is stable at the shares `lower` of the limit counts as one without a limit below it.
    """
    for values, loop in found:
        if at and math.isfinite(limit) and all(loop.bears(share * limit) for share in lower):
            continue
        own = loop.rough_limit()
        if own < limit or not at:
            limit, at = own, values
        if limit == 0.0:
            break
    return limit, at

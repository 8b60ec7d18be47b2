"""Axes that couplings tie together, with the elements of their own in sustained contact: one stiffness to vary.

What `contact` is for one axis. All axes that hang together, by one coupling or by several in a row, are one loop; the
stiffness that is varied is that of its stiffest coupling, all else is kept.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from haptic_fieldbus.margins import contact
from haptic_fieldbus.margins.coupled import (
    CoupledAxis,
    coupled_limit,
    coupled_passive_limit,
    judge_coupled,
    stiffness_shares,
    together,
)
from haptic_fieldbus.margins.plant import Plant, sample, weakened
from haptic_fieldbus.margins.suggestion import Suggestion, suggest_by
from haptic_fieldbus.margins.verdict import Stability
from haptic_fieldbus.numerics import coupled
from haptic_fieldbus.numerics.linear import StateSpace, parallel
from haptic_fieldbus.scenes.element import CouplingElement, Element


@dataclass(frozen=True)
class Member:
    """One of the axes: its device, its delay [s], and its own elements as the loop runs them."""

    name: str
    plant: Plant
    delay: float
    elements: tuple[Element, ...]
    method: str | None
    estimator: str


def connected(names: Iterable[str], couplings: Sequence[CouplingElement]) -> Iterator[tuple[str, ...]]:
    """The groups of axes that couplings tie together, in the order of `names`; axes without any are left out."""
    rest = list(names)
    while rest:
        group = {rest[0]}
        while more := {name for each in couplings if group & {*each.axes} for name in each.axes} - group:
            group |= more
        if len(group) > 1:
            yield tuple(name for name in rest if name in group)
        rest = [name for name in rest if name not in group]


@dataclass(frozen=True)
class Tied:
    """All axes that hang together, and what couples them; `period` in s."""

    members: tuple[Member, ...]
    couplings: tuple[CouplingElement, ...]
    period: float

    @property
    def stiffest(self) -> CouplingElement | None:
        """The coupling whose stiffness is varied; None when none has any."""
        return contact.stiffest_of(self.couplings)

    @property
    def told_by(self) -> str:
        """The axis in whose units the verdict is: the first of the stiffest coupling."""
        return self.members[0].name if self.stiffest is None else self.stiffest.axes[0]

    def judged(self) -> tuple[Stability, ...]:
        """The one verdict on all of them, told for each member."""
        stiffest, damping = self.stiffest, contact.damping_of(self.couplings)
        stiffness = None if stiffest is None else contact.stiffness_of(stiffest)
        return judge_coupled(
            self._axes(), self.period, lambda value: self._coupling(stiffness=value), stiffness, damping
        )

    def growth(self) -> float:
        """Largest modulus of the loop's eigenvalues, the shift of everything at once left out."""
        axes = self._axes()
        return coupled.growth(
            [sample(axis.plant, self.period, axis.delay) for axis in axes], together(axes, self._coupling())
        )

    def weakened(self, share: float) -> "Tied":
        """The same axes with that share of their friction."""
        members = tuple(replace(member, plant=weakened(member.plant, share)) for member in self.members)
        return replace(self, members=members)

    def limit(self, damping: float) -> float:
        """The limit of stability with so much damping in the stiffest coupling."""
        return coupled_limit(self._axes(), self.period, lambda value: self._coupling(stiffness=value, damping=damping))

    def passive_limit(self, damping: float, stable: float) -> float:
        """The same of passivity, below that of stability."""
        return coupled_passive_limit(
            self._axes(), self.period, lambda value: self._coupling(stiffness=value, damping=damping), stable
        )

    def suggested(self) -> Suggestion:
        """Round values that make an unstable coupling stable."""
        stiffest, axes = self.stiffest, self._axes()
        if stiffest is None:
            return Suggestion(None, None, None)
        plants = [sample(axis.plant, self.period, axis.delay) for axis in axes]

        def growth(stiffness: float, damping: float) -> float:
            asked = together(axes, self._coupling(stiffness=stiffness, damping=damping))
            return coupled.growth(plants, asked)

        stiffness, damping = contact.stiffness_of(stiffest), getattr(stiffest, "damping", None)
        return suggest_by(self.limit, growth, self.largest_damping, stiffness, damping)

    @property
    def largest_damping(self) -> float:
        """The smallest m/T as the stiffest coupling meets it."""
        shares = stiffness_shares(lambda value: self._coupling(stiffness=value))
        return min(
            member.plant.mass / self.period / (share or 1.0) for member, share in zip(self.members, shares, strict=True)
        )

    def _axes(self) -> list[CoupledAxis]:
        return [CoupledAxis(member.plant, member.delay, self._own(member)) for member in self.members]

    def _own(self, member: Member) -> StateSpace | None:
        if not member.elements:
            return None
        return contact.environment_of(member.elements, self.period, member.method, member.estimator)

    def _coupling(self, **changes: float) -> StateSpace:
        """All couplings as the loop runs them, the stiffest one changed as far as it has what changes."""
        places = {member.name: place for place, member in enumerate(self.members)}
        spaces = []
        for each in self.couplings:
            known = {name: value for name, value in changes.items() if each is self.stiffest and hasattr(each, name)}
            at = [places[name] for name in each.axes]
            spaces.append(coupled.among(contact.linearised(each, known), at, len(places)))
        estimators = [member.estimator for member in self.members]
        return coupled.environment(parallel(spaces), period=self.period, method=None, estimators=estimators)

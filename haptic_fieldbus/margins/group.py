"""Axes that hang together: their devices, their own elements in sustained contact, and the couplings between them.

One axis by itself is a group of one. The stiffness that is varied is that of the stiffest coupling, of an axis without
couplings that of its stiffest element; all else is kept.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from haptic_fieldbus.margins import contact
from haptic_fieldbus.margins.closed_loop import Axis, ClosedLoop, OneAxis
from haptic_fieldbus.margins.linear import EnvironmentOf
from haptic_fieldbus.margins.plant import Plant, weakened
from haptic_fieldbus.margins.suggestion import Suggestion, suggest
from haptic_fieldbus.margins.verdict import Stability, judge
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, Element


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
    """The axes that hang together, in the order of `names`; one that nothing couples is by itself."""
    rest = list(names)
    while rest:
        group = {rest[0]}
        while more := {name for each in couplings if group & {*each.axes} for name in each.axes} - group:
            group |= more
        yield tuple(name for name in rest if name in group)
        rest = [name for name in rest if name not in group]


def groups_of(members: Sequence[Member], couplings: Sequence[CouplingElement], period: float) -> Iterator["Group"]:
    """The members as they hang together; where one that they are tied to is missing, they are left out."""
    known = {member.name: member for member in members}
    for names in connected(known, couplings):
        tied = tuple(each for each in couplings if {*each.axes} & {*names})
        if all(name in known for each in tied for name in each.axes):
            yield Group(tuple(known[name] for name in names), tied, period)


@dataclass(frozen=True)
class Group:
    """All axes that hang together, and what couples them; `period` in s."""

    members: tuple[Member, ...]
    couplings: tuple[CouplingElement, ...]
    """Without any there is one member."""
    period: float

    @property
    def varied(self) -> tuple[AnyElement, ...]:
        """The couplings, or the elements of a single axis; the stiffest of them is varied."""
        return self.couplings or self.members[0].elements

    @cached_property
    def stiffest(self) -> AnyElement | None:
        """The coupling or element whose stiffness is varied; None when none has any."""
        return contact.stiffest_of(self.varied)

    @property
    def reference_axis(self) -> str:
        """The axis in whose units the verdict is: the first of the stiffest coupling."""
        coupling = contact.stiffest_of(self.couplings)
        return self.members[0].name if coupling is None else coupling.axes[0]

    def stabilities(self) -> dict[str, Stability]:
        """The one verdict on all of them, told for each axis by its name."""
        stiffness = None if self.stiffest is None else contact.stiffness_of(self.stiffest)
        verdicts = judge(self.loop, self._varied(), stiffness, contact.damping_of(self.varied))
        return dict(zip((member.name for member in self.members), verdicts, strict=True))

    @property
    def stability(self) -> Stability:
        """The verdict by the axis in whose units it is."""
        return self.stabilities()[self.reference_axis]

    def uncoupled(self) -> tuple["Group", ...]:
        """Each axis by itself, its couplings left out; empty where there are none."""
        return tuple(replace(self, members=(each,), couplings=()) for each in self.members if self.couplings)

    def weakened(self, share: float) -> "Group":
        """The same axes with that share of their friction."""
        members = tuple(replace(member, plant=weakened(member.plant, share)) for member in self.members)
        return replace(self, members=members)

    def growth(self) -> float:
        """Largest modulus of the loop's eigenvalues, free shifts of the handles left out."""
        return self.loop.growth(self.environment())

    def limit(self, damping: float) -> float:
        """The limit of stability [N/m or N·m/rad] with so much damping in the stiffest."""
        return self.loop.limit(self._varied(damping=damping))

    def passive_limit(self, damping: float, stable: float) -> float:
        """The same of passivity, below that of stability."""
        return self.loop.passive_limit(self._varied(damping=damping), stable)

    @property
    def largest_damping(self) -> float:
        """The smallest m/T [N·s/m or N·m·s/rad] as the stiffest meets it."""
        return self.loop.largest_damping(self._varied())

    def suggested(self) -> Suggestion:
        """Round values that make an unstable group stable."""
        if self.stiffest is None:
            return Suggestion(None, None, None)
        return suggest(
            self.loop,
            lambda stiffness, damping: self.environment(stiffness=stiffness, damping=damping),
            contact.stiffness_of(self.stiffest),
            getattr(self.stiffest, "damping", None),
        )

    @cached_property
    def loop(self) -> ClosedLoop:
        """The axes under their delayed holds, with the elements that are not varied."""
        own = [self._own(member) if self.couplings and member.elements else None for member in self.members]
        axes = [Axis(member.plant, member.delay, each) for member, each in zip(self.members, own, strict=True)]
        if len(axes) == 1:
            return OneAxis(axes, self.period)
        from haptic_fieldbus.margins.coupled import CoupledAxes

        return CoupledAxes(axes, self.period)

    def environment(self, **changes: float) -> StateSpace:
        """What the loop is closed over: the elements of a single axis, or the couplings of several, changed."""
        if not self.couplings:
            return self._own(self.members[0], **changes)
        from haptic_fieldbus.margins.coupled import between

        estimators = {member.name: member.estimator for member in self.members}
        return between(self.couplings, self.stiffest, changes, estimators, self.period)

    def _own(self, member: Member, **changes: float) -> StateSpace:
        return contact.environment_of(member.elements, self.period, member.method, member.estimator, **changes)

    def _varied(self, **changes: float) -> EnvironmentOf:
        return lambda stiffness: self.environment(stiffness=stiffness, **changes)

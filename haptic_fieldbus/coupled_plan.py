"""Axes of a plan that couplings tie together: one verdict on all of them, and how old the forces between them are.

Imported only where a scene has a coupling.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from haptic_fieldbus.axis_plan import AxisPlan, judging_estimator
from haptic_fieldbus.drive.pdo import worst_case_bits
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.margins.coupled_contact import Member, Tied, connected
from haptic_fieldbus.scenes.element import CouplingElement


@dataclass(frozen=True)
class CouplingAges:
    """How old what a coupling answers to is when its force acts [s]; the hold's T/2 is not part of it."""

    name: str
    ages: Mapping[str, Mapping[str, float]]
    """By the axis that the force acts on, and by the axis whose motion it answers."""

    def __str__(self) -> str:
        return f"{self.name}: force {', '.join(f'on {axis} {self._behind(axis)}' for axis in self.ages)}"

    def _behind(self, axis: str) -> str:
        """The ages of both motions, or the one of both where they are the same [ms]."""
        texts = {name: f"{1e3 * age:.2f} ms" for name, age in self.ages[axis].items()}
        if len(set(texts.values())) == 1:
            return f"{texts[axis]} behind both motions"
        return " and ".join(f"{text} behind {name}" for name, text in texts.items())


def judged_together(
    axes: Sequence[AxisPlan], couplings: Sequence[CouplingElement], period: float
) -> tuple[AxisPlan, ...]:
    """The axes, those that are tied with the one verdict on all that hang together; no bench may be unknown for it."""
    found = {axis.name: axis for axis in axes}
    for group in connected(found, couplings):
        tied = _tied([found[name] for name in group], period)
        verdicts = [None] * len(group) if tied is None else tied.judged()
        for name, verdict in zip(group, verdicts, strict=True):
            found[name] = replace(found[name], stability=verdict, judged_with=tied.stiffest if tied else None)
    return tuple(found.values())


def tied_with(axes: Sequence[AxisPlan], axis: AxisPlan, period: float) -> Tied | None:
    """All that hang together with an axis; None where it is by itself, or a bench is unknown."""
    couplings = list(dict.fromkeys(coupling for each in axes for coupling in each.couplings))
    for group in connected([each.name for each in axes], couplings):
        if axis.name in group:
            return _tied([each for each in axes if each.name in group], period)
    return None


def _tied(axes: Sequence[AxisPlan], period: float) -> Tied | None:
    members = [
        Member(axis.name, axis.plant, axis.delay.transport, axis.elements, axis.method, judging_estimator(axis))
        for axis in axes
        if axis.plant is not None
    ]
    if len(members) < len(axes):
        return None
    return Tied(tuple(members), tuple(dict.fromkeys(each for axis in axes for each in axis.couplings)), period)


def ages(couplings: Sequence[CouplingElement], axes: Sequence[AxisPlan], rig: Rig) -> Iterator[CouplingAges]:
    """Both axes of a coupling are latched at the end of the SYNC of their bus, which a slow bus has later."""
    known = {axis.name: axis for axis in axes}
    latch = {axis.name: worst_case_bits(0) / rig.bus[axis.rig.bus].bitrate for axis in axes}
    for coupling in couplings:
        acts = {name: latch[name] + known[name].delay.total for name in coupling.axes}
        yield CouplingAges(
            coupling.name, {on: {of: acts[on] - latch[of] for of in coupling.axes} for on in coupling.axes}
        )

"""Delays and verdicts of a plan's axes: each is judged with all that hangs together with it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.group import Group, Member, groups_of
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.protocols.traffic import Delay


def with_delay(draft: AxisPlan, delay: Delay, period: float) -> AxisPlan:
    """The axis with its delay, and its bench as the loop sees it."""
    return replace(draft, delay=delay, plant=_seen(draft, period))


def _seen(axis: AxisPlan, period: float) -> Plant | None:
    """At rest a position that is integrated is a multiple of a velocity step's way."""
    if axis.plant is None or not axis.integrates:
        return axis.plant
    return replace(axis.plant, resolution=abs(axis.velocity_unit) * period, tachometer=True)


def with_verdicts(axes: Sequence[AxisPlan], period: float) -> tuple[AxisPlan, ...]:
    """The axes with the verdict on all that hang together; without one where a bench among them is unknown."""
    found = {axis.name: axis for axis in axes}
    for each in grouped(axes, period):
        for name, verdict in each.stabilities().items():
            found[name] = replace(found[name], stability=verdict, group=each)
    return tuple(found.values())


def grouped(axes: Sequence[AxisPlan], period: float) -> Iterator[Group]:
    """The axes as they hang together, but for those tied to one whose bench is unknown."""
    members = [
        Member(axis.name, axis.plant, axis.delay.transport, axis.elements, axis.method, _estimator(axis))
        for axis in axes
        if axis.plant is not None
    ]
    return groups_of(members, tuple(dict.fromkeys(each for axis in axes for each in axis.couplings)), period)


def _estimator(axis: AxisPlan) -> str:
    """The estimator that stability is judged with; where the axis has none, the one that it would have."""
    return axis.estimator or (TACHOMETER if axis.integrates else DEFAULT_ESTIMATOR)

"""Delays and verdicts of the axes of a plan; axes that are coupled are judged together."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.group import Group, Member, groups_of
from haptic_fieldbus.margins.terrain import EVERYWHERE
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limits import AGE_SHARE, echo_time
from haptic_fieldbus.planning.scales import load_of
from haptic_fieldbus.planning.uncertainty import ranges_of
from haptic_fieldbus.protocols.traffic import BusTraffic

KEPT = 64
"""Groups that are kept with their verdicts, for further plans of the same scene on the same bench."""


def on_bus(draft: AxisPlan, traffic: BusTraffic, period: float) -> AxisPlan:
    """Return the axis with what its bus says of it: delay, limits of age and echo, the bench as the loop sees it."""
    echo = echo_time(draft.profile.echo, period)
    limits = replace(draft.limits, age=AGE_SHARE * traffic.guard(draft.name), echo=echo)
    delay, plant = traffic.delay(draft.name), _seen(draft, period)
    others = traffic.other_masters(draft.name)
    found = replace(draft, traffic=traffic.of(draft.name), delay=delay, limits=limits, plant=plant)
    return replace(found, other_masters=others)


def _seen(axis: AxisPlan, period: float) -> Plant | None:
    """Return the plant as the loop samples it; None when it is unknown."""
    if axis.plant is None or not axis.integrates:
        return axis.plant
    # At rest an integrated position is a multiple of the way of one velocity step in one period.
    return replace(axis.plant, resolution=abs(axis.velocity_unit) * period, tachometer=True)


def with_verdicts(axes: Sequence[AxisPlan], period: float) -> tuple[AxisPlan, ...]:
    """Return the axes with the verdicts on their groups; an axis has none when a bench in its group is unknown.

    Raises UsageError for a stiffness, method or estimator that cannot be judged.
    """
    found = {axis.name: axis for axis in axes}
    for each in grouped(axes, period):
        for name, verdict in _known(each).stabilities().items():
            found[name] = replace(found[name], stability=verdict, group=each)
    return tuple(found.values())


def grouped(axes: Sequence[AxisPlan], period: float) -> Iterator[Group]:
    """Yield the groups of coupled axes; a group in which a bench is unknown is left out."""
    members = [_member(axis, axis.plant) for axis in axes if axis.plant is not None]
    couplings = tuple(dict.fromkeys(each for axis in axes for each in axis.couplings))
    return groups_of(members, couplings, period)


def _known(group: Group) -> Group:
    """Return the equal group of an earlier plan, with the verdicts that were found of it, else this one."""
    try:
        return _kept(group)
    except TypeError:  # an element of one's own without a hash
        return group


@lru_cache(maxsize=KEPT)
def _kept(group: Group) -> Group:
    return group


def _member(axis: AxisPlan, plant: Plant) -> Member:
    """Return the axis as its loop is judged; with a compliant coupling the plant is the motor alone."""
    # A tachometer does not tell where the load is: such an axis is judged as a rigid one.
    load = None if axis.integrates else load_of(axis.rig, plant)
    return Member(
        axis.name,
        plant if load is None else replace(plant, mass=plant.mass - load.mass),
        axis.delay.transport,
        axis.elements,
        axis.method,
        _estimator(axis),
        () if load is None else (load,),
        ranges_of(axis.profile, axis.delay, compliant=load is not None),
        axis.limits.effort,
        axis.limits.position or EVERYWHERE,
    )


def _estimator(axis: AxisPlan) -> str:
    """Return the estimator that stability is judged with; an axis without one gets the default."""
    return axis.estimator or (TACHOMETER if axis.integrates else DEFAULT_ESTIMATOR)

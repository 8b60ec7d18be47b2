"""The stability limits of a scene before anything moves, on its bench or on a device given by numbers."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from haptic_fieldbus.defaults import DEFAULT_BUS, DEFAULT_ESTIMATOR, DEFAULT_METHOD, DEFAULT_RATE
from haptic_fieldbus.documents.quantities import RANGES, Quantity
from haptic_fieldbus.errors import raise_all
from haptic_fieldbus.margins import Plant, Stability, stiffness_limit
from haptic_fieldbus.margins.group import Group, Member, groups_of
from haptic_fieldbus.numerals import exactly, rounded_limit
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning.refusal import ExchangeLimit, way_limits
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.planning.selection import at_limit, check_rendering, select, settled
from haptic_fieldbus.protocols.traffic import Delay
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal, Workspace

LARGEST: Mapping[str, float] = {
    "damping": RANGES[Quantity.DAMPING].largest,
    "coulomb": RANGES[Quantity.EFFORT].largest,
    "resolution": RANGES[Quantity.LENGTH].largest,
    "delay": 100.0,
}
"""Largest values of a device; a longer delay would need a model of as many periods."""
UNCERTAIN = 0.7
"""Share of the Coulomb friction for which a report gives the limits too, besides the full friction."""


@dataclass(frozen=True, kw_only=True)
class Device:
    """A device given by numbers instead of a bench; when any of them is given, the others are 0."""

    mass: float | None = None
    """Mass [kg] or inertia [kg·m²]."""
    damping: float | None = None
    """Viscous damping [N·s/m or N·m·s/rad]."""
    coulomb: float | None = None
    """Coulomb friction [N or N·m]."""
    resolution: float | None = None
    """One encoder count [m or rad]."""
    delay: float | None = None
    """Time from sampling until the torque acts [s], without the hold."""

    @property
    def values(self) -> dict[str, float]:
        """Values by their names; empty when the bench is meant."""
        given = vars(self)
        return {name: value or 0.0 for name, value in given.items()} if set(given.values()) != {None} else {}


@dataclass(frozen=True)
class Judgement:
    """The judgement with the smallest margin, the axis in whose units it is, and the group of axes that it is about."""

    scene: Scene
    axis: str
    workspace: Workspace
    stability: Stability
    group: Group
    assumed: tuple[str, ...] = ()
    """Values without a source in the profiles of the judged drives."""
    delays: Mapping[str, Delay] = field(default_factory=dict)
    """Delays of the judged axes by name, in parts; empty for a device."""
    ways: tuple[ExchangeLimit, ...] = ()
    """Limits of all ways in which the buses could exchange; empty where each has one way, and for a device."""

    @property
    def estimator(self) -> str | None:
        """The velocity estimator of the elements or couplings; None when none of them needs the velocity."""
        for member in self.group.members:
            couplings = (each for each in self.group.couplings if member.name in each.axes)
            if any(Signal.VELOCITY in each.needs for each in (*member.elements, *couplings)):
                return member.estimator
        return None

    @property
    def linear_estimator(self) -> str | None:
        """The linear estimator that stands for a non-linear one; None when there is no estimator, or it is linear."""
        if self.estimator is None or self.estimator == TACHOMETER:
            return None
        from haptic_fieldbus.numerics.estimators import linear_stand_in

        return linear_stand_in(self.estimator)


@own_faults()
def judge_scene(task: Task, device: Device | None = None) -> Judgement:
    """Judge the scene on its bench, or on the device if one is given; raises DocumentError, UsageError or PlanError."""
    check_request(bus=task.bus or DEFAULT_BUS, node=task.node, rate=task.rate)
    if device is not None and device.values:
        return _on_device(task, **device.values)
    plan = select(task).plan
    found, delays = way_limits(plan), {axis.name: axis.delay for axis in plan.axes}
    # Axes that are coupled have one judgement, in the units of one of them.
    return _weakest(
        Judgement(plan.scene, axis.name, axis.workspace, axis.stability, axis.group, plan.assumed, delays, found)
        for axis in plan.axes
        if axis.stability is not None and axis.group is not None and axis.group.reference_axis == axis.name
    )


def _weakest(judgements: Iterable[Judgement]) -> Judgement:
    """Return the judgement with the smallest margin; a judgement without a margin comes last."""
    found = list(judgements)
    # The margin of a single one is not asked for: it takes longer than all other values.
    if len(found) == 1:
        return found[0]
    return min(found, key=lambda each: math.inf if (margin := each.stability.margin) is None else margin)


def _on_device(task: Task, *, delay: float, **values: float) -> Judgement:
    """Judge the scene with a device of these values, and ideal torque, on each of its axes."""
    check_rendering(task)
    # The loop counts its period in whole nanoseconds.
    period = round(1e9 / (task.rate or DEFAULT_RATE)) * 1e-9
    plant = _plant_of(period, **values, delay=delay)
    method, estimator = task.method or DEFAULT_METHOD, task.estimator or DEFAULT_ESTIMATOR

    def judgement_of(chosen: Scene) -> Judgement:
        spaces, paced = {axis.name: axis.workspace for axis in chosen.axes}, chosen.at_period(period)
        members = [
            Member(name, plant, delay, paced.of_axis(name), method, estimator, unit=space.stiffness_unit)
            for name, space in spaces.items()
        ]
        return _weakest(
            Judgement(chosen, group.reference_axis, spaces[group.reference_axis], group.stability, group)
            for group in groups_of(members, paced.couplings, period)
        )

    scene, part = settled(task)
    # A stiffness that is a part of the limit takes two steps: the limit first, then the scene with it.
    found = judgement_of(scene)
    return found if part is None else judgement_of(at_limit(task, scene, part, found.stability))


def _plant_of(period: float, *, mass: float, **others: float) -> Plant:
    """Return the plant of a device; raises one UsageError with all values that are impossible."""
    faults = [
        f"{name} {exactly(value)}: expected a number from 0 up, at most {exactly(LARGEST[name])}"
        for name, value in others.items()
        if not 0.0 <= value <= LARGEST[name]
    ]
    masses = RANGES[Quantity.MASS]
    if not masses.smallest <= mass <= masses.largest:
        expected = f"expected a number from {exactly(masses.smallest)} to {exactly(masses.largest)}"
        if not (faults or mass) and others["damping"]:  # then a spring has a limit all the same
            massless = Plant(0.0, others["damping"])
            limit = stiffness_limit(massless, period, others["delay"], lambda stiffness: gain([[-stiffness]]))
            expected += f"; for a mass towards 0 the limit of a spring goes to {rounded_limit(limit)}"
        faults.insert(0, f"mass {exactly(mass)}: {expected}")
    raise_all(faults)
    return Plant(mass, others["damping"], others["coulomb"], others["resolution"])

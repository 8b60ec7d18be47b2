"""The limits of a scene before anything moves, on its bench or on a device that is given by numbers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_fieldbus.axis_plan import DEFAULT_ESTIMATOR, DEFAULT_METHOD
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import (
    EnvironmentOf,
    Plant,
    Stability,
    judge_contact,
    passive_limit_of,
    stiffness_limit,
    weakened,
)
from haptic_fieldbus.margins.contact import environment_of, stiffest_of
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.request import check_request
from haptic_fieldbus.scenes.checked import check_elements
from haptic_fieldbus.scenes.element import AnyElement, Element
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.selection import (
    DEFAULT_DRIVE,
    DEFAULT_RATE,
    Value,
    check_numerics,
    load_scene_with,
    refuse_unknown,
    select,
)
from haptic_fieldbus.signals import Signal, Workspace

if TYPE_CHECKING:  # a scene without couplings does without it
    from haptic_fieldbus.margins.coupled_contact import Tied

UNCERTAIN = 0.7
"""Share of the friction that a limit is told for beside the full one."""


@dataclass(frozen=True)
class Device:
    """A device given by numbers instead of a bench [kg, N·s/m, N, m, s, or their rotary counterparts]."""

    mass: float = 0.0
    damping: float = 0.0
    coulomb: float = 0.0
    resolution: float = 0.0
    delay: float = 0.0


def device_of(**numbers: float | None) -> Device | None:
    """The device of the numbers that are given; None where none is."""
    given = {name: value for name, value in numbers.items() if value is not None}
    return Device(**given) if given else None


@dataclass(frozen=True)
class Judged:
    """The judgement of the axis with the smallest margin, and what it is about."""

    scene: Scene
    axis: str
    workspace: Workspace
    elements: tuple[Element, ...]
    method: str | None
    estimator: str | None
    stability: Stability
    tied: "Tied | None" = None
    """All axes that hang together, where the judgement is of a coupling."""

    @property
    def stiffest(self) -> AnyElement | None:
        """What has the stiffness that is limited."""
        return stiffest_of(self.elements) if self.tied is None else self.tied.stiffest

    @property
    def largest_damping(self) -> float:
        """m/T, about which virtual damping moves the device by as much in a period as it moved."""
        return self.stability.plant.mass / self.stability.period_s if self.tied is None else self.tied.largest_damping

    @property
    def linear_estimator(self) -> str | None:
        """What stands for an estimator that is not linear; None where there is none, or it is linear."""
        elements = (*self.elements, *(self.tied.couplings if self.tied is not None else ()))
        needed = any(Signal.VELOCITY in element.needs for element in elements)
        if self.estimator is None or self.estimator == TACHOMETER or not needed:
            return None
        from haptic_fieldbus.numerics.estimators import judged_as

        return judged_as(self.estimator)

    def environment(self, **changes: float) -> StateSpace:
        """The contact as the loop runs it, the stiffest element changed."""
        estimator = self.estimator or DEFAULT_ESTIMATOR
        return environment_of(self.elements, self.stability.period_s, self.method, estimator, **changes)

    def limit(self, damping: float) -> float:
        """The limit of stability with so much damping in the stiffest element."""
        if self.tied is not None:
            return self.tied.limit(damping)
        told = self.stability
        return stiffness_limit(told.plant, told.period_s, told.delay_s, self._damped(damping))

    def passive_limit(self, damping: float, stable: float) -> float:
        """The same of passivity; `stable` is the limit of stability."""
        if self.tied is not None:
            return self.tied.passive_limit(damping, stable)
        told = self.stability
        return passive_limit_of(told.plant, told.period_s, told.delay_s, self._damped(damping), stable)

    def _damped(self, damping: float) -> EnvironmentOf:
        return lambda stiffness: self.environment(stiffness=stiffness, damping=damping)

    def with_friction(self, share: float) -> Stability:
        """The same judgement with that share of the device's friction."""
        if self.tied is not None:
            return self.tied.weakened(share).judged()[0]
        told = self.stability
        plant = weakened(told.plant, share)
        estimator = self.estimator or DEFAULT_ESTIMATOR
        return judge_contact(plant, told.period_s, told.delay_s, self.elements, self.method, estimator)


def judge_scene(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None = None,
    *,
    drive: str = DEFAULT_DRIVE,
    bus: str | None = None,
    node: int = 1,
    rate: float = DEFAULT_RATE,
    settings: Mapping[str, Value] | None = None,
    method: str | None = None,
    estimator: str | None = None,
    device: Device | None = None,
) -> Judged:
    """Judge the scene on its bench, or on `device` where one is given; `rate` in Hz.

    Raises DocumentError, UsageError or PlanError.
    """
    check_request(bus=bus or "sim", node=node, rate=rate)
    if device is not None:
        return _on_device(scene, device, rate, settings or {}, method, estimator)
    plan = select(
        scene,
        rig,
        drive=drive,
        bus=bus,
        node=node,
        rate=rate,
        settings=settings or {},
        method=method,
        estimator=estimator,
        complete=refuse_unknown,
    ).plan
    judged = [
        Judged(plan.scene, axis.name, axis.workspace, axis.elements, axis.method, axis.estimator, axis.stability)
        for axis in plan.axes
        if axis.stability is not None
    ]
    found = min(judged, key=lambda each: _margin(each.stability))
    return _of_coupling(plan, found) if plan.scene.couplings else found


def _of_coupling(plan: Plan, found: Judged) -> Judged:
    """Told by the axis in whose units the coupling is, with all that hang together."""
    from haptic_fieldbus.coupled_plan import tied_with

    axis = plan.told_by(next(axis for axis in plan.axes if axis.name == found.axis))
    if axis.judged_with is None or axis.stability is None:
        return found
    tied = tied_with(plan.axes, axis, plan.period)
    return replace(found, axis=axis.name, workspace=axis.workspace, stability=axis.stability, tied=tied)


def _margin(stability: Stability) -> float:
    return math.inf if stability.margin is None else stability.margin


def _on_device(
    scene: str | Path | Scene,
    device: Device,
    rate: float,
    settings: Mapping[str, Value],
    method: str | None,
    estimator: str | None,
) -> Judged:
    """Each axis of the scene moves this device; torque is ideal."""
    check_numerics(method, estimator)
    if isinstance(scene, Scene):
        check_elements(scene, 1.0 / rate, method)
    period = round(1e9 / rate) * 1e-9
    plant = _plant_of(device, period)

    def judged(chosen: Scene) -> Judged:
        found = []
        used, velocity = method or DEFAULT_METHOD, estimator or DEFAULT_ESTIMATOR
        groups = _tied_devices(chosen, plant, device.delay, period, used, velocity) if chosen.couplings else {}
        for axis in chosen.axes:
            elements, tied = chosen.at_period(period).of_axis(axis.name), groups.get(axis.name)
            if tied is None:
                verdict = judge_contact(plant, period, device.delay, elements, used, velocity)
            elif tied.told_by == axis.name:
                verdict = tied.judged()[0]
            else:
                continue
            found.append(Judged(chosen, axis.name, axis.workspace, elements, used, velocity, verdict, tied))
        return min(found, key=lambda each: _margin(each.stability))

    return judged(load_scene_with(scene, settings, lambda chosen: judged(chosen).stability))


def _tied_devices(
    scene: Scene, plant: Plant, delay: float, period: float, method: str, estimator: str
) -> "dict[str, Tied]":
    """All that hang together, by the names of their axes, each of which moves this device."""
    from haptic_fieldbus.margins.coupled_contact import Member, Tied, connected

    found: dict[str, Tied] = {}
    for group in connected([axis.name for axis in scene.axes], scene.couplings):
        members = tuple(Member(name, plant, delay, scene.of_axis(name), method, estimator) for name in group)
        tied = Tied(members, tuple(each for each in scene.couplings if each.axes[0] in group), period)
        found |= dict.fromkeys(group, tied)
    return found


def _plant_of(device: Device, period: float) -> Plant:
    """Raises one UsageError with all that cannot be; a mass of zero is refused with the limit that it leads to."""
    values = {name: getattr(device, name) for name in ("damping", "coulomb", "resolution", "delay")}
    faults = [
        f"{name} {value:g}: expected a number from 0 up"
        for name, value in values.items()
        if not 0.0 <= value < math.inf
    ]
    if not 0.0 < device.mass < math.inf:
        faults.insert(0, f"mass {device.mass:g}: expected a number above 0{_massless(device, period, faults)}")
    if faults:
        raise UsageError("\n".join(faults))
    return Plant(device.mass, device.damping, device.coulomb, device.resolution)


def _massless(device: Device, period: float, faults: list[str]) -> str:
    """Where the limit of a plain spring goes as the mass goes to zero."""
    if faults or not device.damping:
        return ""
    plant = Plant(0.0, device.damping)
    limit = stiffness_limit(plant, period, device.delay, lambda stiffness: gain([[-stiffness]]))
    return f"; as it goes to 0, the limit of a spring goes to {limit:.6g}"

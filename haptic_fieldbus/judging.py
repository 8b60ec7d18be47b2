"""The limits of a scene before anything moves, on its bench or on a device that is given by numbers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus.axis_plan import DEFAULT_ESTIMATOR, DEFAULT_METHOD
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Plant, Stability, judge_contact, stiffness_limit, weakened
from haptic_fieldbus.margins.contact import environment_of
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.request import check_request
from haptic_fieldbus.scenes.element import Element
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

    @property
    def linear_estimator(self) -> str | None:
        """What stands for an estimator that is not linear; None where there is none, or it is linear."""
        if self.estimator is None or not any(Signal.VELOCITY in element.needs for element in self.elements):
            return None
        from haptic_fieldbus.numerics.estimators import judged_as

        return judged_as(self.estimator)

    def environment(self, **changes: float) -> StateSpace:
        """The contact as the loop runs it, the stiffest element changed."""
        estimator = self.estimator or DEFAULT_ESTIMATOR
        return environment_of(self.elements, self.stability.period_s, self.method, estimator, **changes)

    def with_friction(self, share: float) -> Stability:
        """The same judgement with that share of the device's friction."""
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
    return min(judged, key=lambda each: _margin(each.stability))


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
    period = round(1e9 / rate) * 1e-9
    plant = _plant_of(device, period)

    def judged(chosen: Scene) -> Judged:
        found = []
        for axis in chosen.axes:
            elements = chosen.of_axis(axis.name)
            used, velocity = method or DEFAULT_METHOD, estimator or DEFAULT_ESTIMATOR
            verdict = judge_contact(plant, period, device.delay, elements, used, velocity)
            found.append(Judged(chosen, axis.name, axis.workspace, elements, used, velocity, verdict))
        return min(found, key=lambda each: _margin(each.stability))

    return judged(load_scene_with(scene, settings, lambda chosen: judged(chosen).stability))


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

"""Bench of the report's loops: the shipped one, with the values of its plan, and the hand that holds it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from haptic_fieldbus import Plan, PlanError, Result, load_scene
from haptic_fieldbus.margins import HAND, Plant, dynamics, dynamics_with, through_torque_loop
from haptic_fieldbus.numerics.linear import Matrix

FEW_SCENES = ("wall", "damped_wall", "sprung_mass", "detents", "lugre", "generalised_maxwell", "virtual_shaft")
"""Scenes of a quick report: one of each sort."""
DEFAULT_ESTIMATOR, DEFAULT_METHOD = "backward-difference", "exact-foh"
"""Default velocity estimator and integrator of a plan."""


def library_scenes() -> list[str]:
    """Return the names of the shipped scenes, sorted."""
    return sorted(path.stem for path in Path(load_scene(FEW_SCENES[0]).source).parent.glob("*.toml"))


@dataclass(frozen=True)
class Tools:
    """Functions `api.run` and `api.plan`, handed in by the caller."""

    run: Callable[..., Result]
    plan: Callable[..., Plan]


@dataclass(frozen=True)
class Bench:
    """Device, delay from sampling to acting [s] and period [s] of one axis."""

    plant: Plant
    delay: float
    period: float


def bench_of(plan: Plan) -> Bench:
    """Return the bench of the plan's first axis; raises PlanError when its mass and friction are unknown."""
    axis = plan.axes[0]
    if axis.plant is None:
        raise PlanError(f"{axis.name}: the report needs a bench whose mass and friction are known")
    return Bench(axis.plant, axis.delay.transport, plan.period)


def device_in_hand(plant: Plant) -> tuple[Matrix, Matrix, Matrix]:
    """Return (A, B of the motor, B of the hand) of a linear device held by a hand; inputs are forces [N].

    The states are position and velocity of the handle, then of the hand. Shapes: `(4, 4)`, `(4, 1)`, `(4, 1)`.
    """
    return *dynamics_with(plant, (HAND,)), np.array([[0.0], [0.0], [0.0], [1.0 / HAND.mass]])


def free(plant: Plant) -> tuple[Matrix, Matrix]:
    """Return (A, B) of the device with a free handle, its torque loop included; states (x, v[, motor force])."""
    return through_torque_loop(*dynamics(plant), plant.torque_lag)


def grounded(plant: Plant) -> tuple[Matrix, Matrix]:
    """Return (A, B) of the device held by a hand that leans on the ground; states (x, v[, motor force])."""
    a, b = dynamics(plant)
    a[1] -= np.array([HAND.stiffness, HAND.damping]) / plant.mass
    return through_torque_loop(a, b, plant.torque_lag)

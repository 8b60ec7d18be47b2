"""Bench of the report's loops: the shipped one, with the values of its plan, and the hand that holds it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.margins import Plant, bodies
from haptic_fieldbus.margins.bodies import HAND
from haptic_fieldbus.margins.plant import dynamics, through_torque_loop
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.planning.plan import Plan

FEW_SCENES = ("wall", "damped_wall", "sprung_mass", "detents", "lugre", "generalised_maxwell", "virtual_shaft")
"""Scenes of a quick report: one of each sort."""


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
    return *bodies.dynamics(plant, (HAND,)), np.array([[0.0], [0.0], [0.0], [1.0 / HAND.mass]])


def free(plant: Plant) -> tuple[Matrix, Matrix]:
    """Return (A, B) of the device with a free handle, its torque loop included; states (x, v[, motor force])."""
    return through_torque_loop(*dynamics(plant), plant.torque_lag)


def grounded(plant: Plant) -> tuple[Matrix, Matrix]:
    """Return (A, B) of the device held by a hand that leans on the ground; states (x, v[, motor force])."""
    a, b = dynamics(plant)
    a[1] -= np.array([HAND.stiffness, HAND.damping]) / plant.mass
    return through_torque_loop(a, b, plant.torque_lag)

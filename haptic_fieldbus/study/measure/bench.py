"""The bench that the report's loops run on: the shipped one, as the plan knows it, and the hand that pushes."""

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
"""One of each sort, for a quick report."""


@dataclass(frozen=True)
class Tools:
    """What the report asks of the layers above it: `api.run` and `api.plan`."""

    run: Callable[..., Result]
    plan: Callable[..., Plan]


@dataclass(frozen=True)
class Bench:
    """Device, delay from sampling to acting [s] and period [s] of one axis."""

    plant: Plant
    delay: float
    period: float


def bench_of(plan: Plan) -> Bench:
    """Of the first axis."""
    axis = plan.axes[0]
    if axis.plant is None:
        raise PlanError(f"{axis.name}: the report needs a bench whose mass and friction are known")
    return Bench(axis.plant, axis.delay.transport, plan.period)


def device_in_hand(plant: Plant) -> tuple[Matrix, Matrix, Matrix]:
    """(A, motor's B, hand's B) of the device in the pushing hand; states (x, v, its hand's x, v), force in N."""
    return *bodies.dynamics(plant, (HAND,)), np.array([[0.0], [0.0], [0.0], [1.0 / HAND.mass]])


def free(plant: Plant) -> tuple[Matrix, Matrix]:
    """(A, B) of the device by itself, its torque loop included."""
    return through_torque_loop(*dynamics(plant), plant.torque_lag)


def grounded(plant: Plant) -> tuple[Matrix, Matrix]:
    """(A, B) of the device held by the hand, which leans on the world; states (x, v[, motor force])."""
    a, b = dynamics(plant)
    a[1] -= np.array([HAND.stiffness, HAND.damping]) / plant.mass
    return through_torque_loop(a, b, plant.torque_lag)

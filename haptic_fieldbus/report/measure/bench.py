"""The bench that the report's loops run on: the shipped one, as the plan knows it, and the hand that pushes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.plant import dynamics, through_torque_loop
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.result import Result
from haptic_fieldbus.sim.hand import Hand, hand_named

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


def pushing_hand() -> Hand:
    """The hand `push`: a mass behind spring and damper."""
    hand = hand_named("push")
    if hand is None:
        raise AssertionError("the hand of that name holds the handle")
    return hand


def held(plant: Plant) -> tuple[Matrix, Matrix, Matrix]:
    """(A, motor's B, hand's B) of the device in the pushing hand; states (x, v, its hand's x, v), force in N."""
    hand, m, b = pushing_hand(), plant.mass, plant.damping
    k_h, b_h, m_h = hand.stiffness, hand.damping, hand.mass
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1.0
    a[1] = [-k_h / m, -(b + b_h) / m, k_h / m, b_h / m]
    a[3] = [k_h / m_h, b_h / m_h, -k_h / m_h, -b_h / m_h]
    return a, np.array([[0.0], [1.0 / m], [0.0], [0.0]]), np.array([[0.0], [0.0], [0.0], [1.0 / m_h]])


def free(plant: Plant) -> tuple[Matrix, Matrix]:
    """(A, B) of the device by itself, its torque loop included."""
    return through_torque_loop(*dynamics(plant), plant.torque_lag)


def grounded(plant: Plant) -> tuple[Matrix, Matrix]:
    """(A, B) of the device held by the hand, which leans on the world; states (x, v[, motor force])."""
    hand, (a, b) = pushing_hand(), dynamics(plant)
    a = a.copy()
    a[1] -= np.array([hand.stiffness, hand.damping]) / plant.mass
    return through_torque_loop(a, b, plant.torque_lag)

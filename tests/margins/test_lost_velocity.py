"""A loop whose velocity estimator cannot follow the handle: it is as stable as without virtual damping, or less.

The oracle is an own derivation of the sampled loop (`tests.margins.test_between_marks`).
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.signal import cont2discrete

from haptic_fieldbus.margins import Stability, Verdict
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.damped_sprung_mass import DampedSprungMass
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import plan_of, scene_of
from tests.margins.test_between_marks import growth, spring

LAZY, QUICK = "levant:lipschitz=20", "levant:lipschitz=1e6"
DAMPING, STILL = 20.0, 1e-9


def damped_wall(estimator: str, stiffness: float = 500.0, damping: float = DAMPING) -> tuple[Plan, Stability]:
    plan = plan_of(scene_of(Wall("handle", stiffness, damping=damping)), estimator=estimator)
    found = plan.axes[0].stability
    assert found is not None
    return plan, found


def limit_by_hand(plan: Plan, law: Callable[[float], tuple[ArrayLike, ...]]) -> float:
    axis = plan.axes[0]
    assert axis.plant is not None
    loop = (axis.plant.mass, axis.plant.damping, axis.plant.torque_lag, axis.delay.transport, plan.period)
    # Handle and body together may stand anywhere: a spectral radius of 1 is no growth.
    return float(brentq(lambda stiffness: growth(loop, law(stiffness)) - 1.0 - STILL, 10.0, 1e5, rtol=1e-9))


def damped(stiffness: float) -> tuple[ArrayLike, ...]:
    """A spring beside a damper on the difference of two positions, 1 ms apart."""
    rate = DAMPING / 1e-3
    return [[0.0]], [[1.0]], [[rate]], [[-stiffness - rate]]


def test_the_limit_is_that_of_the_spring_alone_where_the_velocity_is_lost() -> None:
    plan, found = damped_wall(LAZY)
    assert found.stiffness_limit.stable == pytest.approx(limit_by_hand(plan, spring), rel=1e-6)


def test_the_limit_counts_the_damping_where_the_velocity_follows_all_that_the_motor_can_do() -> None:
    plan, found = damped_wall(QUICK)
    with_damping = limit_by_hand(plan, damped)
    assert with_damping > 1.5 * limit_by_hand(plan, spring)
    assert found.stiffness_limit.stable == pytest.approx(with_damping, rel=1e-6)


def test_a_damping_that_is_too_large_does_not_hide_behind_a_lost_velocity() -> None:
    found = damped_wall(LAZY, 100.0, 2000.0)[1]
    assert found.verdict is Verdict.UNSTABLE
    assert damped_wall(LAZY, 100.0)[1].verdict is not Verdict.UNSTABLE


@pytest.mark.parametrize(("lipschitz", "is_lost"), [(0.98, True), (1.02, False)])
def test_the_velocity_is_lost_below_the_largest_acceleration_of_the_motor(lipschitz: float, *, is_lost: bool) -> None:
    plan, _ = damped_wall(LAZY)
    axis = plan.axes[0]
    assert axis.plant is not None
    most = axis.limits.effort / axis.plant.mass
    plan, found = damped_wall(f"levant:lipschitz={lipschitz * most}")
    law = spring if is_lost else damped
    assert found.stiffness_limit.stable == pytest.approx(limit_by_hand(plan, law), rel=1e-6)
    assert any("with the velocity 0" in step for step in plan.steps) is is_lost


def body(stiffness: float, *, follows: bool) -> tuple[ArrayLike, ...]:
    """A mass of 2 kg behind a spring and a damper of 40 N·s/m; the rate at the handle is a difference, or 0."""
    mass, damping, period = 2.0, 40.0, 1e-3
    rates = [[0.0, 1.0], [-stiffness / mass, -damping / mass]]
    by_handle = [[0.0, 0.0], [stiffness / mass, damping / mass]]
    continuous = [np.array(each) for each in (rates, by_handle, [[stiffness, damping]], [[-stiffness, -damping]])]
    a, b, c, d, _ = cont2discrete(continuous, period, method="foh")
    if not follows:
        return a, b[:, :1], c, d[:, :1]
    # The last position is a state of its own, from which the rate follows.
    before = np.array([[0.0, 0.0, 0.0]])
    moved = np.hstack([a, -b[:, 1:] / period])
    return (
        np.vstack([moved, before]), np.vstack([b[:, :1] + b[:, 1:] / period, [[1.0]]]),
        np.hstack([c, -d[:, 1:] / period]), d[:, :1] + d[:, 1:] / period,
    )  # fmt: skip


@pytest.mark.thorough("judges a mass with two estimators", quick=1)
@pytest.mark.parametrize(("estimator", "follows"), [(LAZY, False), (QUICK, True)])
def test_a_body_of_a_scene_is_judged_without_its_velocity_too(estimator: str, *, follows: bool) -> None:
    plan = plan_of(scene_of(DampedSprungMass("handle", stiffness=300.0, damping=40.0, mass=2.0)), estimator=estimator)
    found = plan.axes[0].stability
    assert found is not None
    limit = limit_by_hand(plan, partial(body, follows=follows))
    assert found.stiffness_limit.stable == pytest.approx(limit, rel=1e-6)
    assert (limit > 40e3) is follows, "it is more than three times as large"

"""Largest stable steps: bisection against the closed forms of the lecture."""

import math

import numpy as np
import pytest

from haptic_fieldbus.margins.steps import euler_step, largest_step, step_radius
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import StateSpace


def oscillator(stiffness: float, mass: float, damping: float = 0.0) -> StateSpace:
    a = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    return StateSpace(a, np.array([[0.0], [stiffness / mass]]), np.array([[1.0, 0.0]]), np.zeros((1, 1)))


@pytest.mark.parametrize("method", METHODS)
def test_an_undamped_oscillator_has_the_limit_that_the_method_claims(method: str) -> None:
    claimed = METHODS[method].oscillator_limit / math.sqrt(200.0 / 0.5)
    found = largest_step(oscillator(200.0, 0.5), method)
    assert found == (pytest.approx(claimed, rel=1e-4) if math.isfinite(claimed) else math.inf)


@pytest.mark.parametrize("damping", [0.1, 3.0, 20.0, 80.0])
def test_forward_eulers_formula_is_where_bisection_ends(damping: float) -> None:
    """T < min(−2·Re s/|s|²)"""
    space = oscillator(200.0, 0.5, damping)
    assert largest_step(space, "forward-euler") == pytest.approx(euler_step(space), rel=1e-5)


def test_forward_euler_diverges_at_every_step_without_damping() -> None:
    space = oscillator(200.0, 0.5)
    assert (largest_step(space, "forward-euler"), euler_step(space)) == (0.0, 0.0)
    for h in (1e-3, 1e-2, 1.0):
        assert step_radius(space, h / 20.0, "forward-euler") == pytest.approx(math.sqrt(1 + h * h), rel=1e-12)


def test_a_damper_of_stiffness_times_period_cancels_the_growth_exactly() -> None:
    period = 1e-3
    space = oscillator(200.0, 0.5, damping=200.0 * period)
    assert step_radius(space, period, "forward-euler") == pytest.approx(1.0, abs=1e-12)
    assert euler_step(space) == pytest.approx(period, rel=1e-9)


def test_what_does_not_move_by_itself_is_stable_at_any_step() -> None:
    still = StateSpace(np.zeros((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    assert (largest_step(still, "forward-euler"), euler_step(still)) == (math.inf, math.inf)


def test_an_unstable_system_has_no_stable_step() -> None:
    assert euler_step(oscillator(200.0, 0.5, damping=-1.0)) == 0.0
    assert largest_step(oscillator(200.0, 0.5, damping=-1.0), "exact-zoh") == 0.0

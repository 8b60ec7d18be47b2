"""Dahl friction against its differential equation and its closed loop."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.relaxation import SAMPLED_EXCESS
from haptic_fieldbus.scenes.dahl import Dahl
from tests.scenes.leaps import along, leaps
from tests.scenes.sheet import Array, Motion, forces, given_to_the_hand, passing, spring_leak

DAHL = Dahl("handle", coulomb=1.5, stiffness=800.0)
STEADY = 1.5 / 800.0


@pytest.mark.parametrize("per_quarter", [3, 50])
def test_it_is_the_differential_equation_at_any_period_when_samples_meet_the_reversals(per_quarter: int) -> None:
    amplitude, turn = 4e-3, 2.0 * math.pi
    time = np.arange(12 * per_quarter + 1) / (4.0 * per_quarter)
    motion = Motion(time[1], amplitude * np.sin(turn * time), amplitude * turn * np.cos(turn * time))

    def rate(t: float, z: Array) -> Array:
        speed = amplitude * turn * math.cos(turn * t)
        return speed - abs(speed) * z / STEADY

    stretch = [np.zeros(1)]
    for span in pairwise(time):
        stretch.append(solve_ivp(rate, span, stretch[-1], rtol=1e-11, atol=1e-15).y[:, -1])
    exact = -800.0 * np.concatenate(stretch)
    np.testing.assert_allclose(forces(DAHL, motion), exact, atol=1e-8)


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("amplitude", [2e-4, 2e-3, 2e-2])
def test_a_cycle_costs_what_the_closed_form_says(amplitude: float) -> None:
    """4·fc·(a − L·tanh(a/L)), once the first cycles are over."""
    cycle = [amplitude, -amplitude] * 60 + [amplitude]
    motion = along(cycle, 1000)
    last = slice(-2001, None)
    work = -given_to_the_hand(
        Motion(1e-3, motion.position[last], motion.velocity[last]), forces(DAHL, motion)[last], held=False
    )
    assert work == pytest.approx(4.0 * 1.5 * (amplitude - STEADY * math.tanh(amplitude / STEADY)), rel=1e-5)


@pytest.mark.thorough("4 cases of one rule", quick=1)
@pytest.mark.parametrize("speed", [1e-3, 1.0, 1e3, 1e9])
def test_it_slides_at_its_friction_at_any_speed(speed: float) -> None:
    found = forces(DAHL, passing(0.0, 0.1 if speed < 1.0 else speed * 0.05, speed))
    assert found[-1] == pytest.approx(-1.5, rel=1e-9)
    assert np.abs(found).max() <= 1.5 * (1.0 + 1e-12)


@settings(derandomize=True)
@given(motion=leaps(5e-3))
def test_it_leaks_when_sampled_no_more_than_it_says_along_any_way(motion: Motion) -> None:
    allowed = SAMPLED_EXCESS * spring_leak(800.0, motion)
    assert given_to_the_hand(motion, forces(DAHL, motion), held=True) <= allowed * (1.0 + 1e-9) + 1e-15


@pytest.mark.parametrize("wrong", [{"coulomb": 0.0}, {"stiffness": -1.0}, {"coulomb": math.nan}, {"damping": 1.0}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Dahl).validate_python({"axis": "handle", "coulomb": 1.0, "stiffness": 600.0, **wrong})

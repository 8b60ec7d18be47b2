"""The pendulum: its swing in closed form, its potential, and the stiffness that stability is told."""

import math

import numpy as np
import pytest
import scipy.integrate
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.element import abilities
from haptic_fieldbus.scenes.pendulum import Pendulum
from haptic_fieldbus.signals import Signal

ARM = Pendulum("handle", torque=0.2, position=0.3)


@pytest.mark.parametrize(("turn", "torque"), [(0.0, 0.0), (0.25, -0.2), (0.5, 0.0), (0.75, 0.2), (1.25, -0.2)])
def test_it_pulls_most_where_it_is_level(turn: float, torque: float) -> None:
    assert ARM.force(0.3 + turn * 2.0 * math.pi) == pytest.approx(torque, abs=1e-15)


@pytest.mark.parametrize("amplitude", [0.1, 1.0, 3.0])
def test_it_swings_with_the_period_of_the_elliptic_integral(amplitude: float) -> None:
    """4·√(J/m·g·l)·K(sin²(θ₀/2)): from rest at θ₀ it is back after one period."""
    inertia = 4e-4
    period = 4.0 * math.sqrt(inertia / 0.2) * scipy.special.ellipk(math.sin(0.5 * amplitude) ** 2)
    found = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], ARM.force(y[0]) / inertia], (0.0, period), [0.3 + amplitude, 0.0], rtol=1e-10, atol=1e-12
    )
    assert found.y[0, -1] == pytest.approx(0.3 + amplitude, abs=1e-6)
    assert found.y[1, -1] == pytest.approx(0.0, abs=1e-4)


@settings(derandomize=True)
@given(angle=st.floats(-10.0, 10.0))
def test_the_work_against_it_is_its_potential(angle: float) -> None:
    work, _ = scipy.integrate.quad(ARM.force, 0.3, angle, limit=200)
    assert -work == pytest.approx(0.2 * (1.0 - math.cos(angle - 0.3)), abs=1e-9)


@settings(derandomize=True)
@given(angle=st.floats(-10.0, 10.0))
def test_nowhere_is_it_stiffer_than_it_states(angle: float) -> None:
    slope = (ARM.force(angle - 1e-6) - ARM.force(angle + 1e-6)) / 2e-6
    assert slope <= ARM.stiffness * (1.0 + 1e-6) + 1e-9


def test_where_it_hangs_it_is_as_stiff_as_it_states() -> None:
    assert (ARM.force(0.3 - 1e-4) - ARM.force(0.3 + 1e-4)) / 2e-4 == pytest.approx(ARM.stiffness, rel=1e-8)
    np.testing.assert_array_equal(ARM.linearised().d, [[-0.2, 0.0]])


def test_it_can_be_given_another_stiffness() -> None:
    assert abilities(ARM).with_stiffness is not None
    assert ARM.with_stiffness(0.7) == Pendulum("handle", torque=0.7, position=0.3)


@pytest.mark.parametrize("angle", [math.nan, math.inf, -math.inf])
def test_an_angle_that_is_no_number_gives_a_torque_that_is_none(angle: float) -> None:
    assert math.isnan(ARM.force(angle))


def test_it_needs_the_angle_alone() -> None:
    assert ARM.needs == (Signal.POSITION,)


@pytest.mark.parametrize("wrong", [{"torque": 0.0}, {"torque": -0.1}, {"position": math.nan}, {"mass": 0.2}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Pendulum).validate_python({"axis": "handle", "torque": 0.2, **wrong})

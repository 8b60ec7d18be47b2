"""The damped sprung mass against a fine integration, and its optional parts."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.scenes.damped_sprung_mass import DampedSprungMass
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.signals import Signal
from tests.lanes import examples

BOTH = DampedSprungMass("handle", stiffness=200.0, mass=0.5, damping=3.0, drag=1.0)


def test_without_damper_and_drag_it_is_the_sprung_mass() -> None:
    plain, bare = SprungMass("handle", 200.0, 0.5), DampedSprungMass("handle", 200.0, 0.5)
    for name in "abcd":
        np.testing.assert_array_equal(getattr(bare.dynamics, name), getattr(plain.dynamics, name))
    assert bare.needs == plain.needs == (Signal.POSITION,)


def test_it_swings_at_its_damped_frequency() -> None:
    """ω_n = √(k/m), ζ = (b + d)/(2·√(k·m)), on a held puck."""
    natural, ratio = 20.0, 4.0 / (2.0 * math.sqrt(200.0 * 0.5))
    expected = natural * complex(-ratio, math.sqrt(1.0 - ratio**2))
    assert max(np.linalg.eigvals(BOTH.dynamics.a), key=lambda pole: pole.imag) == pytest.approx(expected)


@pytest.mark.parametrize(("damping", "drag"), [(3.0, 0.0), (0.0, 2.0), (3.0, 2.0)])
def test_it_follows_the_ordinary_differential_equation(damping: float, drag: float) -> None:
    """m·p̈ = k·(x − p) + b·(ẋ − ṗ) − d·ṗ for a puck that swings off from rest, by scipy: second order."""
    element, turn = DampedSprungMass("handle", 300.0, 0.4, damping, drag), 25.0

    def rates(t: float, z: np.ndarray) -> list[float]:
        x, v = 0.01 * (1.0 - math.cos(turn * t)), 0.01 * turn * math.sin(turn * t)
        return [z[1], (300.0 * (x - z[0]) + damping * (v - z[1]) - drag * z[1]) / 0.4]

    errors = []
    for period in (1e-3, 5e-4):
        times = np.arange(round(0.5 / period) + 1) * period
        solved = solve_ivp(rates, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-11, atol=1e-13, method="DOP853")
        exact = solved.y
        x, v = 0.01 * (1.0 - np.cos(turn * times)), 0.01 * turn * np.sin(turn * times)
        force = 300.0 * (exact[0] - x) + damping * (exact[1] - v)
        law = bind(element.dynamics, period)
        found = [law(a, b) if damping else law(a) for a, b in zip(x.tolist(), v.tolist(), strict=True)]
        errors.append(np.abs(np.array(found) - force).max())
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@settings(derandomize=True, max_examples=examples(50))
@given(
    k=st.floats(1.0, 1e4),
    m=st.floats(1e-3, 10.0),
    b=st.floats(0.0, 50.0),
    d=st.floats(0.0, 50.0),
    w=st.floats(0.1, 1e4),
)
def test_its_impedance_takes_power_at_every_frequency(k: float, m: float, b: float, d: float, w: float) -> None:
    """Passive: the real part of −F/v is from 0 up."""
    space, s = DampedSprungMass("handle", k, m, b, d).dynamics, 1j * w
    motion = np.array([1.0 / s, 1.0])
    force = space.c @ np.linalg.solve(s * np.eye(2) - space.a, space.b @ motion) + space.d @ motion
    assert -force[0].real >= -1e-9 * abs(force[0])


@pytest.mark.parametrize(
    "wrong", [{"damping": -1.0}, {"drag": -1.0}, {"mass": 0.0}, {"stiffness": 0.0}, {"drag": math.inf}]
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(DampedSprungMass).validate_python({"axis": "handle", "stiffness": 200.0, "mass": 0.5, **wrong})

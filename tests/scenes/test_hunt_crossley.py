"""Hunt–Crossley: never a pull, its exit speed, its energy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.signals import Signal

BODY = HuntCrossley("handle", effort=100.0, depth=0.01, exponent=1.5, loss=0.6)
"""k = 1e5 N/m^1.5."""


@settings(derandomize=True)
@given(depth=st.floats(0.0, 1.0), speed=st.floats(-100.0, 100.0))
def test_it_is_the_published_law(depth: float, speed: float) -> None:
    expected = max(0.0, 1e5 * depth**1.5 * (1.0 + 0.6 * speed))
    assert BODY.force(depth, speed) == pytest.approx(-expected, rel=1e-9, abs=1e-300)


@settings(derandomize=True)
@given(
    position=st.floats(-1e308, 1e308),
    speed=st.floats(-1e100, 1e100),
    exponent=st.floats(1.0, 4.0),
    loss=st.floats(0.0, 1e3),
)
def test_it_never_pulls_and_no_number_is_too_large(position: float, speed: float, exponent: float, loss: float) -> None:
    left = HuntCrossley("handle", 5.0, 0.01, exponent=exponent, loss=loss)
    right = HuntCrossley("handle", 5.0, 0.01, exponent=exponent, loss=loss, side="negative")
    assert left.force(position, speed) <= 0.0
    assert right.force(-position, -speed) == -left.force(position, speed)


def test_it_is_continuous_at_the_surface_at_any_speed() -> None:
    """A damped wall jumps there by B·v."""
    assert abs(BODY.force(1e-12, 100.0)) < 1e-9


@pytest.mark.parametrize("speed", [0.1, 1.0, 5.0])
def test_a_thrown_mass_leaves_with_the_speed_of_the_closed_form(speed: float) -> None:
    """p·v − ln(1 + p·v) is equal at entry and exit; the impact by scipy."""

    def rates(t: float, z: np.ndarray) -> list[float]:
        return [z[1], BODY.force(z[0], z[1]) / 0.2]

    def left(t: float, z: np.ndarray) -> float:
        return float(z[0])

    left.terminal, left.direction = True, -1.0  # type: ignore[attr-defined]
    end = solve_ivp(rates, (0.0, 1.0), [1e-15, speed], events=left, rtol=1e-11, atol=1e-14, method="DOP853").y[1, -1]
    entry = 0.6 * speed - math.log1p(0.6 * speed)
    expected = brentq(lambda u: -u - math.log1p(-u) - entry, 0.0, 1.0 - 1e-12, xtol=1e-15) / 0.6
    assert -end == pytest.approx(expected, rel=1e-7)
    assert -end < min(speed, 1.0 / 0.6)


@settings(derandomize=True)
@given(depth=st.floats(0.0, 0.1), speed=st.floats(-10.0, 10.0))
def test_it_takes_power_whenever_its_spring_does_not_give_it_back(depth: float, speed: float) -> None:
    spring = HuntCrossley("handle", 100.0, 0.01)
    assert BODY.force(depth, speed) * speed <= spring.force(depth) * speed + 1e-12


def test_its_spring_is_as_steep_at_the_stated_depth_as_stability_is_told() -> None:
    """By difference quotients of the law."""
    step = 1e-7
    slope = (BODY.force(0.01 + step, 0.0) - BODY.force(0.01 - step, 0.0)) / (2.0 * step)
    damping = (BODY.force(0.01, step) - BODY.force(0.01, -step)) / (2.0 * step)
    np.testing.assert_allclose(BODY.linearised().d, [[slope, damping]], rtol=1e-6)
    assert BODY.stiffness == pytest.approx(-slope)


def test_another_stiffness_scales_its_force_and_nothing_else() -> None:
    twice = BODY.with_stiffness(2.0 * BODY.stiffness)
    assert twice.force(0.003, 0.4) == pytest.approx(2.0 * BODY.force(0.003, 0.4))
    assert twice.stiffness == pytest.approx(2.0 * BODY.stiffness)


def test_its_work_is_the_integral_of_its_force() -> None:
    work = quad(lambda d: -BODY.force(d, 0.0), 0.0, 0.02)[0]
    assert work == pytest.approx(1e5 * 0.02**2.5 / 2.5)


def test_it_needs_the_velocity_only_for_its_loss() -> None:
    assert BODY.needs == (Signal.POSITION, Signal.VELOCITY)
    assert HuntCrossley("handle", 1.0, 0.01).needs == (Signal.POSITION,)


def test_what_is_no_number_is_handed_on() -> None:
    assert math.isnan(BODY.force(math.nan, 0.0))
    assert math.isnan(BODY.force(0.01, math.nan))


@pytest.mark.parametrize(
    "wrong", [{"exponent": 0.9}, {"exponent": 5.0}, {"effort": 0.0}, {"depth": 0.0}, {"loss": -0.1}]
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(HuntCrossley).validate_python({"axis": "handle", "effort": 4.0, "depth": 0.01, **wrong})

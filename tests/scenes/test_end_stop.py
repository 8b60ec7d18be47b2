"""End stops: two mirrored walls, silence between, and bounces as physics has them."""

import math

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

STOP = EndStop("handle", stiffness=800.0, lower=-0.03, upper=0.05, damping=6.0)


@settings(derandomize=True)
@given(position=st.floats(-0.1, 0.1), velocity=st.floats(-5.0, 5.0))
def test_it_is_two_walls(position: float, velocity: float) -> None:
    upper = Wall("handle", stiffness=800.0, position=0.05, damping=6.0)
    lower = Wall("handle", stiffness=800.0, position=-0.03, damping=6.0, side="negative")
    assert STOP.force(position, velocity) == upper.force(position, velocity) + lower.force(position, velocity)


@settings(derandomize=True)
@given(position=st.floats(-0.03, 0.05), velocity=st.floats(-1e9, 1e9))
def test_between_its_ends_it_is_exactly_silent(position: float, velocity: float) -> None:
    assert STOP.force(position, velocity) == 0.0


@settings(derandomize=True)
@given(beyond=st.floats(1e-9, 1e3), velocity=st.floats(-1e3, 1e3))
def test_it_never_pulls_outwards_nor_keeps_a_handle_that_leaves(beyond: float, velocity: float) -> None:
    assert STOP.force(0.05 + beyond, velocity) <= 0.0 <= STOP.force(-0.03 - beyond, velocity)


def test_a_mass_bounces_between_its_ends_without_loss_when_it_does_not_damp() -> None:
    """Half a swing of √(m/K) at either end: there and back takes 2·(w/v + π·√(m/K))."""
    stop = EndStop("handle", stiffness=800.0, lower=-0.03, upper=0.05)
    mass, speed = 0.5, 0.4
    period = 2.0 * (0.08 / speed + math.pi * math.sqrt(mass / 800.0))
    found = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], stop.force(y[0]) / mass], (0.0, period), [0.0, speed], rtol=1e-9, atol=1e-12, max_step=1e-3
    )
    np.testing.assert_allclose(found.y[:, -1], [0.0, speed], atol=1e-6)


def test_damping_takes_from_the_bounce_what_the_closed_form_says() -> None:
    """A unilateral spring-damper that may not pull: it leaves where K·d + B·ḋ = 0."""
    mass, speed = 0.5, 0.4
    turn, decay = math.sqrt(800.0 / mass), 6.0 / (2.0 * mass)
    damped = math.sqrt(turn**2 - decay**2)
    # d = v/ω_d·e^(−δt)·sin ω_d t; K·d + B·ḋ = −m·d̈ vanishes where the acceleration does
    leaves = (math.pi - math.atan2(2.0 * decay * damped, turn**2 - 2.0 * decay**2)) / damped
    exit_speed = (
        speed * math.exp(-decay * leaves) * (math.cos(damped * leaves) - decay / damped * math.sin(damped * leaves))
    )
    found = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], STOP.force(y[0], y[1]) / mass],
        (0.0, 0.25),
        [0.04, speed],
        rtol=1e-10,
        atol=1e-13,
        max_step=2e-4,
    )
    assert found.y[1, -1] == pytest.approx(exit_speed, rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 6.0])
def test_a_place_that_is_no_number_gives_a_force_that_is_none(damping: float) -> None:
    stop = EndStop("handle", stiffness=800.0, lower=-0.03, upper=0.05, damping=damping)
    assert math.isnan(stop.force(math.nan, *([0.0] if damping else [])))


def test_it_asks_for_velocity_only_when_it_has_damping() -> None:
    assert STOP.needs == (Signal.POSITION, Signal.VELOCITY)
    assert EndStop("handle", stiffness=800.0, lower=-0.03, upper=0.05).needs == (Signal.POSITION,)


def test_stability_is_judged_by_the_contact() -> None:
    np.testing.assert_array_equal(STOP.linearised().d, [[-800.0, -6.0]])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"lower": 0.05}, "lower 0.05: expected less than upper, 0.05"),
        ({"lower": 0.1}, "expected less than upper"),
        ({"stiffness": 0.0}, "greater than"),
        ({"damping": -1.0}, "greater than or equal to 0"),
        ({"position": 0.0}, "position"),
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, float], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        TypeAdapter(EndStop).validate_python({"axis": "handle", "stiffness": 8.0, "lower": 0.0, "upper": 0.05, **wrong})

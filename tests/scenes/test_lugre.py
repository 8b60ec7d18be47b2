"""LuGre friction against its differential equation, its steady sliding, and its bounds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.relaxation import SAMPLED_EXCESS
from haptic_fieldbus.scenes.dahl import Dahl
from haptic_fieldbus.scenes.lugre import LuGre
from haptic_fieldbus.signals import Signal
from tests.scenes.leaps import leaps
from tests.scenes.sheet import Array, Motion, forces, given_to_the_hand, spring_leak

FULL = LuGre("handle", coulomb=1.0, stiffness=800.0, breakaway=1.6, stribeck=0.05, damping=8.0, viscous=0.5)
PERIOD = 1e-3


def level(speed: float) -> float:
    return 1.0 + 0.6 * math.exp(-((speed / 0.05) ** 2))


def force(stretch: float, speed: float) -> float:
    """The law of the paper, with the damping that falls with speed."""
    damping = min(8.0, level(speed) / abs(speed)) if speed else 8.0
    rate = speed - 800.0 * abs(speed) * stretch / level(speed)
    return -(800.0 * stretch + damping * rate + 0.5 * speed)


def test_at_constant_speeds_it_is_the_differential_equation_at_any_of_them() -> None:
    """Periods of 1 ms from creeping to 2.5 times the speed at which the explicit bristle explodes, both ways."""
    speeds = [1e-4, 0.01, -0.03, 0.2, 5.0, -12.5, -12.5, 1e-3, 0.06, -2.0, 0.0, 3.0]
    stretch, position, exact, places = 0.0, 0.0, [0.0], [0.0]
    for speed in speeds:
        found = solve_ivp(
            lambda t, z, v: v - 800.0 * abs(v) * z / level(v),
            (0.0, PERIOD),
            [stretch],
            args=(speed,),
            rtol=1e-12,
            atol=1e-16,
        )
        stretch, position = found.y[0, -1], position + speed * PERIOD
        exact.append(force(stretch, speed))
        places.append(position)
    motion = Motion(PERIOD, np.array(places), np.array([0.0, *speeds]))
    np.testing.assert_allclose(forces(FULL, motion), exact, rtol=1e-8, atol=1e-10)


def test_it_tends_to_the_differential_equation_as_the_period_shrinks() -> None:
    """First order, as the speed that g takes is that of the end of each period."""
    turn, amplitude = 2.0 * math.pi, 0.01

    def rate(t: float, z: Array) -> Array:
        speed = amplitude * turn * math.cos(turn * t)
        return speed - 800.0 * abs(speed) * z / level(speed)

    solution = solve_ivp(rate, (0.0, 1.0), [0.0], rtol=1e-10, atol=1e-14, max_step=1e-3, dense_output=True).sol
    errors: list[float] = []
    for steps in (400, 1600, 6400):
        time = np.linspace(0.0, 1.0, steps + 1)
        speed = amplitude * turn * np.cos(turn * time)
        found = forces(FULL, Motion(1.0 / steps, amplitude * np.sin(turn * time), speed))
        exact = [force(float(z), float(v)) for z, v in zip(solution(time)[0], speed, strict=True)]
        errors.append(float(np.abs(found - exact).max()))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)
    assert errors[2] < 2e-3


@pytest.mark.parametrize("speed", [1e-3, 0.02, 0.05, 0.5, 30.0, -0.02, -0.5])
def test_sliding_steadily_it_follows_stribeck_s_curve(speed: float) -> None:
    """After a decimetre, at whatever period it takes."""
    places: Array = math.copysign(5e-5, speed) * np.arange(2001.0)
    found = forces(FULL, Motion(5e-5 / abs(speed), places, np.full(len(places), speed)))
    assert found[-1] == pytest.approx(-math.copysign(level(speed), speed) - 0.5 * speed, rel=1e-9)


def test_with_no_part_that_needs_velocity_it_is_dahl_s() -> None:
    plain = LuGre("handle", coulomb=1.5, stiffness=800.0, breakaway=1.5)
    places = 0.01 * np.sin(np.arange(200) / 7.0)
    motion = Motion(PERIOD, places, np.zeros(200))
    np.testing.assert_array_equal(forces(plain, motion), forces(Dahl("handle", 1.5, 800.0), motion))


def test_its_dampers_do_without_stribeck_s_fall() -> None:
    law = LuGre("handle", coulomb=1.0, stiffness=800.0, damping=8.0, viscous=0.5).begin(PERIOD)
    assert law(0.0, 0.05) == pytest.approx(-0.4 - 0.025)
    assert law(1.0, 0.05) == pytest.approx(-1.0 - 0.025)


@settings(derandomize=True)
@given(
    moves=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40),
    speeds=st.lists(st.floats(-1e9, 1e9) | st.floats(-0.1, 0.1), min_size=40, max_size=40),
)
def test_all_but_its_viscous_part_is_bounded_by_breakaway_at_any_speed(moves: list[float], speeds: list[float]) -> None:
    """Whatever the estimated speed has to do with the way."""
    law, place = FULL.begin(PERIOD), 0.0
    for move, speed in zip(moves, speeds, strict=False):
        place += move
        found = law(place, speed)
        assert abs(found + 0.5 * speed) <= 1.6 * (1.0 + 1e-12) + 1e-15 * abs(speed)


@settings(derandomize=True)
@given(speed=st.floats(-50.0, 50.0), share=st.floats(-1.0, 1.0))
def test_it_takes_more_than_it_stores_at_every_speed_and_stretch(speed: float, share: float) -> None:
    """−F·v ≥ d(½·σ0·z²)/dt, with the stretch brought about by a first way of the bristle at breakaway."""
    law = FULL.begin(PERIOD)
    law(0.0, 0.0)
    way = -math.log1p(-abs(share) * (1.0 - 1e-9)) * 1.6 / 800.0
    place = math.copysign(way, share)
    stretch = -law(place, 0.0) / 800.0
    rate = speed - 800.0 * abs(speed) * stretch / level(speed)
    assert -law(place, speed) * speed >= 800.0 * stretch * rate - 1e-9


def test_a_constant_damping_of_the_bristle_would_give_energy() -> None:
    """Purpose of the fall of σ1: a bristle at breakaway that is suddenly fast; the same inequality, broken."""
    stretch, speed = 1.6 / 800.0, 5.0
    rate = speed - 800.0 * speed * stretch / level(speed)
    constant = -(800.0 * stretch + 8.0 * rate + 0.5 * speed)
    assert -constant * speed < 800.0 * stretch * rate
    assert -force(stretch, speed) * speed > 800.0 * stretch * rate


@settings(derandomize=True)
@given(motion=leaps(5e-3))
def test_without_dampers_it_leaks_when_sampled_no_more_than_its_bristle(motion: Motion) -> None:
    """Whatever an estimate says of the speed."""
    bristle = LuGre("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, stribeck=0.05)
    allowed = SAMPLED_EXCESS * spring_leak(800.0, motion)
    assert given_to_the_hand(motion, forces(bristle, motion), held=True) <= allowed * (1.0 + 1e-9) + 1e-15


@pytest.mark.parametrize("nan", [(math.nan, 0.0), (0.0, math.nan)])
def test_what_is_no_number_gives_a_force_that_is_none(nan: tuple[float, float]) -> None:
    law = FULL.begin(PERIOD)
    law(0.0, 0.0)
    assert math.isnan(law(*nan))


def test_it_asks_for_velocity_only_for_parts_that_use_it() -> None:
    for parts in ({"damping": 1.0}, {"viscous": 1.0}, {"breakaway": 2.0, "stribeck": 0.1}):
        given = {"axis": "handle", "coulomb": 1.0, "stiffness": 800.0, **parts}
        assert TypeAdapter(LuGre).validate_python(given).needs == (Signal.POSITION, Signal.VELOCITY)
    assert LuGre("handle", 1.0, 800.0, stribeck=0.1).needs == (Signal.POSITION,)
    np.testing.assert_array_equal(FULL.linearised().d, [[-800.0, -8.5]])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"breakaway": 0.5}, "breakaway 0.5: expected 0, or at least coulomb, 1"),
        ({"breakaway": 1.5}, "stribeck 0: expected a speed above 0, as breakaway is above coulomb"),
        ({"coulomb": -1.0}, "greater than"),
        ({"stiffness": math.nan}, "finite"),
        ({"viscous": -0.1}, "greater than or equal to 0"),
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        TypeAdapter(LuGre).validate_python({"axis": "handle", "coulomb": 1.0, "stiffness": 600.0, **wrong})

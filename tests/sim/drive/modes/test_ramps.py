"""Ramps in closed form, against integration of what they say and against the least time of control theory."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.sim.drive.modes.mode import RampMotion, to_distance, to_velocity

SPEEDS = st.floats(-100.0, 100.0)
RATES = st.floats(0.5, 500.0)
POSITIVE = st.floats(0.1, 100.0)


def _sampled(motion: RampMotion, count: int = 2001) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    times = np.linspace(0.0, motion.end * 1.1 + 1e-3, count)
    rows = np.array([motion.at(float(time)) for time in times])
    return times, rows[:, 0], rows[:, 1], rows[:, 2]


@given(SPEEDS, SPEEDS, RATES, RATES)
def test_speed_grows_by_the_acceleration_and_falls_by_the_deceleration(
    v0: float, v1: float, a: float, b: float
) -> None:
    motion = to_velocity(v0, v1, a, b)
    same_way = abs(v1 - v0) / (a if abs(v1) > abs(v0) else b)
    expected = abs(v0) / b + abs(v1) / a if v0 * v1 < 0.0 else same_way
    assert motion.end == pytest.approx(expected)
    assert motion.at(0.0)[1] == pytest.approx(v0, abs=1e-9) or motion.end == 0.0
    assert motion.at(motion.end)[1] == v1


@given(SPEEDS, st.floats(-1000.0, 1000.0), POSITIVE, RATES, RATES)
def test_a_way_ends_at_rest_at_its_distance_within_its_limits(
    v0: float, distance: float, speed: float, a: float, b: float
) -> None:
    motion = to_distance(v0, distance, speed, a, b)
    times, position, velocity, acceleration = _sampled(motion)
    assert motion.at(motion.end * 2 + 1) == (distance, 0.0, 0.0)
    assert np.abs(velocity).max() <= max(speed, abs(v0)) + 1e-6
    assert np.abs(acceleration).max() <= max(a, b) + 1e-9
    step = times[1] - times[0]
    # What is told fits together: positions change by the mean of the speeds, but for the jerks inside a step.
    slack = max(a, b) * step * step + 1e-9
    assert np.abs(np.diff(position) - 0.5 * (velocity[1:] + velocity[:-1]) * step).max() <= slack
    assert np.abs(np.diff(velocity)).max() <= max(a, b) * step + 1e-9


@pytest.mark.parametrize(
    ("distance", "speed", "expected"),
    [
        (8.0, 2.0, 1.0 + 3.0 + 1.0),  # trapezium: 1 s up over 1, 3 s at 2, 1 s down over 1
        (-8.0, 2.0, 5.0),
        (0.5, 2.0, 1.0),  # triangle: twice sqrt(d/a)
        (2.0, 2.0, 2.0),  # the profile velocity is just reached
    ],
)
def test_times_of_symmetric_profiles(distance: float, speed: float, expected: float) -> None:
    assert to_distance(0.0, distance, speed, 2.0, 2.0).end == pytest.approx(expected)


@given(st.floats(0.01, 1000.0), RATES, RATES)
def test_a_way_without_speed_limit_takes_the_least_time(distance: float, a: float, b: float) -> None:
    """Bang-bang: t = sqrt(2·d·(1/a + 1/b)) (Pontryagin)."""
    expected = math.sqrt(2 * distance * (1 / a + 1 / b))
    assert to_distance(0.0, distance, 1e9, a, b).end == pytest.approx(expected)


def test_what_cannot_stop_in_time_comes_back() -> None:
    motion = to_distance(10.0, 1.0, 5.0, 10.0, 10.0)  # stops after 1 s at 5, then 4 back
    assert motion.at(1.0)[:2] == pytest.approx((5.0, 0.0), abs=1e-12)
    assert motion.at(100.0) == (1.0, 0.0, 0.0)


def test_what_moves_away_turns_round_first() -> None:
    assert to_distance(-10.0, 1.0, 5.0, 10.0, 10.0).at(1.0)[0] == pytest.approx(-5.0)


def test_what_is_too_fast_slows_down_to_the_profile_velocity() -> None:
    motion = to_distance(10.0, 20.0, 5.0, 10.0, 10.0)
    assert motion.at(0.5)[1] == pytest.approx(5.0)
    assert motion.at(0.6)[1] == pytest.approx(5.0)
    assert motion.at(100.0) == (20.0, 0.0, 0.0)


def test_without_profile_velocity_it_only_stops() -> None:
    assert to_distance(4.0, 100.0, 0.0, 2.0, 2.0).at(10.0) == pytest.approx((4.0, 0.0, 0.0))


def test_no_way_is_no_motion() -> None:
    assert to_distance(0.0, 0.0, 1.0, 1.0, 1.0).end == 0.0

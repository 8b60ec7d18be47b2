"""The predicted wall: exact at constant speed, crossings included, and of third order in the period otherwise."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.scenes.predicted_wall import PredictedWall
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.builders import plan_of, scene_of
from tests.lanes import examples
from tests.scenes.sheet import Motion, forces, given_to_the_hand

PERIOD = 1e-3
WALL = PredictedWall("handle", stiffness=600.0)
places, speeds = st.floats(-3e-3, 3e-3), st.floats(-2.0, 2.0)


@settings(derandomize=True)
@given(position=places, speed=speeds)
def test_its_force_is_the_mean_of_the_walls_over_the_coming_period(position: float, speed: float) -> None:
    """By quadrature of a plain wall along the straight way."""
    plain = Wall("handle", stiffness=600.0)
    kink = [-position / speed] if speed and 0.0 < -position / speed < PERIOD else None
    mean = quad(lambda s: plain.force(position + speed * s), 0.0, PERIOD, points=kink, epsabs=1e-13)[0] / PERIOD
    assert WALL.force(position, speed) == pytest.approx(mean, abs=1e-9)


@settings(derandomize=True)
@given(position=st.floats(2e-3, 0.1), speed=speeds)
def test_inside_it_looks_half_a_sample_ahead(position: float, speed: float) -> None:
    """F = −K·(x + v·T/2), Gillespie and Cutkosky."""
    assert WALL.force(position, speed) == pytest.approx(-600.0 * (position + speed * PERIOD / 2.0), rel=1e-12)


@settings(derandomize=True, max_examples=examples(40))
@given(phase=st.floats(0.0, 1.0), speed=st.floats(0.01, 2.0), side=st.sampled_from([-1.0, 1.0]))
def test_a_visit_at_constant_speed_gives_no_energy_and_takes_none(phase: float, speed: float, side: float) -> None:
    """In and out, crossing at any phase of the sample; a plain wall leaks K·(v·T)²/2 and more."""
    wall = PredictedWall("handle", stiffness=600.0, side="positive" if side > 0.0 else "negative")
    way_in = np.arange(-2, 30) + phase
    position = side * speed * PERIOD * np.concatenate([way_in, way_in[-1] - 1.0 - np.arange(40)])
    velocity = np.append(np.diff(position), np.diff(position)[-1]) / PERIOD
    motion = Motion(PERIOD, position, velocity)
    held = given_to_the_hand(motion, forces(wall, motion), held=True)
    scale = 0.5 * 600.0 * (speed * PERIOD) ** 2
    assert held == pytest.approx(0.0, abs=1e-9 * scale * 900.0)
    plain = Wall("handle", stiffness=600.0, side=wall.side)
    given_away = given_to_the_hand(motion, forces(plain, motion), held=True)
    assert given_away > 30.0 * scale


@pytest.mark.parametrize("period", [1e-3, 5e-4])
def test_the_leak_of_a_swing_shrinks_with_the_square_of_the_period(period: float) -> None:
    """Third order a period, second order along a motion: half the period, a quarter or less; the plain wall a half."""

    def leak(wall: object, step: float) -> float:
        time = np.arange(round(1.0 / step) + 1) * step
        motion = Motion(step, 0.01 * np.sin(12.0 * time), 0.12 * np.cos(12.0 * time))
        return abs(given_to_the_hand(motion, forces(wall, motion), held=True) - stored(motion.position[-1]))

    def stored(position: float) -> float:
        return -0.5 * 600.0 * max(0.0, position) ** 2

    def ahead(step: float) -> PredictedWall:
        return PredictedWall("handle", stiffness=600.0, lead=step / 2.0)

    plain = Wall("handle", stiffness=600.0)
    assert leak(ahead(period), period) / leak(ahead(period / 2.0), period / 2.0) >= 3.0
    assert leak(plain, period) / leak(plain, period / 2.0) == pytest.approx(2.0, rel=0.05)
    assert leak(ahead(period), period) < 0.02 * leak(plain, period)


@settings(derandomize=True)
@given(depth=st.floats(1e-5, 1.9e-3), speed=st.floats(-2.0, -0.01))
def test_deadbeat_release_drops_the_force_of_a_handle_that_will_be_out(depth: float, speed: float) -> None:
    """Else it is the same wall; what it keeps is what the spring has stored there."""
    dead = PredictedWall("handle", stiffness=600.0, release="deadbeat")
    leaves = depth + speed * PERIOD <= 0.0
    assert dead.force(depth, speed) == (0.0 if leaves else WALL.force(depth, speed))
    if leaves:
        whole = -WALL.force(depth, speed) * abs(speed) * PERIOD
        assert whole == pytest.approx(0.5 * 600.0 * depth**2, rel=1e-9)


def test_deadbeat_release_still_meets_a_handle_that_comes() -> None:
    dead = PredictedWall("handle", stiffness=600.0, release="deadbeat")
    assert dead.force(-1e-4, 0.5) == WALL.force(-1e-4, 0.5) < 0.0


@settings(derandomize=True)
@given(position=st.floats(-0.1, 0.1), speed=st.floats(-5.0, 5.0), damping=st.floats(0.0, 20.0))
def test_it_never_pulls(position: float, speed: float, damping: float) -> None:
    wall = PredictedWall("handle", stiffness=600.0, damping=damping)
    mirrored = PredictedWall("handle", stiffness=600.0, damping=damping, side="negative")
    assert wall.force(position, speed) <= 0.0
    assert mirrored.force(-position, -speed) == -wall.force(position, speed)


@pytest.mark.parametrize("values", [(1e308, 1e308), (-1e308, 1e308), (1e308, -1e308), (5e-324, -5e-324)])
def test_extreme_numbers_raise_nothing(values: tuple[float, float]) -> None:
    assert not math.isnan(WALL.force(*values))


def test_it_needs_the_velocity() -> None:
    assert WALL.needs == (Signal.POSITION, Signal.VELOCITY)


def test_stability_is_judged_by_the_prediction_as_the_damping_that_it_is() -> None:
    """By a backward difference F = −K·(1.5·x_k − 0.5·x_{k−1}): passive while b > K·T/2 + |B|, B = K·T/2."""
    mass, damping = 0.63, 1.58
    member = Member("handle", Plant(mass, damping), 0.0, (WALL,), None, "backward-difference")
    found = Group((member,), (), PERIOD).stability.stiffness_limit
    assert found.passive == pytest.approx(damping / PERIOD, rel=1e-6)
    assert found.stable is not None
    decay = math.exp(-damping * PERIOD / mass)
    way = mass / damping * (1.0 - decay)
    pushed, kicked = (PERIOD - way) / damping, (1.0 - decay) / damping
    for factor, stable in ((0.999, True), (1.001, False)):
        k = factor * found.stable
        now = np.array([[1.0, way, 0.0], [0.0, decay, 0.0], [1.0, 0.0, 0.0]])
        rows = now - k * np.outer([pushed, kicked, 0.0], [1.5, 0.0, -0.5])
        assert bool(np.abs(np.linalg.eigvals(rows)).max() < 1.0) is stable


def speed_gained(force: Callable[[float, float], float], phase: float) -> float:
    """Of a free mass thrown at the surface with 0.4 m/s, so much of a sample before it; exact between samples."""
    x, v, mass = -phase * 0.4 * PERIOD, 0.4, 0.5
    for _ in range(200):
        push = force(x, v)
        x, v = x + v * PERIOD + 0.5 * push / mass * PERIOD**2, v + push / mass * PERIOD
    return abs(-v / 0.4 - 1.0)


def test_a_thrown_mass_comes_back_as_fast_as_it_went_with_the_true_velocity() -> None:
    phases = np.linspace(0.0, 1.0, 11)
    plain = max(speed_gained(Wall("handle", 2000.0).force, phase) for phase in phases)
    predicted = max(speed_gained(PredictedWall("handle", 2000.0).force, phase) for phase in phases)
    assert plain > 0.05
    assert predicted < 0.1 * plain


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("rate", [500.0, 1000.0, 2000.0])
def test_in_a_loop_it_looks_ahead_by_half_a_period_unless_told_otherwise(rate: float) -> None:
    """F = −K·(x + v·T/2) inside: the damping that stability sees is K·T/2."""
    (found,) = plan_of(scene_of(PredictedWall("handle", stiffness=600.0)), rate).axes[0].elements
    np.testing.assert_allclose(found.linearised().d, [[-600.0, -600.0 * 0.5 / rate]])
    told = PredictedWall("handle", stiffness=600.0, lead=0.002)
    assert plan_of(scene_of(told), rate).axes[0].elements == (told,)

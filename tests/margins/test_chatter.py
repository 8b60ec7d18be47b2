"""Chatter over the edge of a count: the bound on its speed and the largest found, against another simulation."""

import math

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.numerics.batch import Running, loops
from haptic_fieldbus.scenes.standard_linear_solid import StandardLinearSolid
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.cases.friction import chatter_speed, edge_chatter
from tests.loops import LAG, PERIOD, wall
from tests.margins.events import Bench
from tests.margins.laws import Array, Condition, Law, Zener

STEP = 1e-5
STARTS = (0.0, 0.03, -0.03, 0.1, -0.1, 0.3, -0.3, 1.0, -1.0)
"""Speeds of the knocks from which cycles are looked for, in steps of the encoder per period."""
SETTLED, WATCHED = 15_000, 1000
"""Periods until a cycle has settled, and periods in which its amplitude is read."""


def weighted_speed(plant: Plant, delay: float, stiffness: float, speeds: Array) -> Array:
    """∫v²/∫|v| over the last 1000 of 6000 periods of a handle pressed to the edge and knocked with these speeds.

    Coulomb friction ends slips within a period, so v is read 16 times in each.
    """
    one = np.ones(len(speeds))
    spring = Condition(np.arange(len(speeds)), 0.0 * one, stiffness * one, 0.0 * one, 0.0 * one, np.inf * one)
    bench = Bench(
        plant.mass * one, plant.damping * one, PERIOD, delay * one, 0.0 * one, np.inf * one, plant.coulomb * one,
        plant.resolution * one, 0.0 * one, 0.0 * one, 1.5 * stiffness * plant.resolution * one,
    )  # fmt: skip
    squares, ways = bench.speeds(Law(len(speeds), [spring]), 1.5 * plant.resolution * one, speeds, 6000, 1000)
    return np.asarray(squares / np.maximum(ways, 1e-30))


def test_the_bound_is_that_of_the_theory() -> None:
    plant = Plant(2.0, 10.0, 0.001, STEP)
    assert chatter_speed(plant, PERIOD, 0.0, 600.0) == pytest.approx((600.0 * STEP / 2 - 0.001) / (10.0 - 0.3))
    assert chatter_speed(plant, PERIOD, 2e-3, 600.0) == pytest.approx((600.0 * STEP / 2 - 0.001) / (10.0 - 1.5))


def test_friction_that_bridges_half_a_count_leaves_none_and_light_damping_no_bound() -> None:
    assert chatter_speed(Plant(2.0, 10.0, 600.0 * STEP / 2, STEP), PERIOD, 0.0, 600.0) == 0.0
    assert chatter_speed(Plant(2.0, 0.2, 0.001, STEP), PERIOD, 0.0, 600.0) == math.inf
    assert chatter_speed(Plant(2.0, 0.45, 0.001, STEP, LAG), PERIOD, 0.0, 600.0) < math.inf
    assert chatter_speed(Plant(2.0, 0.35, 0.001, STEP, LAG), PERIOD, 0.0, 600.0) == math.inf


@pytest.mark.thorough("simulates 10 drawn loops from 9 starts")
@pytest.mark.parametrize("seed", range(10))
def test_no_motion_that_lasts_is_faster_than_the_bound(seed: int) -> None:
    random = np.random.default_rng(seed)
    damping, delay = 10.0 ** random.uniform(0.0, 1.2), float(random.choice([0.0, 0.4e-3, 2e-3]))
    stiffness = damping / (0.5 * PERIOD + np.ceil(delay / PERIOD) * PERIOD) * random.uniform(0.2, 0.9)
    coulomb = 0.5 * stiffness * STEP * float(random.choice([0.0, 0.2, 0.5, 1.05]))
    plant = Plant(10.0 ** random.uniform(-1.0, 0.3), damping, coulomb, STEP)
    bound = chatter_speed(plant, PERIOD, delay, float(stiffness))
    found = weighted_speed(plant, delay, float(stiffness), np.array(STARTS) * STEP / PERIOD)
    assert (found <= 1.02 * bound + 1e-9).all()


def largest_chatter(plant: Plant, period: float, delay: float, stiffness: float, damping: float = 0.0) -> float:
    """Return the largest amplitude [m or rad] of a handle pressed to the edge of a count, found from `STARTS`.

    The contact is a spring with a damper by backward difference; times in s.
    """
    step = plant.resolution
    many = loops(
        mass=plant.mass, damping=plant.damping, period=period, delay=delay, stiffness=stiffness,
        virtual_damping=damping, resolution=step, coulomb=plant.coulomb, push=1.5 * stiffness * step,
        position=1.5 * step, velocity=[start * step / period for start in STARTS],
    )  # fmt: skip
    running = Running(many)
    running.advance(SETTLED)
    least, most = np.full(len(STARTS), math.inf), np.full(len(STARTS), -math.inf)
    for _ in range(WATCHED):
        running.advance(1)
        least, most = np.minimum(least, running.state[0]), np.maximum(most, running.state[0])
    return float((most - least).max()) / 2.0


@pytest.mark.thorough("searches two loops from 9 starts", quick=0)
@pytest.mark.parametrize(("mass", "damping", "delay"), [(0.63, 1.58, 0.0), (0.1, 5.0, 0.3e-3)])
def test_the_largest_found_is_no_smaller_than_the_estimate_and_may_be_larger(
    mass: float, damping: float, delay: float
) -> None:
    plant = Plant(mass, damping, 0.0, STEP)
    found, estimate = largest_chatter(plant, PERIOD, delay, 600.0), edge_chatter(plant, PERIOD, delay, wall(600.0))
    assert estimate is not None
    assert 0.8 * estimate.amplitude < found < 4.0 * estimate.amplitude


@pytest.mark.parametrize(("share", "verdict"), [(0.4, Verdict.STABLE), (0.6, Verdict.LIMIT_CYCLE)])
def test_friction_must_hold_tissue_with_memory_and_a_wall_together(share: float, verdict: Verdict) -> None:
    """Each is softer than 2·fc/D; once "stable", where the handle keeps hopping over the edge of a count."""
    plant, step = Plant(0.5, 20.0, 0.05, 1e-4), 1e-4
    stiffness = share * 2.0 * plant.coulomb / step
    elements = StandardLinearSolid("a", stiffness, 0.1 * stiffness, 0.01), Wall("a", stiffness)
    member = Member("a", plant, 0.0, elements, None, "backward-difference", effort=94.0)
    assert Group((member,), (), PERIOD).stability.verdict is verdict

    pushes = np.linspace(5.0, 5.5, 16)
    rows, one = np.arange(len(pushes)), np.ones(len(pushes))
    solid = Zener(rows, -10.0 * one, stiffness * one, ((0.1 * stiffness * one, 0.01 * one),), PERIOD)
    spring = Condition(rows, -10.0 * one, stiffness * one, 0.0 * one, 0.0 * one, np.inf * one)
    bench = Bench(
        plant.mass * one, plant.damping * one, PERIOD, 0.0 * one, 0.0 * one, np.inf * one, plant.coulomb * one,
        step * one, 0.0 * one, 0.0 * one, 20.0 * stiffness + pushes,
    )  # fmt: skip
    squares, _ = bench.speeds(Law(len(pushes), [solid, spring]), pushes / (2.0 * stiffness), 0.0 * one, 1500, 300)
    assert (squares.max() > 0.0) == (verdict is Verdict.LIMIT_CYCLE)

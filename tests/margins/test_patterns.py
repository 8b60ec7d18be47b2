"""Missing frames against the same loop run step by step, and against the bound for light damping."""

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant, sample, stiffness_limit
from haptic_fieldbus.margins.linear import gaps, pattern_bound, pattern_growth, pattern_limit, pattern_matrix
from haptic_fieldbus.numerics.sampled import spectral_radius
from tests.loops import BENCH, LAG, PERIOD, Array, motion_over, sprung_mass, wall, with_damping

PATTERNS = {
    "none lost": (1,),
    "every second": (2,),
    "one of three": (1, 2),
    "two in a row of five": (1, 1, 3),
    "a gap of ten in a hundred": (*[1] * 90, 10),
}


def by_hand(plant: Plant, delay: int, stiffness: float, damping: float, lengths: tuple[int, ...]) -> Array:
    """The map of a whole pattern, one event after the other; state: [x, v, motor, x at the last sample, forces]."""

    def run(state: Array) -> Array:
        motion, before, forces = state[:3], state[3], list(state[4:])
        for length in lengths:
            for place in range(length):
                if place == 0:
                    forces.insert(0, -stiffness * motion[0] - damping * (motion[0] - before) / PERIOD)
                    before = motion[0]
                else:
                    forces.insert(0, forces[0])
                motion = motion_over(plant, PERIOD) @ [*motion, forces[delay]]
                forces.pop()
        return np.array([*motion, before, *forces])

    return np.array([run(unit) for unit in np.eye(5 + delay)]).T


@pytest.mark.thorough("20 cases of one rule", quick=7)
@pytest.mark.parametrize("lengths", PATTERNS.values(), ids=PATTERNS)
@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_the_limit_is_where_the_loop_run_step_by_step_begins_to_grow(
    lengths: tuple[int, ...], delay: int, damping: float
) -> None:
    plant = Plant(0.63, 1.58, torque_lag=LAG)
    limit = pattern_limit(plant, PERIOD, delay * PERIOD, with_damping(damping), gaps(lengths))
    below, above = (
        spectral_radius(by_hand(plant, delay, limit * part, damping, lengths)) for part in (1 - 1e-6, 1 + 1e-6)
    )
    assert below < 1.0 < above


@pytest.mark.parametrize("lengths", PATTERNS.values(), ids=PATTERNS)
def test_for_light_damping_the_gaps_count_by_their_squares(lengths: tuple[int, ...]) -> None:
    limit = pattern_limit(Plant(5.0, 0.5), PERIOD, 0.0, wall, gaps(lengths))
    assert limit == pytest.approx(pattern_bound(0.5, PERIOD, gaps(lengths)), rel=5e-3)


def test_one_gap_of_ten_in_a_hundred_costs_a_third_of_the_stiffness_of_the_bench() -> None:
    lossy = pattern_limit(BENCH, PERIOD, 0.33e-3, wall, gaps(PATTERNS["a gap of ten in a hundred"]))
    assert 0.6 < lossy / stiffness_limit(BENCH, PERIOD, 0.33e-3, wall) < 0.7


@pytest.mark.parametrize("delay", [0.0, 0.4, 1.7])
def test_a_pattern_without_a_loss_is_the_plain_loop(delay: float) -> None:
    plain = stiffness_limit(BENCH, PERIOD, delay * PERIOD, with_damping(0.7))
    assert pattern_limit(BENCH, PERIOD, delay * PERIOD, with_damping(0.7), [True]) == pytest.approx(plain, rel=1e-8)


def test_every_second_sample_lost_is_a_loop_of_twice_the_period() -> None:
    twice = stiffness_limit(BENCH, 2 * PERIOD, 0.3 * PERIOD, wall)
    assert pattern_limit(BENCH, PERIOD, 0.3 * PERIOD, wall, gaps((2,))) == pytest.approx(twice, rel=1e-8)


def test_a_virtual_mass_may_be_left_anywhere_with_frames_missing_too() -> None:
    device, environment = sample(BENCH, PERIOD, 0.0), sprung_mass(0.5, "exact-foh")(100.0)
    assert spectral_radius(pattern_matrix(device, environment, gaps((1, 2)))) == pytest.approx(1.0, abs=1e-12)
    assert pattern_growth(device, environment, gaps((1, 2))) < 1.0 - 1e-6

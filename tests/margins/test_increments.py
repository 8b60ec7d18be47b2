"""Conditions of passivity for a damper that an estimator drives, and of friction beside an encoder."""

import pytest

from haptic_fieldbus.margins import Plant, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.passivity import Increments, weight
from haptic_fieldbus.numerics.estimators import bind
from haptic_fieldbus.scenes.wall import Wall

PERIOD = 1e-3
DEVICE = Plant(0.1, 2.0)


def alone(plant: Plant, estimator: str, damping: float) -> Group:
    return Group((Member("a", plant, 0.0, (Wall("a", 1000.0, damping=damping),), None, estimator),), (), PERIOD)


@pytest.mark.parametrize("estimator", ["backward-difference", "kalman-velocity", "kalman-acceleration"])
def test_a_damper_counts_by_what_its_estimator_makes_of_single_moves(estimator: str) -> None:
    """(b − B·Σ|w|)/(T/2), with the weights w of the running estimator, which it gives after a single move."""
    running = bind(estimator, PERIOD)
    answers = [running(place) for place in [0.0] * 5 + [1.0] * 300]
    moduli = PERIOD * sum(map(abs, answers))
    assert weight(estimator, PERIOD) == pytest.approx(moduli, rel=1e-6)
    limit = alone(DEVICE, estimator, 0.5).stability.stiffness_limit.passive
    assert limit == pytest.approx((2.0 - 0.5 * moduli) / (0.5 * PERIOD), rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_friction_bridges_half_a_count_of_position_and_one_of_velocity(damping: float) -> None:
    count = 1e-5
    needed = 0.5 * 1000.0 * count + damping * count / PERIOD
    for share, verdict in ((1.001, Verdict.PASSIVE), (0.999, Verdict.LIMIT_CYCLE if not damping else Verdict.STABLE)):
        plant = Plant(0.1, 2.0, share * needed, count)
        assert alone(plant, "backward-difference", damping).stability.verdict is verdict
        assert Increments(1000.0, damping).rounding_is_bridged(plant, PERIOD) == (share > 1.0)

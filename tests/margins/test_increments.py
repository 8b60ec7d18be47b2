"""Conditions of passivity for a damper that an estimator drives, and of friction beside an encoder."""

import math
from dataclasses import replace

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


@pytest.mark.parametrize(
    ("estimator", "period"),
    [
        ("low-pass:pole=0.999", 1e-3),
        ("low-pass:pole=0.985,order=8", 2.5e-4),
        ("filtered-derivative:tau=0.5", 2.5e-4),
        ("moving-average:window=256", 1e-3),
        ("kalman-velocity:index=1e-6", 1e-3),
    ],
)
def test_the_weights_of_a_slow_estimator_are_summed_to_their_end(estimator: str, period: float) -> None:
    """A move of 1 has an answer whose integral is 1, as that of a velocity has; so the moduli are at least 1."""
    running = bind(estimator, period)
    answers = [running(place) for place in [0.0, *[1.0] * 60_000]]
    assert weight(estimator, period) == pytest.approx(period * sum(map(abs, answers)), rel=1e-3)
    assert weight(estimator, period) >= 1.0 - 1e-6


def test_a_filter_of_many_seconds_has_no_sum() -> None:
    assert weight("low-pass:pole=0.9999,order=8", 1e-3) == math.inf


def test_a_damper_by_a_slow_filter_is_not_called_passive() -> None:
    """A spring hand of 227 N/m makes the loop grow: the filter turns the damper against the motion."""
    plant = Plant(0.5, 1.0)
    slow = Member("a", plant, 0.0, (Wall("a", 0.5, damping=3.5),), None, "low-pass:pole=0.985,order=8")
    held = replace(slow, elements=(Wall("a", 227.5, damping=3.5),))
    assert Group((held,), (), 2.5e-4).growth() > 1.0
    assert Group((slow,), (), 2.5e-4).stability.verdict is not Verdict.PASSIVE

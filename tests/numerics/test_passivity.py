"""Passivity against the sum over all aliases, frequency by frequency."""

import math

import numpy as np
import pytest

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.passivity import damping_needed, frequency_response, hold, largest_gain
from haptic_fieldbus.numerics.sampled import environment
from tests.loops import PERIOD, wall

ANGLES = (0.05, 0.3, 1.0, 2.5, math.pi)
LAGS = (0.0, 1.6e-4, 2e-3)


def by_aliases(force: complex, angle: float, delay: float, lag: float, count: int = 200_000) -> float:
    """Least b with b·∫v² ≥ ∫f·v for motions at ω and all its aliases: largest eigenvalue of a form of rank two."""
    omega = (angle + 2 * math.pi * np.arange(-count, count + 1)) / PERIOD
    z = np.exp(1j * angle)
    motor = np.exp(-1j * omega * delay) / (1 + 1j * omega * lag) * (1 - 1 / z) / (1j * omega)
    position = 1 / (1j * omega)
    along = force * np.sum(position * motor) / PERIOD
    product = np.sum(np.abs(motor) ** 2) * np.sum(np.abs(position) ** 2) / PERIOD**2
    return float(0.5 * (along.real + math.sqrt(max(0.0, abs(force) ** 2 * product - along.imag**2))))


@pytest.mark.thorough("60 searches for the worst motion", quick=8)
@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0, 1.7])
@pytest.mark.parametrize("lag", LAGS)
def test_the_damping_needed_is_that_of_the_worst_motion_of_all_aliases(angle: float, delay: float, lag: float) -> None:
    for force in (complex(-700.0, 30.0), complex(-100.0, -900.0), complex(50.0, 400.0)):
        behind = hold(np.array([angle]), PERIOD, delay * PERIOD, lag)
        along = force * complex(behind.displacement[0])
        found = 0.5 * (along.real + math.sqrt(abs(force) ** 2 * behind.spread[0] + along.real**2))
        expected = by_aliases(force, angle, delay * PERIOD, lag)
        assert found == pytest.approx(expected, abs=3e-6 * abs(force) * PERIOD)


@pytest.mark.parametrize("seed", range(5))
def test_a_spring_is_hardest_at_low_frequency(seed: int) -> None:
    """Basis of `margins.passive_limit`."""
    random = np.random.default_rng(seed)
    angle = np.concatenate([np.geomspace(1e-5, 0.1, 50), np.linspace(0.1, math.pi, 200)])
    for _ in range(100):
        delay, lag = random.uniform(0.0, 12.0) * PERIOD, 10 ** random.uniform(-3.0, 2.0) * PERIOD
        behind = hold(angle, PERIOD, delay, lag)
        along = -behind.displacement.real
        needed = along + np.sqrt(behind.spread + along**2)
        assert needed.max() <= needed[0] * (1 + 1e-7)


@pytest.mark.parametrize("delay", [0.0, 0.4, 2.3])
@pytest.mark.parametrize("lag", LAGS)
def test_a_lag_that_vanishes_is_no_lag(delay: float, lag: float) -> None:
    angle = np.array(ANGLES)
    tiny, none = hold(angle, PERIOD, delay * PERIOD, 1e-9), hold(angle, PERIOD, delay * PERIOD)
    np.testing.assert_allclose(tiny.displacement, none.displacement, atol=1e-8)
    np.testing.assert_allclose(tiny.spread, none.spread, atol=2e-12)


@pytest.mark.parametrize("delay", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("lag", LAGS)
def test_the_largest_gain_needs_all_the_damping_there_is(delay: float, lag: float) -> None:
    base, added = wall(0.0, 0.4), gain([[-1.0]])
    found = largest_gain(base, added, 1.58, PERIOD, delay * PERIOD, lag)
    assert damping_needed(wall(found, 0.4), PERIOD, delay * PERIOD, lag) == pytest.approx(1.58, rel=1e-7)


def test_a_gain_that_costs_nothing_has_no_limit() -> None:
    assert largest_gain(gain([[0.0]]), gain([[0.0]]), 1.0, PERIOD, 0.0) == math.inf


def test_no_gain_is_passive_where_none_of_it_already_is_not() -> None:
    assert largest_gain(wall(0.0, 2.0), gain([[-1.0]]), 1.58, PERIOD, 0.0) == 0.0
    assert largest_gain(wall(0.0), gain([[-1.0]]), 0.0, PERIOD, 0.0) == 0.0


def test_the_response_of_an_environment_is_its_transfer_function() -> None:
    found = frequency_response(
        StateSpace(np.array([[0.8]]), np.array([[0.2]]), np.array([[-3.0]]), np.array([[1.0]])), np.array(ANGLES)
    )
    z = np.exp(1j * np.array(ANGLES))
    np.testing.assert_allclose(found, 1.0 - 0.6 / (z - 0.8), rtol=1e-12)


@pytest.mark.thorough("sums many aliases", quick=1)
@pytest.mark.parametrize(
    ("mass", "stiffness", "damping"),
    [(0.5, 200.0, 0.02), (0.5, 200.0, 2.0), (0.5, 2000.0, 0.002), (1e-3, 2000.0, 0.002), (1e-3, 2000.0, 2e-5)],
)
def test_a_resonance_between_the_points_of_the_sweep_is_found(mass: float, stiffness: float, damping: float) -> None:
    """A virtual mass with little drag, against 400 000 angles around its resonance."""
    space = StateSpace(
        np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]]), np.array([[0.0, 0.0], [stiffness / mass, 0.0]]),
        np.array([[stiffness, 0.0]]), np.array([[-stiffness, 0.0]]),
    )  # fmt: skip
    found = environment(space, period=PERIOD, method="exact-foh", estimator=None)
    mode = complex(np.linalg.eigvals(found.a)[0])
    wide = np.linspace(0.5, 1.5, 200_000) * abs(np.angle(mode))
    close = abs(np.angle(mode)) + (1.0 - abs(mode)) * np.linspace(-100.0, 100.0, 200_000)
    angle = np.concatenate([wide, close, np.geomspace(1e-4, 0.1, 10_000)])
    angle = angle[(angle > 0.0) & (angle <= math.pi)]
    force, behind = frequency_response(found, angle), hold(angle, PERIOD, 0.4e-3)
    along = (force * behind.displacement).real
    brute = 0.5 * float((along + np.sqrt(np.abs(force) ** 2 * behind.spread + along**2)).max())
    assert damping_needed(found, PERIOD, 0.4e-3) == pytest.approx(brute, rel=1e-6)

"""Position from velocity by the trapezoid, and its two issues, measured."""

import math

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.estimators.tachometer import VelocityIntegrator, bind_position
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.transfer import TransferFunction, transfer_function
from tests.numerics.substitution import substituted

PERIOD = 1e-3
STEP = 0.004
"""Of the velocity [m/s]."""
TRAPEZOID = StateSpace(np.eye(1), np.full((1, 1), PERIOD), np.eye(1), np.full((1, 1), 0.5 * PERIOD))
"""The same as a linear system v_k → x_k, from v = 0 before the first sample."""


def test_is_the_trapezoidal_rule() -> None:
    velocity = np.sin(np.arange(500) * 0.03)
    step = bind_position(PERIOD, start=0.2)
    expected = 0.2 + scipy.integrate.cumulative_trapezoid(velocity, dx=PERIOD, initial=0.0)
    np.testing.assert_allclose([step(v) for v in velocity.tolist()], expected, rtol=1e-12)


def test_its_system_is_the_trapezoidal_substitution_of_an_integrator() -> None:
    ours = transfer_function(TRAPEZOID)
    expected = substituted(TransferFunction((1.0,), (1.0, 0.0)), PERIOD, "trapezoidal")
    assert ours.num == pytest.approx(expected.num)
    assert ours.den == expected.den


def test_its_system_runs_as_the_step() -> None:
    step, system, state = bind_position(PERIOD), TRAPEZOID, np.zeros(1)
    step(0.0)
    for v in (0.3, -1.0, 2.0):
        expected = float(system.c[0] @ state + system.d[0, 0] * v)
        state = system.a @ state + system.b[:, 0] * v
        assert step(v) == pytest.approx(expected)


def test_a_slow_motion_is_lost_when_velocity_is_rounded() -> None:
    """One second at 0.4 of a step: nothing of the way arrives."""
    step = bind_position(PERIOD)
    found = [step(STEP * round(0.4 * STEP / STEP)) for _ in range(1001)]
    assert found[-1] == 0.0


def test_quantisation_accumulates_at_half_a_step_a_second_when_velocity_is_rounded_down() -> None:
    """A slow sine of several steps; the error grows with time as predicted."""
    step = bind_position(PERIOD)
    times = np.arange(0.0, 60.0, PERIOD)
    velocity = 7.3 * STEP * np.sin(0.9 * times)
    found = np.array([step(STEP * math.floor(v / STEP)) for v in velocity.tolist()])
    error = found - 7.3 * STEP / 0.9 * (1 - np.cos(0.9 * times))
    assert np.polyfit(times, error, 1)[0] == pytest.approx(-0.5 * STEP, rel=0.03)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.25, 0.4, 0.49])
def test_fast_motions_lose_amplitude_as_the_theory_says(share: float) -> None:
    """A sine at that share of the sampling rate."""
    half = math.pi * share
    frequency = 2 * half / PERIOD
    step = bind_position(PERIOD)
    found = [step(math.cos(frequency * n * PERIOD)) for n in range(2000)]
    basis = np.exp(1j * frequency * np.arange(2000) * PERIOD)
    fitted = np.linalg.lstsq(np.stack([basis.real, basis.imag, np.ones(2000)], axis=-1), found, rcond=None)[0]
    assert math.hypot(*fitted[:2]) * frequency == pytest.approx(half / math.tan(half), rel=1e-6)


def test_a_motion_at_the_sampling_rate_looks_like_a_steady_one() -> None:
    """To and fro by 0.16 mm, at each sample at its fastest: the position runs away with 1 m/s."""
    frequency = 2 * math.pi / PERIOD
    step = bind_position(PERIOD)
    found = [step(math.cos(frequency * n * PERIOD)) for n in range(1001)]
    assert found[-1] == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("period", [0.0, -1.0, math.nan])
def test_a_period_that_is_none_is_refused(period: float) -> None:
    with pytest.raises(UsageError, match="above 0"):
        bind_position(period)


def integrated(readings: list[float], times: list[float]) -> VelocityIntegrator:
    found = VelocityIntegrator(PERIOD, STEP)
    found.start(readings[0])
    for reading, time in zip(readings[1:], times[1:], strict=True):
        found.step(reading, time)
    return found


def test_an_integrator_that_misses_no_reading_is_the_trapezoid() -> None:
    readings, step = np.sin(np.arange(500) * 0.03).tolist(), bind_position(PERIOD)
    found = integrated(readings, [PERIOD * number for number in range(500)])
    assert found.position == pytest.approx([step(v) for v in readings][-1], rel=1e-12)
    assert found.drift == pytest.approx(0.5 * STEP * 499 * PERIOD)


def test_a_held_reading_goes_on_until_the_next_replaces_what_it_gave() -> None:
    found = integrated([0.2, 0.4], [0.0, PERIOD])
    before = found.position
    found.hold(2 * PERIOD)
    assert found.position - before == pytest.approx(0.4 * PERIOD)
    found.step(1.0, 3 * PERIOD)
    assert found.position - before == pytest.approx(2 * PERIOD * (0.4 + 1.0) / 2)


def test_a_gap_is_uncertain_by_half_its_length_times_the_change_of_velocity() -> None:
    found = integrated([0.2, 0.8], [0.0, 3 * PERIOD])
    assert found.drift == pytest.approx(3 * PERIOD * (STEP / 2 + 0.6 / 2))


spans = st.tuples(st.sampled_from([1, 1, 1, 2, 3]), st.floats(-1.0, 1.0), st.floats(0.0, 1.0))


@given(st.lists(spans, min_size=1, max_size=200))
def test_no_motion_is_further_off_than_the_drift_says(motion: list[tuple[int, float, float]]) -> None:
    """Straight within a period; over a gap it leaps at any time from one reading to the next."""
    found, true, time, before = VelocityIntegrator(PERIOD, STEP), 0.0, 0.0, 0.0
    found.start(0.0)
    for periods, velocity, leap in motion:
        span = periods * PERIOD
        time += span
        true += span * ((before + velocity) / 2 if periods == 1 else leap * before + (1 - leap) * velocity)
        before = velocity
        found.step(STEP * round(velocity / STEP), time)
    assert abs(found.position - true) <= found.drift * (1 + 1e-9) + 1e-15


def test_the_drift_says_no_more_than_the_worst_motion_is_off() -> None:
    """A velocity of all but half a step is lost period after period."""
    found, speed = VelocityIntegrator(PERIOD, STEP), 0.4999 * STEP
    found.start(0.0)
    for number in range(1, 1001):
        found.step(STEP * round(speed / STEP), number * PERIOD)
    assert found.drift == pytest.approx(1000 * PERIOD * speed, rel=1e-3)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.66])
def test_what_a_period_misses_under_held_forces_does_not_add_up(share: float) -> None:
    """Each force acts from td on: the error after any time depends on the first and the last of them alone."""
    accelerations = np.random.default_rng(3).uniform(-80.0, 80.0, 2000)
    delay, found = share * PERIOD, VelocityIntegrator(PERIOD, 0.0)
    found.start(0.0)
    true = velocity = before = 0.0
    for number, acceleration in enumerate(accelerations.tolist(), start=1):
        rest = PERIOD - delay
        for pull, span in ((before, delay), (acceleration, rest)):
            true += velocity * span + 0.5 * pull * span**2
            velocity += pull * span
        before = acceleration
        found.step(velocity, number * PERIOD)
        assert found.position - true == pytest.approx(0.5 * delay * rest * acceleration, abs=1e-12)

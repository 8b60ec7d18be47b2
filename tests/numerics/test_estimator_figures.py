"""Noise gain and delay of linear estimators, and the filter of velocities in them, against scipy and closed forms."""

import math

import numpy as np
import pytest
from scipy import signal

from haptic_fieldbus.numerics.estimators import ESTIMATORS, bind, discrete
from haptic_fieldbus.numerics.linear import StateSpace, filter_delay, gain, noise_gain, velocity_filter

PERIOD = 0.002
LINEAR = [name for name in ESTIMATORS if discrete(name, PERIOD) is not None]


def system_of(spec: str) -> StateSpace:
    system = discrete(spec, PERIOD)
    assert system is not None
    return system


@pytest.mark.parametrize("spec", ["backward-difference", "moving-average:window=5", "least-squares:window=9,order=2"])
def test_the_noise_gain_of_a_fir_is_the_root_of_the_sum_of_squares_of_its_coefficients(spec: str) -> None:
    step = bind(spec, PERIOD)
    step(0.0)
    coefficients = [step(float(sample == 0)) for sample in range(300)]
    assert coefficients[20:] == [0.0] * 280
    assert noise_gain(system_of(spec)) == pytest.approx(math.sqrt(sum(c * c for c in coefficients)), rel=1e-12)


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9999])
def test_the_noise_gain_of_a_low_pass_is_its_closed_form(pole: float) -> None:
    expected = math.sqrt(2.0 * (1.0 - pole) ** 2 / (PERIOD**2 * (1.0 + pole)))
    assert noise_gain(system_of(f"low-pass:pole={pole}")) == pytest.approx(expected, rel=1e-9)


def test_a_gain_amplifies_noise_as_it_is() -> None:
    assert noise_gain(gain([[-3.0]])) == 3.0


@pytest.mark.parametrize("spec", LINEAR)
def test_an_estimator_of_summed_velocities_is_its_filter(spec: str) -> None:
    velocities = np.random.default_rng(1).normal(size=200)
    step = bind(spec, PERIOD)
    step(0.0)
    expected = [step(x) for x in (PERIOD * np.cumsum(velocities)).tolist()]
    through = velocity_filter(system_of(spec), PERIOD)
    _, found, _ = signal.dlsim((through.a, through.b, through.c, through.d, PERIOD), velocities)
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("spec", LINEAR)
def test_a_velocity_that_rises_steadily_comes_out_so_late(spec: str) -> None:
    """Of the response to a ramp of velocity, by scipy, once it has settled."""
    through = velocity_filter(system_of(spec), PERIOD)
    ramp = PERIOD * np.arange(3000.0)
    _, found, _ = signal.dlsim((through.a, through.b, through.c, through.d, PERIOD), ramp)
    assert ramp[-1] - found[-1, 0] == pytest.approx(filter_delay(through, PERIOD), rel=1e-6, abs=1e-9)

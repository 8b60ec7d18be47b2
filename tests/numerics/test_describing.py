"""Describing functions against Fourier's integral of the nonlinearity itself."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from haptic_fieldbus.numerics import describing
from tests.loops import Array

STEP, LIMIT = 0.3, 0.5
AMPLITUDES = (0.1, 0.149, 0.2, 0.3, 0.46, 1.0, 7.3)


def first_harmonic(nonlinearity: Callable[[Array], Array], amplitude: float, samples: int = 400_000) -> float:
    phase = 2 * math.pi * (np.arange(samples) + 0.5) / samples
    sine = np.sin(phase)
    return float(2.0 * np.mean(nonlinearity(amplitude * sine) * sine) / amplitude)


@pytest.mark.parametrize("amplitude", [0.01, 0.1, 0.29])
def test_the_edge_of_a_count_is_a_relay(amplitude: float) -> None:
    expected = first_harmonic(lambda x: STEP * np.floor(x / STEP), amplitude)
    assert describing.edge(amplitude, STEP) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("amplitude", AMPLITUDES)
def test_cutting_off(amplitude: float) -> None:
    expected = first_harmonic(lambda x: np.clip(x, -LIMIT, LIMIT), amplitude)
    assert describing.saturation(amplitude, LIMIT) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("gain", [0.999, 0.7, 0.1, 1e-3])
def test_the_amplitude_of_a_gain_has_that_gain(gain: float) -> None:
    assert describing.saturation(describing.saturated_amplitude(gain, LIMIT), LIMIT) == pytest.approx(gain, rel=1e-9)


def test_coulomb_friction_takes_the_energy_of_its_equivalent_damping() -> None:
    """4·fc·A a turn, and π·b·ω·A² of a damper."""
    amplitude, turn, friction = 0.02, 30.0, 0.4
    damping = describing.coulomb(amplitude, turn, friction)
    assert math.pi * damping * turn * amplitude**2 == pytest.approx(4 * friction * amplitude)

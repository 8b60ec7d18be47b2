"""The largest stable step of each method: what it claims, and what bisection of its own step finds."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import spectral_radius

LARGEST = 1e3
"""Steps beyond this count as any."""
EXCESS = 1e-7
"""Above 1 by less may be the rounding of a double root."""


@dataclass(frozen=True)
class StepLimit:
    """In units of √(m/k) for the undamped oscillator and of the time constant for a decay; ∞: any step."""

    method: str
    oscillator_claimed: float
    oscillator_measured: float
    lag_claimed: float
    lag_measured: float
    radius: float
    """Of the step at T·ω = 0.1 on the undamped oscillator."""


def oscillator(square: float, damping: float = 0.0) -> StateSpace:
    """p̈ = −square·p − damping·ṗ, the force being p."""
    return StateSpace(
        np.array([[0.0, 1.0], [-square, -damping]]), np.zeros((2, 1)), np.array([[1.0, 0.0]]), np.zeros((1, 1))
    )


def _largest(radius: Callable[[float], float]) -> float:
    """Bisection between 1e-3 and 1e3; 0 when the smallest already grows."""
    low, high = 1e-3, LARGEST
    if radius(low) > 1.0 + EXCESS:
        return 0.0
    if radius(high) <= 1.0 + EXCESS:
        return math.inf
    while high - low > 1e-12 * high:
        middle = math.sqrt(low * high) if high > 2.0 * low else 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) <= 1.0 + EXCESS else (low, middle)
    return low


def step_limit(name: str) -> StepLimit:
    method = METHODS[name]

    def radius(space: StateSpace) -> float:
        return spectral_radius(integrators.discrete(space, 1.0, name).a)

    swing = _largest(lambda h: radius(oscillator(h * h)))
    lag = _largest(lambda h: radius(StateSpace(np.array([[-h]]), np.array([[h]]), np.ones((1, 1)), np.zeros((1, 1)))))
    return StepLimit(name, method.oscillator_limit, swing, method.lag_limit, lag, radius(oscillator(0.1 * 0.1)))

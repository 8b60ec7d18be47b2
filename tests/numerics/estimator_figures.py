"""Figures of linear estimators from their system: how much they amplify noise, how late they are.

- noise gain: white position noise of rms σ gives velocity noise of rms g·σ, g² = Σ h_k² over the impulse response. The
  sum is D² + C·P·Cᵀ with the Lyapunov equation P = A P Aᵀ + B Bᵀ, solved by doubling.
- delay: for slow motions H(e^{sT}) = s·(1 − d·s + …), so d = T²·(½·C R² B − C R³ B) with R = (I − A)⁻¹, which comes
  from H′(1) = −C R² B and H″(1) = 2 C R³ B.

Also from the outside, for those that are no linear system: drive them with noise, or with a constant acceleration.
"""

import math

import numpy as np

from haptic_fieldbus.numerics.estimators.estimator import Estimate
from haptic_fieldbus.numerics.linear import StateSpace

DOUBLINGS = 60
SETTLING = 4000
"""Periods before anything is measured."""


def noise_gain(system: StateSpace) -> float:
    """rms velocity over rms white position noise [1/s]; infinite for an unstable estimator."""
    if system.order and np.abs(np.linalg.eigvals(system.a)).max() >= 1.0:
        return math.inf
    power, covariance = system.a, system.b @ system.b.T
    for _ in range(DOUBLINGS):
        covariance = covariance + power @ covariance @ power.T
        power = power @ power
    variance = system.d @ system.d.T + system.c @ covariance @ system.c.T
    return math.sqrt(float(variance[0, 0]))


def delay(system: StateSpace, period: float) -> float:
    """By how much the velocity of a slow motion is late [s]."""
    once = np.linalg.solve(np.eye(system.order) - system.a, system.b)
    twice = np.linalg.solve(np.eye(system.order) - system.a, once)
    thrice = np.linalg.solve(np.eye(system.order) - system.a, twice)
    return period**2 * float((0.5 * system.c @ twice - system.c @ thrice)[0, 0])


def measured_noise_gain(step: Estimate, sigma: float, samples: int, seed: int = 0) -> float:
    """The same of any estimator, by a standing handle with white noise of rms `sigma` [m or rad] on its position."""
    noise = np.random.default_rng(seed).normal(0.0, sigma, samples + SETTLING)
    velocity = np.array([step(x) for x in noise.tolist()])[SETTLING:]
    return float(np.sqrt(np.mean(velocity**2))) / sigma


def measured_delay(step: Estimate, period: float, resolution: float, speed: float, acceleration: float) -> float:
    """By how much the velocity is late while it rises steadily [s], mean over 400 periods, positions in whole counts.

    The handle moves at `speed` for a while, and then accelerates.
    """
    late = []
    way = 0.0
    for sample in range(SETTLING + 800):
        accelerating = max(0, sample - SETTLING) * period
        way = speed * sample * period + 0.5 * acceleration * accelerating**2
        found = step(resolution * math.floor(way / resolution) if resolution else way)
        if sample >= SETTLING + 400:
            late.append((speed + acceleration * accelerating - found) / acceleration)
    return float(np.mean(late))

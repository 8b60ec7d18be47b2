"""Figures of linear estimators, from the system that `estimators.discrete` returns.

- Noise gain: rms of the output for white noise of rms 1 at the input, √Σ h_k² over the impulse response h. The sum is
  D² + C P Cᵀ with P = Σ Aᵏ B Bᵀ Aᵏᵀ, found by doubling the number of its terms.
- Filter of a velocity: with H(1) = 0 an estimator H of positions is a filter G of velocities, as the position is the
  sum x_n = x_{n−1} + T·v_n. With R = (I − A)⁻¹, (zI − A)⁻¹ = R − (z − 1)(zI − A)⁻¹R, so that G(z) = H(z)·T·z/(z − 1) =
  −T·C R B − T·C A (zI − A)⁻¹ R B: a system with the same A, and G(1) = 1.
- Delay: a slow velocity comes out late by T·Σ k·g_k = T·C R² B of that filter. The backward difference, G = 1, gives
  the mean velocity of a period without delay, and is T/2 late for the velocity at its end. Every estimator has this T/2
  in addition to the delay of its filter.
"""

import math

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix, StateSpace

MOST_DOUBLINGS = 60


def noise_gain(system: StateSpace) -> float:
    """Return the rms output of a stable system for white noise of rms 1, with one input and one output."""
    power, covariance = system.a, system.b @ system.b.T
    for _ in range(MOST_DOUBLINGS):
        if not power.any():
            break
        covariance = covariance + power @ covariance @ power.T
        power = power @ power
    return math.sqrt(float((system.d @ system.d.T + system.c @ covariance @ system.c.T)[0, 0]))


def velocity_filter(system: StateSpace, period: float) -> StateSpace:
    """Return the filter velocity → velocity that an estimator position → velocity contains; `period` in s."""
    resolved: Matrix = np.linalg.solve(np.eye(system.order) - system.a, system.b).astype(np.float64)
    return StateSpace(system.a, resolved, -period * system.c @ system.a, -period * system.c @ resolved)


def filter_delay(system: StateSpace, period: float) -> float:
    """Return the delay of a slow change of velocity in a filter with G(1) = 1 [s]; `period` in s."""
    rest = np.eye(system.order) - system.a
    twice = np.linalg.solve(rest, np.linalg.solve(rest, system.b))
    return period * float((system.c @ twice)[0, 0])

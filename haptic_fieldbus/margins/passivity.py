"""Largest stiffness that is passive with any hand; the theory is in `numerics.passivity`."""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.margins.linear import LARGEST, EnvironmentOf
from haptic_fieldbus.margins.plant import Plant, check_times
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import parallel
from haptic_fieldbus.numerics.passivity import SMALLEST_ANGLE, damping_needed, frequency_response, hold, largest_gain

PROBES = np.array([1e-3, 0.1, 1.0, math.pi])
"""Angles [rad] at which the dependence of an environment on its stiffness is checked."""
LOSSLESS = 1e-9
"""Loss per period below which a mode counts as undamped."""


def passive_limit(plant: Plant, period: float, delay: float) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which a spring is passive; `period` and `delay` in s.

    K = 2·b/(g + √(g² + S)), where g = T/2 + td + λ is the mean age of the motor's force and S its spread within a
    period, δ·(T − δ) without a torque loop. Low frequencies need the most damping and decide. Raises UsageError for
    impossible times.
    """
    check_times(period, delay)
    centre = 0.5 * period + delay + plant.torque_lag
    spread = float(hold(np.array([SMALLEST_ANGLE]), period, delay, plant.torque_lag).spread[0])
    return 2.0 * plant.damping / (centre + math.sqrt(centre**2 + spread))


def passive_limit_of(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf, stable: float) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which an environment is passive; `stable` bounds a search for it.

    0 with a tachometer, and for an environment with an undamped mode: at its resonance the delay makes the force act
    against any damping.
    """
    if plant.tachometer:
        return 0.0
    base, one = environment_of(0.0), environment_of(1.0)
    if _is_proportional(environment_of):  # then the limit has a closed form at each angle
        added = parallel([one, sampled.scaled(base, -1.0)])
        return largest_gain(base, added, plant.damping, period, delay, plant.torque_lag)

    def passive(stiffness: float) -> bool:
        environment = environment_of(stiffness)
        if sampled.spectral_radius(environment.a) > 1.0 - LOSSLESS:
            return False
        return damping_needed(environment, period, delay, plant.torque_lag) <= plant.damping

    return searched(passive, plant.mass / period**2 + plant.damping / period, stable, smallest=1e-6, precision=1e-6)


def searched(
    passive: Callable[[float], bool], scale: float, stable: float, *, smallest: float, precision: float
) -> float:
    """Return the largest stiffness before `passive` first fails on the way up, at most `stable`.

    0 when the smallest stiffness is not passive. The search goes from `smallest` to `LARGEST` times `scale`, an
    m/T² + b/T, to a relative precision of `precision`.
    """
    low, high, largest = 0.0, smallest * min(stable, scale), min(stable, LARGEST * scale)
    while passive(high):
        if high >= largest:
            return stable
        low, high = high, min(4.0 * high, largest)
    while low and high - low > precision * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passive(middle) else (low, middle)
    return low


def _is_proportional(environment_of: EnvironmentOf) -> bool:
    """Return True when the force is a fixed part plus the stiffness times another part, and no mode is undamped."""
    environments = [environment_of(stiffness) for stiffness in (0.0, 1.0, 2.0)]
    if any(sampled.spectral_radius(environment.a) > 1.0 - LOSSLESS for environment in environments):
        return False
    none, one, two = (frequency_response(environment, PROBES) for environment in environments)
    return bool(np.abs(two - 2.0 * one + none).max() <= 1e-9 * np.abs(two - none).max())

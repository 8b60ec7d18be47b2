"""The largest stiffness that is passive with any hand (theory: `numerics.passivity`)."""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.margins.linear import LARGEST, EnvironmentOf
from haptic_fieldbus.margins.plant import Plant, check_times
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import parallel
from haptic_fieldbus.numerics.passivity import SMALLEST_ANGLE, damping_needed, frequency_response, hold, largest_gain

PROBES = np.array([1e-3, 0.1, 1.0, math.pi])
"""[rad]; where an environment is looked at to see how it depends on its stiffness."""
LOSSLESS = 1e-9
"""A mode that loses less than this in a period is undamped."""


def passive_limit(plant: Plant, period: float, delay: float) -> float:
    """The stiffness [N/m or N·m/rad] up to which a spring is passive.

    K = 2·b/(g + √(g² + S)), g = T/2 + td + λ the mean age of the motor's force and S its spread within a period,
    δ·(T − δ) without a torque loop: low frequencies are the hardest.
    """
    check_times(period, delay)
    centre = 0.5 * period + delay + plant.torque_lag
    spread = float(hold(np.array([SMALLEST_ANGLE]), period, delay, plant.torque_lag).spread[0])
    return 2.0 * plant.damping / (centre + math.sqrt(centre**2 + spread))


def passive_limit_of(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf, stable: float) -> float:
    """The stiffness up to which any environment is passive; `stable` bounds it. None is with a tachometer.

    An environment with an undamped mode is passive at no stiffness: at its resonance the delay turns the force against
    every damping.
    """
    if plant.tachometer:
        return 0.0
    base, one = environment_of(0.0), environment_of(1.0)
    if _is_proportional(environment_of):
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
    """The stiffness at which `passive` is first left on the way up, `stable` at most; 0 when the smallest is not.

    Looked for from `smallest` to `LARGEST` times `scale`, an m/T² + b/T, and told within a share of `precision`.
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
    """Whether the force is a part without stiffness plus stiffness times another, and no mode is undamped."""
    environments = [environment_of(stiffness) for stiffness in (0.0, 1.0, 2.0)]
    if any(sampled.spectral_radius(environment.a) > 1.0 - LOSSLESS for environment in environments):
        return False
    none, one, two = (frequency_response(environment, PROBES) for environment in environments)
    return bool(np.abs(two - 2.0 * one + none).max() <= 1e-9 * np.abs(two - none).max())

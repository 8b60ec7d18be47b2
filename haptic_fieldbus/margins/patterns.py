"""Stability when frames are missing in a pattern that repeats.

Where a frame is missing the last force is held, and the environment stands still. A pattern of N periods is one linear
map, the product of its periods; the modulus of its largest eigenvalue decides (Floquet). A held force is the older the
longer it is held, and the gaps count by their squares: with T_i the times between samples, light damping and no delay,

    K < 2·b·ΣT_i/ΣT_i².
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from haptic_fieldbus.margins.linear import EnvironmentOf, limit_of
from haptic_fieldbus.margins.plant import Plant, sample
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import Matrix, StateSpace
from haptic_fieldbus.numerics.sampled import SampledPlant

Pattern = Sequence[bool]
"""One entry a period: whether its frame arrives; repeats for ever. The first must."""


def gaps(lengths: Sequence[int]) -> tuple[bool, ...]:
    """The pattern whose forces are held for so many periods one after the other: (1, 1, 3) loses two frames of five."""
    return tuple(place == 0 for length in lengths for place in range(length))


def pattern_matrix(device: SampledPlant, environment: StateSpace, pattern: Pattern) -> Matrix:
    """The map of a whole pattern, on the states of `sampled.loop_matrix`."""
    periods = {
        received: sampled.loop_matrix(device, environment, received=received, least_memory=1)
        for received in set(pattern)
    }
    matrix = np.eye(len(periods[True]))
    for received in pattern:
        matrix = periods[received] @ matrix
    return matrix


def pattern_growth(device: SampledPlant, environment: StateSpace, pattern: Pattern) -> float:
    """By how much the loop's slowest motion grows in a period, on average; below 1 is stable."""
    matrix = sampled.without_shift(pattern_matrix(device, environment, pattern), device, environment)
    return float(sampled.spectral_radius(matrix) ** (1.0 / len(pattern)))


def pattern_limit(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf, pattern: Pattern) -> float:
    """The stiffness [N/m or N·m/rad] up to which the loop with these missing frames is stable; 0 or ∞ as ever."""
    device = sample(plant, period, delay)
    return limit_of(
        lambda stiffness: pattern_growth(device, environment_of(stiffness), pattern),
        plant.mass / period**2 + plant.damping / period,
    )


def pattern_bound(damping: float, period: float, pattern: Pattern) -> float:
    """K = 2·b·ΣT_i/ΣT_i²: what the limit tends to for light damping, without delay."""
    starts = [place for place, received in enumerate(pattern) if received] + [len(pattern)]
    times = [period * (after - before) for before, after in pairwise(starts)]
    return 2.0 * damping * sum(times) / sum(time**2 for time in times)

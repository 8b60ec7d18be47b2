"""Largest stable stiffness of a sampled loop, by the eigenvalues of one exact period and bisection."""

import math
from collections.abc import Callable

from haptic_fieldbus.numerics.linear import StateSpace

EnvironmentOf = Callable[[float], StateSpace]
"""Function from a stiffness to the discrete environment x_k → F_k."""

SMALLEST, LARGEST = 1e-9, 1e4
"""Range of the search, as multiples of m/T² + b/T.

A stiffness of m/T² + b/T moves the handle by about its own deflection in a period. A loop that is stable at ten
thousand times this stiffness is stable at any: its force no longer depends on the stiffness, as with a virtual mass by
backward Euler. For larger stiffnesses the eigenvalues would show rounding only.
"""
SCAN_FACTOR = math.sqrt(2.0)
"""Ratio of neighbouring stiffnesses of the search."""
ROUNDING = 1e-11
"""Excess of a spectral radius over 1 that may be rounding."""


def limit_of(
    growth: Callable[[float], float], scale: float, *, factor: float = SCAN_FACTOR, precision: float = 1e-10
) -> float:
    """Return the stiffness at which `growth`, the largest modulus of a loop's eigenvalues, first exceeds 1.

    0 when the smallest stiffness is not stable, ∞ when every stiffness is. The search goes from `SMALLEST` to `LARGEST`
    times `scale`, an m/T² + b/T, in steps of `factor`, and ends at a relative `precision`.
    """

    def excess(stiffness: float) -> float:
        return growth(stiffness) - 1.0

    low, high = 0.0, SMALLEST * scale
    while excess(high) <= ROUNDING:
        low, high = high, high * factor
        if high > LARGEST * scale:
            return math.inf
    while low and high - low > precision * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) <= 0.0 else (low, middle)
    return low

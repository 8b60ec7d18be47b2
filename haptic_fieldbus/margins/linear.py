"""Largest stable stiffness of a sampled loop, by the eigenvalues of one exact period: a scan, then a root."""

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
    return crossing(excess, low, high, precision) if low else 0.0


def crossing(excess: Callable[[float], float], low: float, high: float, precision: float) -> float:
    """Return the largest argument known to have no excess, between `low`, which has none, and `high`, which has one.

    Interpolates, and needs at most one evaluation more than bisection where that does not help: the ITP method with
    κ₁ = 0.2/(high − low), κ₂ = 2 and n₀ = 1 (Oliveira and Takahashi, ACM Trans. Math. Softw. 47, 2021,
    doi:10.1145/3423597). Ends at a relative `precision`.
    """
    below, above = min(excess(low), 0.0), excess(high)
    width, tolerance = high - low, 0.5 * precision * high
    most = math.ceil(math.log2(width / (2.0 * tolerance))) + 1
    for step in range(most + 1):
        if high - low <= precision * high:
            break
        middle = 0.5 * (low + high)
        straight = low - below * (high - low) / (above - below)
        towards = math.copysign(1.0, middle - straight)
        shift = min(0.2 * (high - low) ** 2 / width, abs(middle - straight))
        truncated = straight + towards * shift
        reach = tolerance * 2.0 ** (most - step) - 0.5 * (high - low)
        tried = truncated if abs(truncated - middle) <= reach else middle - towards * reach
        if (found := excess(tried)) <= 0.0:
            low, below = tried, found
        else:
            high, above = tried, found
    return low

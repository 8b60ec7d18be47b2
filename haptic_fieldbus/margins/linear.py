"""The largest stable stiffness of the sampled loop: eigenvalues of one exact period, and bisection."""

import math
from collections.abc import Callable

from haptic_fieldbus.numerics.linear import StateSpace

EnvironmentOf = Callable[[float], StateSpace]
"""Stiffness → the discrete environment x_k → F_k."""

SMALLEST, LARGEST = 1e-9, 1e4
"""Of m/T² + b/T, which moves the handle by about its own deflection in a period: the stiffnesses looked at.

What is stable at ten thousand times that is stable at any: force no longer follows from stiffness there, as that of a
virtual mass by backward Euler, and further up the eigenvalues would tell of rounding alone.
"""
SCAN_FACTOR = math.sqrt(2.0)
ROUNDING = 1e-11
"""A spectral radius this little above 1 may be the rounding of 1."""


def limit_of(growth: Callable[[float], float], scale: float) -> float:
    """The stiffness at which `growth`, largest modulus of a loop's eigenvalues, first passes 1.

    0 when the smallest stiffness already is not stable, ∞ when any is.
    Looked for from `SMALLEST` to `LARGEST` times `scale`, an m/T² + b/T.
    """

    def excess(stiffness: float) -> float:
        return growth(stiffness) - 1.0

    low, high = 0.0, SMALLEST * scale
    while excess(high) <= ROUNDING:
        low, high = high, high * SCAN_FACTOR
        if high > LARGEST * scale:
            return math.inf
    while low and high - low > 1e-10 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) <= 0.0 else (low, middle)
    return low

"""The largest stable step of each method on a system of its own, by formula and by bisection.

A method multiplies a mode of eigenvalue s by its growth(s·T) in a step; forward Euler's 1 + s·T stays within the unit
circle for T < min(−2·Re s/|s|²), which is 0 for an undamped oscillator: it diverges for every T > 0, and a virtual
damper b = k·T cancels its growth exactly. That a method is stable says nothing about the sampled loop around it.
"""

import math

import numpy as np

from haptic_fieldbus.numerics import integrators
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import spectral_radius

ROUNDING = 1e-11
"""A spectral radius this little above 1 may be the rounding of 1 at a double eigenvalue."""
SMALLEST, LARGEST = 1e-4, 1e4
"""Steps looked at, in units of the fastest mode's 1/|s|."""


def step_radius(space: StateSpace, period: float, method: str) -> float:
    """By how much one step of a method makes its slowest motion grow, without input."""
    return spectral_radius(integrators.discrete(space, period, method).a)


def largest_step(space: StateSpace, method: str) -> float:
    """The longest period [s] up to which every step is stable, by bisection; 0 for none, ∞ for any."""
    rate = float(np.abs(np.linalg.eigvals(space.a)).max(initial=0.0))
    if not rate:
        return math.inf

    def is_stable(step: float) -> bool:
        return step_radius(space, step / rate, method) <= 1.0 + ROUNDING

    low, high = 0.0, SMALLEST
    while is_stable(high):
        low, high = high, 1.5 * high
        if high > LARGEST:
            return math.inf
    while low and high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_stable(middle) else (low, middle)
    return low / rate


def euler_step(space: StateSpace) -> float:
    """The same for forward Euler by its formula, min(−2·Re s/|s|²) over the poles s; a pole at 0 bounds nothing."""
    poles = [pole for pole in np.linalg.eigvals(space.a).tolist() if pole]
    return max(0.0, min((-2.0 * pole.real / abs(pole) ** 2 for pole in poles), default=math.inf))

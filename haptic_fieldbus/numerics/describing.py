"""Describing functions: the gain of a nonlinearity for the first harmonic of a sine of amplitude A.

They predict a limit cycle well when the loop around the nonlinearity is a low-pass filter. They give no higher
harmonics.

Reference: Gelb & Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, McGraw-Hill 1968,
appendix B.
"""

import math


def edge(amplitude: float, step: float) -> float:
    """Return the gain of rounding to multiples of `step`, for a sine around the edge between two multiples.

    The sine must not be wider than a step. Rounding is then a relay of ±step/2.
    """
    return 2.0 * step / (math.pi * amplitude)


def saturation(amplitude: float, limit: float) -> float:
    """Return the gain of a saturation at ±`limit`; 1 when the amplitude does not reach it."""
    if amplitude <= limit:
        return 1.0
    ratio = limit / amplitude
    return 2.0 / math.pi * (math.asin(ratio) + ratio * math.sqrt(1.0 - ratio**2))


def saturated_amplitude(gain: float, limit: float) -> float:
    """Return the amplitude at which `saturation` has this gain, 0 < gain < 1."""
    # Bisection; a large amplitude is cut to a square wave, whose gain 4·limit/(π·A) bounds the amplitude from above.
    low, high = limit, 4.0 * limit / (math.pi * gain)
    while high - low > 1e-14 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if saturation(middle, limit) > gain else (low, middle)
    return high


def coulomb(amplitude: float, angular_frequency: float, friction: float) -> float:
    """Return the viscous damping 4·fc/(π·ω·A) [N·s/m or N·m·s/rad] equivalent to Coulomb friction in A·sin(ωt)."""
    return 4.0 * friction / (math.pi * angular_frequency * amplitude)

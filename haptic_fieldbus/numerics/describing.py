"""Describing functions: the gain of a nonlinearity for the first harmonic of a sine of amplitude A.

Gelb & Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, McGraw-Hill 1968, appendix B. They
predict a limit cycle well where the loop around is a low-pass filter, and say nothing about its higher harmonics.
"""

import math


def edge(amplitude: float, step: float) -> float:
    """Rounding to multiples of `step`, for a sine centred on the edge between two and not wider than a step: a relay of
    ±step/2."""
    return 2.0 * step / (math.pi * amplitude)


def saturation(amplitude: float, limit: float) -> float:
    """Cut off at ±limit."""
    if amplitude <= limit:
        return 1.0
    ratio = limit / amplitude
    return 2.0 / math.pi * (math.asin(ratio) + ratio * math.sqrt(1.0 - ratio**2))


def saturated_amplitude(gain: float, limit: float) -> float:
    """The amplitude at which `saturation` is this gain, 0 < gain < 1."""
    low, high = limit, 4.0 * limit / (math.pi * gain)
    while high - low > 1e-14 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if saturation(middle, limit) > gain else (low, middle)
    return high


def coulomb(amplitude: float, angular_frequency: float, friction: float) -> float:
    """Coulomb friction as viscous damping, for a motion A·sin(ωt): 4·fc/(π·ω·A)."""
    return 4.0 * friction / (math.pi * angular_frequency * amplitude)

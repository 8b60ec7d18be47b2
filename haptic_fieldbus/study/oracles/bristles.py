"""Stretch of a LuGre bristle without the Stribeck effect: ż = v − σ0·|v|/g·z, from z = 0 at constant speed."""

import math


def stretches(speed: float, period: float, periods: int, stiffness: float, level: float) -> list[float]:
    """Return the stretch after each period [m]: g/σ0·(1 − e^(−σ0·|v|·t/g)) in the direction of the motion."""
    longest, rate = math.copysign(level / stiffness, speed), stiffness * abs(speed) / level
    return [-longest * math.expm1(-rate * number * period) for number in range(1, periods + 1)]

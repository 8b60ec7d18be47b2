"""Largest stable stiffness of a spring on a device under a held force, by characteristic polynomials.

The device, its force and the letters are those of `held`.
"""

import math
from collections.abc import Callable
from decimal import Decimal, localcontext

from haptic_fieldbus.study.oracles.held import Massive
from haptic_fieldbus.study.oracles.textbook import Number

DIGITS = 60
"""Digits of Decimal; a polynomial of degree 13 with roots close to 1 loses many of them."""


def plain_terms(device: Massive, period: float) -> tuple[float, float, float]:
    """Return (e, c1, c0) of the loop without delay, z² − (1 + e)·z + e + K·(c1·z + c0)."""
    tau, e = device.mass / device.damping, math.exp(-period * device.damping / device.mass)
    part = -math.expm1(-period / tau)
    return e, (period - tau * part) / device.damping, (tau * part - e * period) / device.damping


def jury_limit(device: Massive, period: float) -> float:
    """Return the stiffness limit without delay [N/m] by Jury's conditions K < 2·(1 + e)/(c1 − c0), K < (1 − e)/c0."""
    e, c1, c0 = plain_terms(device, period)
    return min(2.0 * (1.0 + e) / (c1 - c0), -math.expm1(-period * device.damping / device.mass) / c0)


def schur_cohn_limit(device: Massive, period: float, delay: float) -> float:
    """Return the stiffness at which a root first leaves the unit circle [N/m], in 60 digits; `delay` in periods."""
    with localcontext(prec=DIGITS):
        free, by_force = polynomials(device, period, delay)

        def stable(k: Decimal) -> bool:
            padded = [Decimal(0)] * (len(free) - len(by_force)) + by_force
            return _all_inside([a + k * c for a, c in zip(free, padded, strict=True)])

        return float(largest(stable, Decimal(device.damping / period) / 1000, Decimal("1.4"), Decimal("1e-10")))


def largest(stable: Callable[[Number], bool], first: Number, factor: Number, share: Number) -> Number:
    """Return the largest stable value, within a share of itself; 0 when even `first` is not stable.

    The search multiplies `first` by `factor` up to the first value that is not stable, and then bisects.
    """
    low, high = 0 * first, first
    while stable(high):
        low, high = high, high * factor
    while low and high - low > share * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def polynomials(device: Massive, period: float, delay: float) -> tuple[list[Decimal], list[Decimal]]:
    """Return two polynomials P and Q of the characteristic equation P + K·Q = 0, highest power first.

    P = (z − 1)(z − e)·z^(n+1) and Q = (z − e)(b_x + a_x·z) + l·(b_v + a_v·z). A force moves the device by (a_x, a_v)
    in the period in which it begins to act, and by (b_x, b_v) in the next one; l is the distance per speed in a period.
    `delay` is in periods.
    """
    m, b, span = Decimal(device.mass), Decimal(device.damping), Decimal(period)
    whole, tau = math.floor(delay + 1e-9), m / b
    early = max(Decimal(delay) - whole, Decimal(0)) * span
    late = span - early

    def held(time: Decimal) -> tuple[Decimal, Decimal]:
        part = 1 - (-time / tau).exp()
        return (time - tau * part) / b, part / b

    e, fading = (-span / tau).exp(), (-late / tau).exp()
    ax, av = held(late)
    x, v = held(early)
    bx, bv, way = x + tau * (1 - fading) * v, fading * v, tau * (1 - e)
    free = [Decimal(1), -1 - e, e, *[Decimal(0)] * (whole + 1)]
    return free, [ax, bx - e * ax + way * av, way * bv - e * bx]


def _all_inside(polynomial: list[Decimal]) -> bool:
    """Return whether all roots are inside the unit circle, by Schur and Cohn.

    Each step lowers the degree by one and keeps the number of roots outside.
    """
    while len(polynomial) > 1:
        first, last = polynomial[0], polynomial[-1]
        if abs(last) >= abs(first):
            return False
        turned = polynomial[::-1]
        polynomial = [x - last / first * y for x, y in zip(polynomial, turned, strict=True)][:-1]
    return True

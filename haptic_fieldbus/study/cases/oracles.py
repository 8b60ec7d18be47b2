"""Oracles of closed loops, written apart from `numerics` and `margins`: closed forms in plain numbers.

A plant m·ẍ = −b·ẋ + F takes a force that is held, F_k = −K·x_k, from td after its sample. With τ = m/b and
ε(t) = 1 − exp(−t/τ) the force f moves it within t, from rest, by f·(t − τ·ε)/b, to the speed f·ε/b.
"""

import math
from collections.abc import Callable
from decimal import Decimal, localcontext

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.study.cases.textbook import Number

DIGITS = 60
"""Of Decimal: a polynomial of degree 13 with roots close to 1 loses many."""


def moved_by_force(device: Plant, x: float, v: float, force: float, span: float) -> tuple[float, float]:
    """Position and velocity after a span [s] of constant force."""
    if not device.damping:
        a = force / device.mass
        return x + span * (v + 0.5 * a * span), v + a * span
    tau = device.mass / device.damping
    part = -math.expm1(-span / tau)
    return x + tau * part * v + force * (span - tau * part) / device.damping, v + part * (force / device.damping - v)


def sampled_positions(
    device: Plant,
    period: float,
    law: Callable[[float], float],
    steps: int,
    *,
    delay: float = 0.0,
    push: float = 0.0,
    start: tuple[float, float] = (1e-3, 0.0),
) -> list[float]:
    """Positions at the samples; `delay` in periods, `push` a constant force of the hand."""
    whole = math.floor(delay)
    rest = (delay - whole) * period
    x, v = start
    forces = [0.0] * (whole + 2)
    positions = []
    for _ in range(steps):
        positions.append(x)
        forces = [law(x), *forces[:-1]]
        if rest:
            x, v = moved_by_force(device, x, v, forces[whole + 1] + push, rest)
        x, v = moved_by_force(device, x, v, forces[whole] + push, period - rest)
        if not abs(x) < 1e100:
            break
    return positions


def growth_of(positions: list[float]) -> float:
    """ln of the greatest of the last tenth over that of the first."""
    tenth = max(1, len(positions) // 10)
    return math.log(max(map(abs, positions[-tenth:])) / max(map(abs, positions[:tenth])))


def plain_terms(device: Plant, period: float) -> tuple[float, float, float]:
    """(e, c1, c0) of z² − (1 + e)·z + e + K·(c1·z + c0), the loop without delay."""
    tau, e = device.mass / device.damping, math.exp(-period * device.damping / device.mass)
    part = -math.expm1(-period / tau)
    return e, (period - tau * part) / device.damping, (tau * part - e * period) / device.damping


def jury_limit(device: Plant, period: float) -> float:
    """Its three conditions by hand: K > 0, K < 2·(1 + e)/(c1 − c0), K < (1 − e)/c0."""
    e, c1, c0 = plain_terms(device, period)
    return min(2.0 * (1.0 + e) / (c1 - c0), -math.expm1(-period * device.damping / device.mass) / c0)


def schur_cohn_limit(device: Plant, period: float, delay: float) -> float:
    """Stiffness [N/m] at which a root first leaves the unit circle, in 60 digits; `delay` in periods."""
    with localcontext(prec=DIGITS):
        free, by_force = polynomials(device, period, delay)

        def stable(k: Decimal) -> bool:
            padded = [Decimal(0)] * (len(free) - len(by_force)) + by_force
            return _all_inside([a + k * c for a, c in zip(free, padded, strict=True)])

        return float(largest(stable, Decimal(device.damping / period) / 1000, Decimal("1.4"), Decimal("1e-10")))


def largest(stable: Callable[[Number], bool], first: Number, factor: Number, share: Number) -> Number:
    """Where `stable` ends, first reached by steps of a factor and then bisected to a share of it; 0: nowhere."""
    low, high = 0 * first, first
    while stable(high):
        low, high = high, high * factor
    while low and high - low > share * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


def polynomials(device: Plant, period: float, delay: float) -> tuple[list[Decimal], list[Decimal]]:
    """(z − 1)(z − e)·z^(n+1), and what K multiplies: (z − e)(b_x + a_x·z) + l·(b_v + a_v·z); highest power first.

    l is the way per speed in a period; a force moves the device by (a_x, a_v) within the period after it began to act
    and by (b_x, b_v) in the one before.
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
    """Schur and Cohn: each step lowers the degree by one and keeps the number of roots outside."""
    while len(polynomial) > 1:
        first, last = polynomial[0], polynomial[-1]
        if abs(last) >= abs(first):
            return False
        turned = polynomial[::-1]
        polynomial = [x - last / first * y for x, y in zip(polynomial, turned, strict=True)][:-1]
    return True

"""The loop of a wall in extended precision: its characteristic polynomial in closed form, and Schur and Cohn's test."""

import mpmath as mp

DIGITS = 60


def characteristic(
    mass: float, damping: float, period: float, delay: tuple[int, float], stiffness: float, virtual: float
) -> list[mp.mpf]:
    """Coefficients, highest first: (z − 1)(z − e)·z^{n+2} + (K·z + B·(z − 1)/T)·N(z); delay: (whole, rest [s])."""
    m, b, span, rest = (mp.mpf(value) for value in (mass, damping, period, delay[1]))
    k, virtual_per_period = mp.mpf(stiffness), mp.mpf(virtual) / span
    early, late = rest, span - rest
    pole = mp.exp(-b * span / m)
    after = _held(m, b, late)
    carried = _held(m, b, early)
    before = (carried[0] + m / b * -mp.expm1(-b * late / m) * carried[1], mp.exp(-b * late / m) * carried[1])
    lag = m / b * -mp.expm1(-b * span / m)
    # N(z) = (z − e)·(before_x + after_x·z) + lag·(before_v + after_v·z)
    numerator = [
        after[0],
        before[0] - pole * after[0] + lag * after[1],
        lag * before[1] - pole * before[0],
    ]
    forward = _product([k + virtual_per_period, -virtual_per_period], numerator)
    free = _product([mp.mpf(1), -1 - pole, pole], [mp.mpf(1), *[mp.mpf(0)] * (delay[0] + 2)])
    return [*free[: -len(forward)], *(x + y for x, y in zip(free[-len(forward) :], forward, strict=True))]


def _held(m: mp.mpf, b: mp.mpf, span: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
    """Position and velocity after a unit force for the span, from rest."""
    grown = -mp.expm1(-b * span / m)
    return span / b - m / b**2 * grown, grown / b


def _product(left: list[mp.mpf], right: list[mp.mpf]) -> list[mp.mpf]:
    result = [mp.mpf(0)] * (len(left) + len(right) - 1)
    for i, x in enumerate(left):
        for j, y in enumerate(right):
            result[i + j] += x * y
    return result


def all_inside(polynomial: list[mp.mpf]) -> bool:
    """Whether every root lies inside the unit circle (Schur and Cohn)."""
    while len(polynomial) > 1:
        first, last = polynomial[0], polynomial[-1]
        if abs(last) >= abs(first):
            return False
        ratio = last / first
        polynomial = [x - ratio * y for x, y in zip(polynomial, reversed(polynomial), strict=True)][:-1]
    return True

"""Oracles of the integrator cases: each method's step on p̈ = h²·(u − p), T = 1, derived by hand, in any arithmetic.

A free step from the puck is the matrix below on (e, v), e = p − u. With S and C the sums that a method makes of sin and
cos, it is [[C, S/h], [−h·S, C]]; the staggered ones are a kick and a drift.
"""

import math
from collections.abc import Callable
from decimal import Decimal, localcontext
from fractions import Fraction
from typing import TypeVar

Number = TypeVar("Number", Decimal, Fraction)
Pair = tuple[tuple[Number, Number], tuple[Number, Number]]
ONE = Decimal(1)
DIGITS = 50
TERMS = 40


def _leapfrog_radius(h: float) -> float:
    return 1.0 if h <= 2.0 else math.exp(2.0 * math.acosh(0.5 * h))


RADII: dict[str, Callable[[float], float]] = {
    "forward-euler": lambda h: math.hypot(1.0, h),
    "backward-euler": lambda h: 1.0 / math.hypot(1.0, h),
    "trapezoidal": lambda h: 1.0,
    "semi-implicit": _leapfrog_radius,
    "semi-implicit-drift-first": _leapfrog_radius,
    "verlet": _leapfrog_radius,
    "rk4": lambda h: math.sqrt(1.0 + h**6 * (h * h - 8.0) / 576.0),
    "exact-zoh": lambda h: 1.0,
    "exact-foh": lambda h: 1.0,
}
"""h → spectral radius on the undamped oscillator."""


def multiply(left: Pair[Number], right: Pair[Number]) -> Pair[Number]:
    """Product of two 2×2 matrices."""
    (a, b), (c, d) = left
    (e, f), (g, h) = right
    return (a * e + b * g, a * f + b * h), (c * e + d * g, c * f + d * h)


def power(matrix: Pair[Number], exponent: int) -> Pair[Number]:
    """By squaring; the exponent is at least 1."""
    if exponent == 1:
        return matrix
    half = power(multiply(matrix, matrix), exponent // 2)
    return multiply(half, matrix) if exponent % 2 else half


def rk4_matrix(square: Number) -> Pair[Number]:
    """C = 1 − h²/2 + h⁴/24, S/h = 1 − h²/6."""
    one = square / square
    c, s = one - square / 2 + square * square / 24, one - square / 6
    return (c, s), (-square * s, c)


def free_motion(matrix: Pair[Decimal], start: tuple[Decimal, Decimal], steps: int) -> Decimal:
    """Position after at least one step."""
    row: tuple[Decimal, Decimal] = power(matrix, steps)[0]
    return row[0] * start[0] + row[1] * start[1]


def _series(square: Decimal, first: int) -> Decimal:
    """Σ (−h²)ⁿ/(2n + first)!: cos h for first = 0, sin h/h for 1, (1 − cos h)/h² for 2."""
    total = term = ONE / math.factorial(first)
    for n in range(1, TERMS):
        term *= -square / ((2 * n + first - 1) * (2 * n + first))
        total += term
    return total


def _matrix(method: str, square: Decimal) -> Pair[Decimal]:
    quarter = square / 4
    if method == "forward-euler":
        return (ONE, ONE), (-square, ONE)
    if method == "backward-euler":
        return (1 / (1 + square), 1 / (1 + square)), (-square / (1 + square), 1 / (1 + square))
    if method == "trapezoidal":
        c, s = (1 - quarter) / (1 + quarter), 1 / (1 + quarter)
        return (c, s), (-square * s, c)
    if method in ("semi-implicit", "verlet"):
        return (1 - square, ONE), (-square, ONE)
    if method == "semi-implicit-drift-first":
        return (ONE, ONE), (-square, 1 - square)
    if method == "rk4":
        return rk4_matrix(square)
    c, s = _series(square, 0), _series(square, 1)
    return (c, s), (-square * s, c)


def _first(method: str, square: Decimal) -> tuple[Decimal, Decimal]:
    """(e, v) at the sample where the puck is first at 1: what the method makes of the step before, all else at rest."""
    if method == "backward-euler":
        return -1 / (1 + square), square / (1 + square)
    if method == "trapezoidal":
        return -1 / (1 + square / 4), square / 2 / (1 + square / 4)
    if method == "rk4":
        return square / 6 - 1, square / 2 - square * square / 24
    if method == "exact-foh":
        return -_series(square, 1), square * _series(square, 2)
    return -ONE, Decimal(0)


def puck_moved(method: str, square: Decimal, sample: int) -> Decimal:
    """Force over stiffness at a sample from 2 on; the puck is at 0 at sample 0 and at 1 from sample 1 on."""
    with localcontext() as context:
        context.prec = DIGITS
        return free_motion(_matrix(method, square), _first(method, square), sample - 1)

"""Mass on a spring, q̈ = ω²·(x − q), by the methods of textbooks, in floats or in fifty decimal digits.

Cases of the report cover these methods. A method added to the package needs no rule here; it is compared with its step
in `tests/numerics/textbook.py`.
"""

import math
from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from typing import Protocol, TypeVar

import numpy as np

Number = TypeVar("Number", float, Decimal)
DIGITS = 50
TERMS = 40
"""Number of terms in the series of cosine, and in that of sine."""


class Rule(Protocol):
    """Step of a method: (q, q̇, x before, x now, ω, period) → (q, q̇) now."""

    def __call__(
        self, q: Number, v: Number, x: Number, y: Number, w: Number, t: Number, /
    ) -> tuple[Number, Number]: ...


def _backward_euler(q: Number, v: Number, x: Number, y: Number, w: Number, t: Number) -> tuple[Number, Number]:
    v = (v + t * w * w * (y - q)) / (1 + (w * t) ** 2)
    return q + t * v, v


def _trapezoidal(q: Number, v: Number, x: Number, y: Number, w: Number, t: Number) -> tuple[Number, Number]:
    quarter = (w * t) ** 2 / 4
    new = (v * (1 - quarter) + t * w * w * ((x + y) / 2 - q)) / (1 + quarter)
    return q + t / 2 * (v + new), new


def _semi_implicit(q: Number, v: Number, x: Number, y: Number, w: Number, t: Number) -> tuple[Number, Number]:
    v += t * w * w * (x - q)
    return q + t * v, v


def _drift_first(q: Number, v: Number, x: Number, y: Number, w: Number, t: Number) -> tuple[Number, Number]:
    q += t * v
    return q, v + t * w * w * (x - q)


def _verlet(q: Number, v: Number, x: Number, y: Number, w: Number, t: Number) -> tuple[Number, Number]:
    before = w * w * (x - q)
    q += t * v + t / 2 * t * before
    return q, v + t / 2 * (before + w * w * (y - q))


def _rk4(q: Number, v: Number, x: Number, y: Number, w: Number, t: Number) -> tuple[Number, Number]:
    middle, half = (x + y) / 2, t / 2
    v1, a1 = v, w * w * (x - q)
    v2, a2 = v + half * a1, w * w * (middle - q - half * v1)
    v3, a3 = v + half * a2, w * w * (middle - q - half * v2)
    v4, a4 = v + t * a3, w * w * (y - q - t * v3)
    return q + t / 6 * (v1 + 2 * (v2 + v3) + v4), v + t / 6 * (a1 + 2 * (a2 + a3) + a4)


def _exact(q: Number, v: Number, x: Number, y: Number, w: Number, t: Number) -> tuple[Number, Number]:
    """Solve exactly for a handle on a straight line from x to y: q = x + s·time + A·cos + B·sin."""
    slope = (y - x) / t
    c, s = _cos_sin(w * t)
    a, b = q - x, (v - slope) / w
    return y + a * c + b * s, slope + w * (b * c - a * s)


def _cos_sin(angle: Number) -> tuple[Number, Number]:
    """Return cosine and sine of an angle [rad]; of a Decimal by their series, with signs in turn."""
    if not isinstance(angle, Decimal):
        return math.cos(angle), math.sin(angle)
    terms = [angle**n / math.factorial(n) for n in range(2 * TERMS)]
    c, minus_c, s, minus_s = (sum(terms[first::4], Decimal(0)) for first in (0, 2, 1, 3))
    return c - minus_c, s - minus_s


def _leapfrog_radius(h: float) -> float:
    """Return the spectral radius of the leapfrog methods: 1 up to h = 2, e^{2·acosh(h/2)} beyond."""
    return 1.0 if h <= 2.0 else math.exp(2.0 * math.acosh(0.5 * h))


RULES: dict[str, Rule] = {
    "forward-euler": lambda q, v, x, y, w, t: (q + t * v, v + t * w * w * (x - q)),
    "backward-euler": _backward_euler,
    "trapezoidal": _trapezoidal,
    "semi-implicit": _semi_implicit,
    "semi-implicit-drift-first": _drift_first,
    "verlet": _verlet,
    "rk4": _rk4,
    "exact-zoh": lambda q, v, x, y, w, t: _exact(q, v, x, x, w, t),
    "exact-foh": _exact,
}
"""Step of each method."""
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
"""Spectral radius of a free motion as a function of h = T·ω, in closed form."""


def puck_moved(method: str, square: float, sample: int) -> float:
    """Return force over stiffness at a sample from 2 on, with h² = `square`, for a puck that jumps from 0 to 1.

    The puck is at 0 at sample 0, and at 1 from sample 1 on.
    """
    with localcontext(prec=DIGITS):
        rule, w, one, none = RULES[method], Decimal(square).sqrt(), Decimal(1), Decimal(0)
        q, v = rule(none, none, none, one, w, one)
        # After the jump the motion is free about the puck: the matrix of one step is found from two unit states.
        columns = [rule(*start, none, none, w, one) for start in ((one, none), (none, one))]
    return free_motion(list(zip(*columns, strict=True)), (q - 1, v), sample - 1)


def free_motion(matrix: Sequence[Sequence[Decimal]], start: Sequence[Decimal], steps: int) -> float:
    """Return the position after `steps` of (position, velocity) ← matrix·(position, velocity), in fifty digits."""
    with localcontext(prec=DIGITS):
        return float((np.linalg.matrix_power(np.array(matrix, dtype=object), steps) @ np.array(start, dtype=object))[0])

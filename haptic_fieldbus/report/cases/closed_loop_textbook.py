"""A virtual mass on a spring, q̈ = ω²·(x − q), by every method as textbooks write it: oracle of `sampled-free-puck`."""

import math
from collections.abc import Callable

Rule = Callable[[float, float, float, float, float, float], tuple[float, float]]
"""(q, q̇, x before, x now, ω, period) → (q, q̇) now."""


def _forward_euler(q: float, v: float, x: float, _: float, w: float, t: float) -> tuple[float, float]:
    return q + t * v, v + t * w * w * (x - q)


def _backward_euler(q: float, v: float, _: float, x: float, w: float, t: float) -> tuple[float, float]:
    v = (v + t * w * w * (x - q)) / (1.0 + (w * t) ** 2)
    return q + t * v, v


def _trapezoidal(q: float, v: float, x: float, y: float, w: float, t: float) -> tuple[float, float]:
    quarter = 0.25 * (w * t) ** 2
    new = (v * (1.0 - quarter) + t * w * w * (0.5 * (x + y) - q)) / (1.0 + quarter)
    return q + 0.5 * t * (v + new), new


def _semi_implicit(q: float, v: float, x: float, _: float, w: float, t: float) -> tuple[float, float]:
    v += t * w * w * (x - q)
    return q + t * v, v


def _drift_first(q: float, v: float, x: float, _: float, w: float, t: float) -> tuple[float, float]:
    q += t * v
    return q, v + t * w * w * (x - q)


def _verlet(q: float, v: float, x: float, y: float, w: float, t: float) -> tuple[float, float]:
    before = w * w * (x - q)
    q += t * v + 0.5 * t * t * before
    return q, v + 0.5 * t * (before + w * w * (y - q))


def _rk4(q: float, v: float, x: float, y: float, w: float, t: float) -> tuple[float, float]:
    middle, half = 0.5 * (x + y), 0.5 * t
    v1, a1 = v, w * w * (x - q)
    v2, a2 = v + half * a1, w * w * (middle - q - half * v1)
    v3, a3 = v + half * a2, w * w * (middle - q - half * v2)
    v4, a4 = v + t * a3, w * w * (y - q - t * v3)
    return q + t / 6.0 * (v1 + 2.0 * (v2 + v3) + v4), v + t / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def _exact(q: float, v: float, x: float, y: float, w: float, t: float) -> tuple[float, float]:
    """The handle on a straight line from x to y: q = x + s·time + A·cos + B·sin."""
    slope = (y - x) / t
    a, b, c, s = q - x, (v - slope) / w, math.cos(w * t), math.sin(w * t)
    return y + a * c + b * s, slope + w * (b * c - a * s)


def _exact_held(q: float, v: float, x: float, _: float, w: float, t: float) -> tuple[float, float]:
    return _exact(q, v, x, x, w, t)


RULES: dict[str, Rule] = {
    "forward-euler": _forward_euler,
    "backward-euler": _backward_euler,
    "trapezoidal": _trapezoidal,
    "semi-implicit": _semi_implicit,
    "semi-implicit-drift-first": _drift_first,
    "verlet": _verlet,
    "rk4": _rk4,
    "exact-zoh": _exact_held,
    "exact-foh": _exact,
}

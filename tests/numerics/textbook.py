"""The nine methods on a mass m sprung to a puck, p̈ = ω²·(u − p), as their textbooks write them.

Each takes (p, v, u_n, u_{n+1}, period, ω²) and gives (p, v) one step later, in any arithmetic: floats or mpmath.
"""

from collections.abc import Callable
from typing import Any

import mpmath

Number = Any
"""A float, or an mpf."""
Textbook = Callable[..., tuple[Number, Number]]


def forward_euler(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    return p + period * v, v + period * square * (u - p)


def backward_euler(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    velocity = (v + period * square * (after - p)) / (1 + period * period * square)
    return p + period * velocity, velocity


def trapezoidal(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    half = period / 2
    velocity = (v + half * square * (u + after - 2 * p - half * v)) / (1 + half * half * square)
    return p + half * (v + velocity), velocity


def semi_implicit(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    """The velocity belongs to half a period earlier."""
    velocity = v + period * square * (u - p)
    return p + period * velocity, velocity


def drift_first(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    position = p + period * v
    return position, v + period * square * (u - position)


def verlet(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    position = p + period * v + period * period / 2 * square * (u - p)
    return position, v + period / 2 * square * ((u - p) + (after - position))


def rk4(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    def rates(z: tuple[Any, Any], x: Number) -> tuple[Any, Any]:
        return z[1], square * (x - z[0])

    def moved(slope: tuple[Any, Any], span: Number) -> tuple[Any, Any]:
        return p + span * slope[0], v + span * slope[1]

    first = rates((p, v), u)
    second = rates(moved(first, period / 2), (u + after) / 2)
    third = rates(moved(second, period / 2), (u + after) / 2)
    fourth = rates(moved(third, period), after)
    slopes = zip(first, second, third, fourth, strict=True)
    change = [period / 6 * (a + 2 * b + 2 * c + d) for a, b, c, d in slopes]
    return p + change[0], v + change[1]


def exact_zoh(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    natural = mpmath.sqrt(square)
    cosine, sine = mpmath.cos(natural * period), mpmath.sin(natural * period)
    return u + (p - u) * cosine + v / natural * sine, -(p - u) * natural * sine + v * cosine


def exact_foh(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    """The deviation from the ramp swings freely."""
    speed = (after - u) / period
    deviation, change = exact_zoh(p - u, v - speed, 0, 0, period, square)
    return after + deviation, speed + change


TEXTBOOK: dict[str, Textbook] = {
    "forward-euler": forward_euler,
    "backward-euler": backward_euler,
    "trapezoidal": trapezoidal,
    "semi-implicit": semi_implicit,
    "semi-implicit-drift-first": drift_first,
    "verlet": verlet,
    "rk4": rk4,
    "exact-zoh": exact_zoh,
    "exact-foh": exact_foh,
}


def free_motion(method: str, period: float, square: float, start: tuple[Number, Number], steps: int) -> tuple[Any, Any]:
    """(p, v) after so many steps at u = 0, to fifty digits; for long runs a power of the step's matrix."""
    with mpmath.workdps(50):
        step, exact_period, exact_square = TEXTBOOK[method], mpmath.mpf(period), mpmath.mpf(square)
        columns = [step(*map(mpmath.mpf, unit), 0, 0, exact_period, exact_square) for unit in ((1, 0), (0, 1))]
        matrix = mpmath.matrix([[columns[0][0], columns[1][0]], [columns[0][1], columns[1][1]]])
        found = matrix**steps * mpmath.matrix(list(map(mpmath.mpf, start)))
        return found[0], found[1]

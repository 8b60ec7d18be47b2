"""One-step methods: each is a function that approximates eˣ, applied to one matrix.

Let the input be a polynomial of θ = time/T within a step: held at u_n (degree 0), or on the straight line from u_n to
u_{n+1} (degree 1). Then z, u, u′ together are one autonomous linear system with the matrix X of
`exact.polynomial_system`, whose exact step is eˣ. A method uses R(X) instead of eˣ:

| method         | R(x)                                | degree | meaning                                            |
|----------------|-------------------------------------|--------|----------------------------------------------------|
| forward-euler  | 1 + x                               | 0      | z⁺ = z + T·f(z, u)                                 |
| backward-euler | 1/(1 − x)                           | 1      | z⁺ = z + T·f(z⁺, u⁺)                               |
| trapezoidal    | (1 + x/2)/(1 − x/2)                 | 1      | z⁺ = z + T/2·(f(z, u) + f(z⁺, u⁺)), Tustin         |
| rk4            | 1 + x + x²/2 + x³/6 + x⁴/24         | 1      | four stages; the input halfway is (u + u⁺)/2       |
| exact-zoh      | eˣ                                  | 0      | exact for a held input (step-invariant)            |
| exact-foh      | eˣ                                  | 1      | exact for straight lines (ramp-invariant)          |

All methods are causal: y_n is known as soon as u_n is. Methods of degree 1 need u_{n+1} for z_{n+1}. They store the
state w_n = z_n − Γ1 u_n and complete z_n when u_n has been read (Franklin, Powell, Workman: Digital Control of Dynamic
Systems, 3rd ed., 6.3.2). A held input is late by half a period, so every method with it is of first order, also the
exact one. A straight line has an error ∝ T²: rk4, of fourth order in its free motion, is of second order in a loop.

A mode λ grows by R(λT) in a step (Hairer, Nørsett, Wanner: Solving Ordinary Differential Equations I and II).
"""

import cmath
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from haptic_fieldbus.numerics.integrators.method import Integrator, OneStep
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, expm1, polynomial_system

RK4_LAG_LIMIT = 2.785293563405282
"""Largest stable T·λ of rk4 for a lag: the real root of 1 − x/2 + x²/6 − x³/24 = 0, at which R(−x) = 1."""

GrowthMinusOne = Callable[[Matrix], Matrix]
"""Function R(X) − 1 of a square matrix; without the 1 it keeps the digits of a tiny period."""


def _runge_kutta(x: Matrix) -> Matrix:
    """Return R(x) − 1 = x·(1 + x/2·(1 + x/3·(1 + x/4)))."""
    identity = np.eye(len(x))
    return x @ (identity + x / 2.0 @ (identity + x / 3.0 @ (identity + x / 4.0)))


def _solve(left: Matrix, right: Matrix) -> Matrix:
    return np.asarray(np.linalg.solve(left, right), dtype=np.float64)


def _discretiser(increment_of: GrowthMinusOne, degree: int) -> Callable[[StateSpace, float], OneStep]:
    """Return the function that makes the step of a method from R − 1, with the stored states of the module's theory."""

    def discretise(space: StateSpace, period: float) -> OneStep:
        order, inputs = space.b.shape
        rows = increment_of(polynomial_system(space.a * period, space.b * period, degree))[:order]
        increment, held = rows[:, :order], rows[:, order : order + inputs]
        slope = rows[:, order + inputs :] if degree else np.zeros_like(held)
        moved = StateSpace(increment, increment @ slope + held, space.c, space.c @ slope + space.d)
        return OneStep(moved, (np.eye(order), slope))

    return discretise


def _method(
    name: str, order: int, free_order: float, growth: Callable[[complex], complex], increment_of: GrowthMinusOne,
    degree: int, limits: tuple[float, float], update: str, oscillator_growth: Callable[[float], float] | None = None,
) -> Integrator:  # fmt: skip
    """Return a method from its figures; `limits` are those of an oscillator and of a decay."""
    inputs = "u_n, u_{n-1}" if degree else "u_{n-1}"
    swing = oscillator_growth or (lambda h: abs(growth(complex(0.0, h))))
    step = _discretiser(increment_of, degree)
    return Integrator(name, order, free_order, inputs, update, growth, swing, *limits, step)


# A method that preserves an oscillator states its growth as exactly 1, without the rounding of |R(ih)|.
EXACT_FOH = _method(
    "exact-foh", 2, math.inf, cmath.exp, expm1, 1, (math.inf, math.inf),
    "all states at once, input linear between samples", lambda h: 1.0,
)  # fmt: skip
EXACT_ZOH = _method(
    "exact-zoh", 1, math.inf, cmath.exp, expm1, 0, (math.inf, math.inf),
    "all states at once, input held", lambda h: 1.0,
)  # fmt: skip
FORWARD_EULER = _method(
    "forward-euler", 1, 1, lambda x: 1.0 + x, lambda x: x, 0, (0.0, 2.0),
    "all states at once, with the rates at the start",
)  # fmt: skip
# Backward Euler uses only the end of the straight line, so its step takes no earlier input.
BACKWARD_EULER = replace(_method(
    "backward-euler", 1, 1, lambda x: 1.0 / (1.0 - x), lambda x: _solve(np.eye(len(x)) - x, x), 1, (math.inf, math.inf),
    "all states at once, with the rates at the end",
), inputs="u_n")  # fmt: skip
TRAPEZOIDAL = _method(
    "trapezoidal", 2, 2, lambda x: (1.0 + x / 2.0) / (1.0 - x / 2.0),
    lambda x: _solve(np.eye(len(x)) - 0.5 * x, x), 1, (math.inf, math.inf),
    "all states at once, with the mean of the rates at start and end", lambda h: 1.0,
)  # fmt: skip
RK4 = _method(
    "rk4", 2, 4, lambda x: 1.0 + x * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0))), _runge_kutta, 1,
    (2.0 * math.sqrt(2.0), RK4_LAG_LIMIT), "all states at once, four stages",
)  # fmt: skip

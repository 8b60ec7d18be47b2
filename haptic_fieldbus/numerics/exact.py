"""Exact discretisation of ż = A z + B u for inputs that are polynomials within a step.

All comes from one matrix exponential: z, u, u′, u″ … (derivatives by θ = time/step) form one autonomous linear system
(Van Loan 1978, doi:10.1109/TAC.1978.1101743). It is computed as E = eˣ − I: Taylor series of X/2ˢ, then E ← E·(E + 2·I)
s times. Doubling E instead of squaring eˣ keeps all digits of a small step, and makes too large an s harmless, so that
badly scaled oscillators (1 beside k/m = 10¹²) need no balancing.
"""

import math

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix, StateSpace

TERMS = 12
"""Of the Taylor series; the first one left out is below 1e-17 of the first at the largest norm, 0.25."""


def expm1(x: Matrix) -> Matrix:
    """eˣ − I of square matrices, shape (…, n, n)."""
    norm = float(np.abs(x).sum(axis=-1).max(initial=0.0))
    doublings = max(0, math.frexp(4.0 * norm)[1])
    scaled = x * 0.5**doublings
    identity = np.eye(x.shape[-1])
    series = identity
    for term in range(TERMS, 1, -1):
        series = identity + scaled @ series / term
    result: Matrix = scaled @ series
    for _ in range(doublings):
        result = result @ (result + 2.0 * identity)
    return result


def expm(x: Matrix) -> Matrix:
    """eˣ of square matrices, shape (…, n, n)."""
    return expm1(x) + np.eye(x.shape[-1])


def polynomial_system(a: Matrix, b: Matrix, degree: int) -> Matrix:
    """The matrix of the autonomous system of (z, u, u′, … up to that derivative), the last one constant."""
    order, inputs = b.shape
    system = np.zeros((order + inputs * (degree + 1),) * 2)
    system[:order, :order], system[:order, order : order + inputs] = a, b
    chain = np.arange(order, len(system) - inputs)
    system[chain, chain + inputs] = 1.0
    return system


def polynomial_step(a: Matrix, b: Matrix, step: float, degree: int) -> tuple[Matrix, list[Matrix]]:
    """(Φ − I, [Γ₀ … Γ_degree]) with z⁺ = Φ z + Σ Γⱼ dʲu/dθʲ at θ = 0, θ = time/step; exact for that degree of u."""
    order, inputs = b.shape
    increment = expm1(polynomial_system(a * step, b * step, degree))[:order]
    return increment[:, :order], [increment[:, at : at + inputs] for at in range(order, increment.shape[1], inputs)]


def zoh(a: Matrix, b: Matrix, step: float) -> tuple[Matrix, Matrix]:
    """(Φ, Γ): z⁺ = Φ z + Γ u with the input held over the step."""
    increment, (held,) = polynomial_step(a, b, step, 0)
    return increment + np.eye(len(a)), held


def followed(space: StateSpace, step: float) -> StateSpace:
    """The discrete system u_n → y_n with the inputs on straight lines; its states are z_n − Γ1 u_n."""
    transition, before, after = foh(space.a, space.b, step)
    return StateSpace(transition, before + transition @ after, space.c, space.d + space.c @ after)


def foh(a: Matrix, b: Matrix, step: float) -> tuple[Matrix, Matrix, Matrix]:
    """(Φ, Γ0, Γ1): z⁺ = Φ z + Γ0 u + Γ1 u⁺ with the input on a straight line from u to u⁺."""
    increment, (held, slope) = polynomial_step(a, b, step, 1)
    return increment + np.eye(len(a)), held - slope, slope

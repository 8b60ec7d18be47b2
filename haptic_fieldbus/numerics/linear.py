"""Linear systems in continuous and discrete time, as plain matrices."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """Linear system ẋ = A x + B u, y = C x + D u; with x⁺ in place of ẋ where it is called discrete.

    Shapes: a (n, n), b (n, n_in), c (n_out, n), d (n_out, n_in); n may be 0.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix

    @property
    def order(self) -> int:
        return int(self.a.shape[0])

    @property
    def uses_velocity(self) -> bool:
        """True when the second input of a (position, velocity) system has an effect."""
        return bool(np.any(self.b[:, 1]) or np.any(self.d[:, 1]))


def system_of(*matrices: list[list[float]]) -> StateSpace:
    """Return a system from the rows of A, B, C and D."""
    return StateSpace(*(np.array(rows, dtype=float) for rows in matrices))


def gain(d: list[list[float]]) -> StateSpace:
    """Return a system without states, y = D u; `d` holds n_out rows of n_in numbers."""
    matrix = np.array(d, dtype=float)
    n_out, n_in = matrix.shape
    return StateSpace(np.zeros((0, 0)), np.zeros((0, n_in)), np.zeros((n_out, 0)), matrix)


def parallel(systems: list[StateSpace]) -> StateSpace:
    """Return the sum of systems with the same inputs; the states follow in the order of the systems."""
    order = sum(system.order for system in systems)
    a = np.zeros((order, order))
    row = 0
    for system in systems:
        a[row : row + system.order, row : row + system.order] = system.a
        row += system.order
    return StateSpace(
        a,
        np.vstack([system.b for system in systems]),
        np.hstack([system.c for system in systems]),
        np.sum([system.d for system in systems], axis=0),
    )


def equilibrium(a: Matrix, b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the z with A z + b = 0, shaped as `b`, (n,) or (n, m); a singular A: the smallest least-squares
    solution."""
    try:
        return np.asarray(np.linalg.solve(a, -b), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(a, -b, rcond=None)[0], dtype=np.float64)


# Exact discretisation of ż = A z + B u for inputs that are polynomials within a step.
#
# All results come from one matrix exponential. The states z, u, u′, u″ … (derivatives by θ = time/step) form one
# autonomous linear system with a matrix X (Van Loan 1978, doi:10.1109/TAC.1978.1101743). E = eˣ − I is computed by a
# Taylor series of X/2ˢ and s doublings E ← E·(E + 2·I). Doubling E instead of squaring eˣ keeps all digits of a small
# step, and makes too large an s harmless. Badly scaled oscillators (1 beside k/m = 10¹²) therefore need no balancing.

TERMS = 12
"""Terms of the Taylor series. At the largest norm, 0.25, the first omitted term is below 1e-17 of the first term."""


def expm1(x: Matrix) -> Matrix:
    """Return eˣ − I of square matrices, shape (…, n, n)."""
    norm = float(np.abs(x).sum(axis=-1).max(initial=0.0))
    doublings = max(0, math.frexp(4.0 * norm)[1])  # so that norm/2**doublings is below 0.25
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
    """Return eˣ of square matrices, shape (…, n, n)."""
    return expm1(x) + np.eye(x.shape[-1])


def polynomial_system(a: Matrix, b: Matrix, degree: int) -> Matrix:
    """Return the matrix of the autonomous system of (z, u, u′, …) up to the constant derivative of this degree.

    With `a` (n, n) and `b` (n, n_in) its size is n + n_in·(degree + 1).
    """
    order, inputs = b.shape
    system = np.zeros((order + inputs * (degree + 1),) * 2)
    system[:order, :order], system[:order, order : order + inputs] = a, b
    chain = np.arange(order, len(system) - inputs)
    system[chain, chain + inputs] = 1.0
    return system


def polynomial_step(a: Matrix, b: Matrix, step: float, degree: int) -> tuple[Matrix, list[Matrix]]:
    """Return (Φ − I, [Γ₀ … Γ_degree]) with z⁺ = Φ z + Σ Γⱼ dʲu/dθʲ at θ = 0, θ = time/step.

    The step [s] is exact for inputs that are polynomials of this degree. Shapes: Φ (n, n), each Γ (n, n_in).
    """
    order, inputs = b.shape
    increment = expm1(polynomial_system(a * step, b * step, degree))[:order]
    return increment[:, :order], [increment[:, at : at + inputs] for at in range(order, increment.shape[1], inputs)]


def zoh(a: Matrix, b: Matrix, step: float) -> tuple[Matrix, Matrix]:
    """Return (Φ, Γ), (n, n) and (n, n_in), of z⁺ = Φ z + Γ u with the input held over the step [s]."""
    increment, (held,) = polynomial_step(a, b, step, 0)
    return increment + np.eye(len(a)), held


def followed(space: StateSpace, step: float) -> StateSpace:
    """Return the discrete system u_n → y_n for inputs on straight lines; its states are z_n − Γ1 u_n."""
    transition, before, after = foh(space.a, space.b, step)
    return StateSpace(transition, before + transition @ after, space.c, space.d + space.c @ after)


def foh(a: Matrix, b: Matrix, step: float) -> tuple[Matrix, Matrix, Matrix]:
    """Return (Φ, Γ0, Γ1) of z⁺ = Φ z + Γ0 u + Γ1 u⁺ with the input on a straight line from u to u⁺ over the step [s].

    Shapes: Φ (n, n), Γ0 and Γ1 (n, n_in).
    """
    increment, (held, slope) = polynomial_step(a, b, step, 1)
    # The input is u + θ·(u⁺ − u), so its slope u⁺ − u enters both matrices.
    return increment + np.eye(len(a)), held - slope, slope


# Figures of linear estimators, from the system that `estimators.discrete` returns.
# - Noise gain: rms of the output for white noise of rms 1 at the input, √Σ h_k² over the impulse response h. The sum is
#   D² + C P Cᵀ with P = Σ Aᵏ B Bᵀ Aᵏᵀ, found by doubling the number of its terms.
# - Filter of a velocity: with H(1) = 0 an estimator H of positions is a filter G of velocities, as the position is the
#   sum x_n = x_{n−1} + T·v_n. With R = (I − A)⁻¹, (zI − A)⁻¹ = R − (z − 1)(zI − A)⁻¹R, so that G(z) = H(z)·T·z/(z − 1)
# =   −T·C R B − T·C A (zI − A)⁻¹ R B: a system with the same A, and G(1) = 1. - Delay: a slow velocity comes out late
# by T·Σ k·g_k = T·C R² B of that filter. The backward difference, G = 1, gives   the mean velocity of a period without
# delay, and is T/2 late for the velocity at its end. Every estimator has this T/2   in addition to the delay of its
# filter.

MOST_DOUBLINGS = 60


def noise_gain(system: StateSpace) -> float:
    """Return the rms output of a stable system for white noise of rms 1, with one input and one output."""
    power, covariance = system.a, system.b @ system.b.T
    for _ in range(MOST_DOUBLINGS):
        if not power.any():
            break
        covariance = covariance + power @ covariance @ power.T
        power = power @ power
    return math.sqrt(float((system.d @ system.d.T + system.c @ covariance @ system.c.T)[0, 0]))


def velocity_filter(system: StateSpace, period: float) -> StateSpace:
    """Return the filter velocity → velocity that an estimator position → velocity contains; `period` in s."""
    resolved: Matrix = np.linalg.solve(np.eye(system.order) - system.a, system.b).astype(np.float64)
    return StateSpace(system.a, resolved, -period * system.c @ system.a, -period * system.c @ resolved)


def filter_delay(system: StateSpace, period: float) -> float:
    """Return the delay of a slow change of velocity in a filter with G(1) = 1 [s]; `period` in s."""
    rest = np.eye(system.order) - system.a
    return period * float((system.c @ np.linalg.solve(rest, np.linalg.solve(rest, system.b)))[0, 0])

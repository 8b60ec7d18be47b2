"""A plant under a delayed hold, closed over a discrete environment: matrices and growth.

The position is sampled at t_k = k·T, the environment gives F_k, and F_k is held from t_k + td until t_{k+1} + td with
td = n·T + δ. Between these instants all is linear, so one period is exact.
"""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.exact import zoh
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium


def environment(space: StateSpace, *, period: float, method: str | None, estimator: str | None) -> StateSpace:
    """The loop's environment x_k → F_k of a continuous (position, velocity) → force system.

    `method` may be None without virtual states, `estimator` when the velocity does not matter; else UsageError. What
    a scene does not need is not imported.
    """
    if space.order:
        if method is None:
            raise UsageError("a scene with virtual states needs an integrator")
        from haptic_fieldbus.numerics import integrators

        space = integrators.discrete(space, period, method)
    if not space.uses_velocity:
        return StateSpace(space.a, space.b[:, :1], space.c, space.d[:, :1])
    if estimator is None:
        raise UsageError("a scene that uses velocity needs an estimator")
    from haptic_fieldbus.numerics import estimators

    velocity = estimators.judged(estimator, period)
    (from_position, from_velocity), order = (space.b[:, :1], space.b[:, 1:]), space.order
    return StateSpace(
        a=np.block([[space.a, from_velocity @ velocity.c], [np.zeros((velocity.order, order)), velocity.a]]),
        b=np.vstack([from_position + from_velocity @ velocity.d, velocity.b]),
        c=np.hstack([space.c, space.d[:, 1:] @ velocity.c]),
        d=space.d[:, :1] + space.d[:, 1:] @ velocity.d,
    )


@dataclass(frozen=True, eq=False)
class SampledPlant:
    """A plant over one period: ξ⁺ = Φ ξ + `before` F_{k−n−1} + `after` F_{k−n}; the position is the first of ξ."""

    transition: Matrix
    before: Matrix
    """Of the force that still acts during the first δ of the period."""
    after: Matrix
    whole: int
    """Whole periods of delay, n."""
    fraction: float
    """δ [s]"""
    shift: Matrix | None = None
    """The state at rest with position 1, where no force acts on it; None: something holds the plant to the ground."""


def split_delay(delay: float, period: float) -> tuple[int, float]:
    """(n, δ) with delay = n·period + δ and 0 ≤ δ < period; δ within a billionth of a period of a whole one is one."""
    whole = math.floor(delay / period + 1e-9)
    fraction = delay - whole * period
    return whole, fraction if fraction > 1e-9 * period else 0.0


def sample(a: Matrix, b: Matrix, period: float, delay: float) -> SampledPlant:
    """Exact discretisation of ξ̇ = A ξ + B F, position first, under the delayed hold."""
    whole, fraction = split_delay(delay, period)
    first_transition, first = zoh(a, b, fraction)
    rest_transition, rest = zoh(a, b, period - fraction)
    transition = rest_transition @ first_transition
    return SampledPlant(transition, rest_transition @ first, rest, whole, fraction, _shift(a))


def _shift(a: Matrix) -> Matrix | None:
    """The r with A r = 0 and r_0 = 1."""
    size = np.abs(a).max(axis=1, keepdims=True)
    rows = a / np.where(size > 0.0, size, 1.0)
    state: Matrix = np.append(1.0, np.linalg.lstsq(rows[:, 1:], -rows[:, 0], rcond=None)[0])
    return state if np.abs(rows @ state).max() <= 1e-9 else None


def loop_matrix(
    plant: SampledPlant, environment: StateSpace, *, received: bool = True, least_memory: int = 0
) -> Matrix:
    """One period of the closed loop on the states (ξ, environment, F_{k−1}, F_{k−2}, …).

    Where the sample was not `received` the environment stands still and F_{k−1} goes on. So many forces are remembered
    at least.
    """
    order, inner = len(plant.transition), environment.order
    memory = max(plant.whole + (1 if plant.fraction else 0), least_memory)
    size = order + inner + memory
    force = np.zeros((1 + memory, size))
    force[0, 0], force[0, order : order + inner] = environment.d[0, 0], environment.c[0]
    force[1:, order + inner :] = np.eye(memory)
    if not received:
        force[0] = force[1]
        environment = StateSpace(np.eye(inner), np.zeros((inner, 1)), environment.c, environment.d)
    matrix = np.zeros((size, size))
    matrix[:order, :order] = plant.transition
    matrix[:order] += plant.after @ force[plant.whole : plant.whole + 1]
    if plant.fraction:
        matrix[:order] += plant.before @ force[plant.whole + 1 : plant.whole + 2]
    matrix[order : order + inner, :1] = environment.b
    matrix[order : order + inner, order : order + inner] = environment.a
    matrix[order + inner :] = force[:memory]
    return matrix


def spectral_radius(matrix: Matrix) -> float:
    """Largest modulus of the eigenvalues."""
    return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))


def shift_mode(environment: StateSpace) -> Matrix | None:
    """State of an environment that has followed a shift by 1 and gives no force there; None when it gives one."""
    state = equilibrium(environment.a - np.eye(environment.order), environment.b[:, 0])
    force = environment.c[0] @ state + environment.d[0, 0]
    scale = np.abs(environment.c[0]) @ np.abs(state) + abs(environment.d[0, 0])
    return state if abs(force) <= 1e-9 * scale else None


def growth(plant: SampledPlant, environment: StateSpace) -> float:
    """Spectral radius of the loop without its shift mode, where it has one: below 1 is stable."""
    return spectral_radius(without_shift(loop_matrix(plant, environment), plant, environment))


def without_shift(matrix: Matrix, plant: SampledPlant, environment: StateSpace) -> Matrix:
    """A loop's matrix, its eigenvalue 1 left out where the handle may be left anywhere.

    With r the shift mode, r_0 = 1 the position, the rest of the states minus r times the position evolves by itself.
    """
    state = shift_mode(environment)
    if state is None or plant.shift is None:
        return matrix
    mode = np.zeros(len(matrix))
    order = len(plant.transition)
    mode[:order], mode[order : order + environment.order] = plant.shift, state
    rest: Matrix = matrix[1:, 1:] - np.outer(mode[1:], matrix[0, 1:])
    return rest


def scaled(environment: StateSpace, factor: float) -> StateSpace:
    """So many times its force."""
    return StateSpace(environment.a, environment.b, factor * environment.c, factor * environment.d)

"""A plant under a delayed hold, closed over a discrete environment: matrices and growth.

The position is sampled at t_k = k·T, the environment gives F_k, and F_k is held from t_k + td until t_{k+1} + td with
td = n·T + δ. Between these instants all is linear, so one period is exact.
"""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.exact import followed, zoh
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium

TACHOMETER = "tachometer"
"""In the place of an estimator: the drive reads velocity itself, and what the loop takes for the position follows."""


def environment(space: StateSpace, *, period: float, method: str | None, estimator: str | None) -> StateSpace:
    """The loop's environment x_k → F_k of a continuous (position, velocity) → force system.

    With a tachometer it is (x_k, v_k) → F_k where velocity matters, for a plant that is `integrated`. `method` is that
    of virtual states (`discretised`); `estimator` may be None when the velocity does not matter, else UsageError.
    """
    return estimated(discretised(space, period, method), period, estimator)


def discretised(space: StateSpace, period: float, method: str | None) -> StateSpace:
    """(position, velocity)_k → F_k; without a method exactly, the inputs on straight lines between samples.

    What a scene does not need is not imported.
    """
    if not space.order:
        return space
    if method is None:
        return followed(space, period)
    from haptic_fieldbus.numerics import integrators

    return integrators.discrete(space, period, method)


def estimated(space: StateSpace, period: float, estimator: str | None) -> StateSpace:
    """A discrete (position, velocity)_k → F_k whose velocity is estimated: x_k → F_k. Raises UsageError without one."""
    if not space.uses_velocity:
        return StateSpace(space.a, space.b[:, :1], space.c, space.d[:, :1])
    if estimator == TACHOMETER:
        return space
    if estimator is None:
        raise UsageError("a scene that uses velocity needs an estimator")
    from haptic_fieldbus.numerics import estimators

    return estimated_by(estimators.linear_form(estimator, period), space)


def estimated_by(velocity: StateSpace, space: StateSpace) -> StateSpace:
    """A discrete (x_1, v_1, x_2, …)_k → F_k of which `velocity` gives (v_1, v_2, …)_k: (x_1, x_2, …)_k → F_k."""
    from_position, from_velocity = space.b[:, ::2], space.b[:, 1::2]
    return StateSpace(
        a=np.block([[space.a, from_velocity @ velocity.c], [np.zeros((velocity.order, space.order)), velocity.a]]),
        b=np.vstack([from_position + from_velocity @ velocity.d, velocity.b]),
        c=np.hstack([space.c, space.d[:, 1::2] @ velocity.c]),
        d=space.d[:, ::2] + space.d[:, 1::2] @ velocity.d,
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


def integrated(plant: SampledPlant, period: float) -> SampledPlant:
    """A free mass as a tachometer tells of it: its first state is the trapezoid's sum of its second, the velocity.

    Where the mass is in truth does not come into the loop: nothing measures it, and no force depends on it.
    """
    start = np.eye(len(plant.transition))[:2]
    transition, before, after = (np.array(each) for each in (plant.transition, plant.before, plant.after))
    transition[0] = start[0] + 0.5 * period * (start[1] + plant.transition[1])
    before[0], after[0] = 0.5 * period * plant.before[1], 0.5 * period * plant.after[1]
    return SampledPlant(transition, before, after, plant.whole, plant.fraction, plant.shift)


def loop_matrix(
    plant: SampledPlant, environment: StateSpace, *, received: bool = True, least_memory: int = 0
) -> Matrix:
    """One period of the closed loop on the states (ξ, environment, F_{k−1}, F_{k−2}, …).

    The environment sees the first of ξ, or with two inputs the first two: position and velocity. Where the sample was
    not `received` the environment stands still and F_{k−1} goes on. So many forces are remembered at least.
    """
    order, inner = len(plant.transition), environment.order
    memory = max(plant.whole + (1 if plant.fraction else 0), least_memory)
    size = order + inner + memory
    force = np.zeros((1 + memory, size))
    inputs = environment.d.shape[1]
    force[0, :inputs], force[0, order : order + inner] = environment.d[0], environment.c[0]
    force[1:, order + inner :] = np.eye(memory)
    if not received:
        force[0] = force[1]
        environment = StateSpace(np.eye(inner), np.zeros((inner, inputs)), environment.c, environment.d)
    matrix = np.zeros((size, size))
    matrix[:order, :order] = plant.transition
    matrix[:order] += plant.after @ force[plant.whole : plant.whole + 1]
    if plant.fraction:
        matrix[:order] += plant.before @ force[plant.whole + 1 : plant.whole + 2]
    matrix[order : order + inner, :inputs] = environment.b
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
    rounding = 1e-15 * np.abs(environment.c[0]).sum()  # of what is stored, which may be far below 1
    return state if abs(force) <= 1e-9 * scale + rounding else None


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

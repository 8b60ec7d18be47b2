"""A plant under a delayed hold, closed over a discrete environment: matrices and growth.

The position is sampled at t_k = k·T, and the environment computes F_k from it. With the delay td = n·T + δ, F_k is held
from t_k + td until t_{k+1} + td. Between these instants everything is linear, so the map of one period is exact.
"""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium, followed, zoh

TACHOMETER = "tachometer"
"""Name in place of an estimator: the drive measures velocity, and the loop integrates its position from it."""

MOST_PERIODS = 200
"""Longest delay that is judged, in periods: each is a state of the sampled loop."""


def environment(space: StateSpace, *, period: float, method: str | None, estimator: str | None) -> StateSpace:
    """Return the discrete environment x_k → F_k of a continuous system (position, velocity) → force.

    With TACHOMETER, and a system that uses velocity, it is (x_k, v_k) → F_k for a plant that is `integrated`. `method`
    integrates virtual states as in `discretised`. `estimator` may be None when the system does not use velocity.
    Raises UsageError for an unknown method or estimator, and for a missing estimator.
    """
    return estimated(discretised(space, period, method), period, estimator)


def discretised(space: StateSpace, period: float, method: str | None) -> StateSpace:
    """Return the discrete system (position, velocity)_k → F_k of a continuous one.

    With a method it is that of `integrators.discrete`. Without one it is exact for inputs on straight lines between
    samples. Raises UsageError for an unknown method.
    """
    if not space.order:
        return space
    if method is None:
        return followed(space, period)
    from haptic_fieldbus.numerics import integrators  # only scenes with virtual states need it

    return integrators.discrete(space, period, method)


def estimated(space: StateSpace, period: float, estimator: str | None) -> StateSpace:
    """Return x_k → F_k for a discrete (position, velocity)_k → F_k whose velocity is estimated from the positions.

    With TACHOMETER a system that uses velocity stays as it is. Raises UsageError for an unknown estimator, and for None
    when the system uses velocity.
    """
    if not space.uses_velocity:
        return StateSpace(space.a, space.b[:, :1], space.c, space.d[:, :1])
    if estimator == TACHOMETER:
        return space
    if estimator is None:
        raise UsageError("a scene that uses velocity needs an estimator")
    from haptic_fieldbus.numerics import estimators  # only scenes that use velocity need it

    return estimated_by(estimators.linear_form(estimator, period), space)


def estimated_by(velocity: StateSpace, space: StateSpace) -> StateSpace:
    """Return (x_1, x_2, …)_k → F_k for a discrete `space` (x_1, v_1, x_2, v_2, …)_k → F_k.

    `velocity` is the estimator as a system (x_1, x_2, …)_k → (v_1, v_2, …)_k. Its states follow those of `space`.
    """
    from_position, from_velocity = space.b[:, ::2], space.b[:, 1::2]
    return StateSpace(
        a=np.block([[space.a, from_velocity @ velocity.c], [np.zeros((velocity.order, space.order)), velocity.a]]),
        b=np.vstack([from_position + from_velocity @ velocity.d, velocity.b]),
        c=np.hstack([space.c, space.d[:, 1::2] @ velocity.c]),
        d=space.d[:, ::2] + space.d[:, 1::2] @ velocity.d,
    )


@dataclass(frozen=True, eq=False)
class SampledPlant:
    """A plant over one period: ξ⁺ = Φ ξ + `before` F_{k−n−1} + `after` F_{k−n}; the position is the first of ξ.

    Shapes with m states: `transition` (m, m), `before` and `after` (m, 1), `shift` (m,).
    """

    transition: Matrix
    before: Matrix
    """Factor of the force that still acts during the first δ of the period."""
    after: Matrix
    whole: int
    """Number n of whole periods of delay."""
    fraction: float
    """Rest δ of the delay [s]."""
    shift: Matrix | None = None
    """State at rest with position 1 without a force; None when something holds the plant to the ground."""


def split_delay(delay: float, period: float) -> tuple[int, float]:
    """Return (n, δ [s]) with delay = n·period + δ and 0 ≤ δ < period.

    A delay within a billionth of a period of a whole number of periods counts as whole. Raises UsageError for a delay
    of more periods than are judged.
    """
    if not delay <= MOST_PERIODS * period:
        most = f"{MOST_PERIODS} periods, {exactly(MOST_PERIODS * period)} s"
        raise UsageError(f"delay {exactly(delay)} s: expected at most {most}")
    whole = math.floor(delay / period + 1e-9)
    fraction = delay - whole * period
    return whole, fraction if fraction > 1e-9 * period else 0.0


def sample(a: Matrix, b: Matrix, period: float, delay: float) -> SampledPlant:
    """Discretise ξ̇ = A ξ + B F exactly under the delayed hold; `a` (m, m), `b` (m, 1), the position first in ξ."""
    whole, fraction = split_delay(delay, period)
    first_transition, first = zoh(a, b, fraction)
    rest_transition, rest = zoh(a, b, period - fraction)
    return SampledPlant(rest_transition @ first_transition, rest_transition @ first, rest, whole, fraction, _shift(a))


def _shift(a: Matrix) -> Matrix | None:
    """Return the r with A r = 0 and r_0 = 1; None when there is none."""
    # Rows are scaled to 1, so that the tolerance means the same in units of any size.
    size = np.abs(a).max(axis=1, keepdims=True)
    rows = a / np.where(size > 0.0, size, 1.0)
    state: Matrix = np.append(1.0, np.linalg.lstsq(rows[:, 1:], -rows[:, 0], rcond=None)[0])
    return state if np.abs(rows @ state).max() <= 1e-9 else None


def integrated(plant: SampledPlant, period: float) -> SampledPlant:
    """Return a free mass whose first state is the position integrated from its second, the velocity, by the trapezoid.

    This is the position that the loop computes with a tachometer. The true position is no state: nothing measures it,
    and no force depends on it.
    """
    start = np.eye(len(plant.transition))[:2]
    transition, before, after = (np.array(each) for each in (plant.transition, plant.before, plant.after))
    # The trapezoid: x⁺ = x + T/2·(v + v⁺), where v⁺ is the second row of the plant.
    transition[0] = start[0] + 0.5 * period * (start[1] + plant.transition[1])
    before[0], after[0] = 0.5 * period * plant.before[1], 0.5 * period * plant.after[1]
    return SampledPlant(transition, before, after, plant.whole, plant.fraction, plant.shift)


def loop_matrix(
    plant: SampledPlant, environment: StateSpace, *, received: bool = True, least_memory: int = 0
) -> Matrix:
    """Return the matrix of one period of the closed loop on the states (ξ, environment, F_{k−1}, F_{k−2}, …).

    The inputs of the environment are the first state of ξ, or with two inputs the first two: position and velocity.
    When the sample was not `received`, the states of the environment keep their values and F_{k−1} is held. The matrix
    has at least `least_memory` earlier forces among its states.
    """
    order, inner = len(plant.transition), environment.order
    memory = max(plant.whole + (1 if plant.fraction else 0), least_memory)
    size = order + inner + memory
    force = np.zeros((1 + memory, size))  # row j: F_{k−j} from the states
    inputs = environment.d.shape[1]
    force[0, :inputs], force[0, order : order + inner] = environment.d[0], environment.c[0]
    force[1:, order + inner :] = np.eye(memory)
    if not received:
        force[0] = force[1]  # hence a `least_memory` of 1 in loops that may lose samples
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
    """Return the largest modulus of the eigenvalues of a square matrix; 0 for an empty one."""
    return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))


def shift_mode(environment: StateSpace) -> Matrix | None:
    """Return the state (n,) of an environment that has followed a shift by 1; None when it then gives a force."""
    state = equilibrium(environment.a - np.eye(environment.order), environment.b[:, 0])
    force = environment.c[0] @ state + environment.d[0, 0]
    scale = np.abs(environment.c[0]) @ np.abs(state) + abs(environment.d[0, 0])
    rounding = 1e-15 * np.abs(environment.c[0]).sum()  # of the stored state, which may be far below 1
    return state if abs(force) <= 1e-9 * scale + rounding else None


def growth(plant: SampledPlant, environment: StateSpace) -> float:
    """Return the spectral radius of the loop without its shift mode, if it has one; below 1 is stable."""
    return spectral_radius(without_shift(loop_matrix(plant, environment), plant, environment))


def without_shift(matrix: Matrix, plant: SampledPlant, environment: StateSpace) -> Matrix:
    """Return a loop's matrix without the eigenvalue 1 of its shift mode; unchanged when it has no shift mode.

    A loop has a shift mode when the handle may be left anywhere. With r the shift mode and r_0 = 1 at the position, the
    other states minus r times the position evolve by themselves.
    """
    state = shift_mode(environment)
    if state is None or plant.shift is None:
        return matrix
    mode = np.zeros(len(matrix))
    order = len(plant.transition)
    mode[:order], mode[order : order + environment.order] = plant.shift, state
    return np.asarray(matrix[1:, 1:] - np.outer(mode[1:], matrix[0, 1:]))


def scaled(environment: StateSpace, factor: float) -> StateSpace:
    """Return the environment with `factor` times its force."""
    return StateSpace(environment.a, environment.b, factor * environment.c, factor * environment.d)

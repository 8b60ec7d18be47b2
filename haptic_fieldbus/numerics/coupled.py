"""Several sampled plants under delayed holds, closed over one discrete environment: matrices and growth.

All positions are sampled at t_k = k·T. The environment computes all forces, (x_1 … x_n)_k → (F_1 … F_n)_k. The force of
each axis is held from t_k + td until t_{k+1} + td with the delay td of that axis. Each axis is a
`sampled.SampledPlant`; the map of one period is exact, as for a single axis.

Some motions of the handles together may meet no force, for example both ends of a virtual shaft turned alike. For each
such direction the loop has an eigenvalue of exactly 1: the handles stay where they are left. This is no instability.

Example: a spring-damper ties two axes, F1 = −K·u − B·u̇ and F2 = −n·F1 with u = x1 − n·x2. For devices with the same
b/m, delay and torque loop, u follows the equation of one device of mass 1/(1/m1 + n²/m2) at a wall of K and B. Two
equal axes at n = 1 behave as the device itself at 2·K and 2·B.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium, gain, parallel
from haptic_fieldbus.numerics.sampled import SampledPlant, discretised, estimated_by, spectral_radius

FORCELESS = 1e-9
"""Share of the cancelling forces below which their sum counts as no force."""
ROUNDING = 1e-13
"""Share of the cancelling terms in the environment's states that may be rounding."""


def spring_damper(stiffness: float, damping: float = 0.0, ratio: float = 1.0) -> StateSpace:
    """Return the coupling (x1, v1, x2, v2) → (F1, F2) of a virtual shaft between x1 and `ratio`·x2."""
    one = np.array([stiffness, damping])
    first = np.concatenate([-one, ratio * one])
    return gain([first.tolist(), (-ratio * first).tolist()])


def embedded(space: StateSpace, place: int, axes: int) -> StateSpace:
    """Return a system of one axis as a system of all `axes` that uses the inputs of that axis and acts on it alone."""
    return among(space, (place,), axes)


def among(space: StateSpace, places: Sequence[int], axes: int) -> StateSpace:
    """Return a system of some axes as a system of all `axes`; its inputs and outputs are in the order of `places`."""
    inputs = space.b.shape[1] // len(places)
    take, act = np.zeros((space.b.shape[1], inputs * axes)), np.zeros((axes, len(places)))
    for number, place in enumerate(places):
        take[number * inputs : (number + 1) * inputs, place * inputs : (place + 1) * inputs] = np.eye(inputs)
        act[place, number] = 1.0
    return StateSpace(space.a, space.b @ take, act @ space.c, act @ space.d @ take)


def environment(
    space: StateSpace, *, period: float, method: str | None, estimators: Sequence[str | None]
) -> StateSpace:
    """Return the environment (x_1 … x_n)_k → (F_1 … F_n)_k of a continuous system with inputs (x_1, v_1, x_2, v_2, …).

    `estimators` holds one name for each axis. `method` may be None without virtual states, and an estimator when the
    velocity of its axis is not used. Raises UsageError for a missing or unknown method or estimator.
    """
    if space.order and method is None:
        raise UsageError("a coupling with virtual states needs an integrator")
    space = discretised(space, period, method)
    return estimated_by(_velocities(space, period, estimators), space)


def _velocities(space: StateSpace, period: float, estimators: Sequence[str | None]) -> StateSpace:
    """Return the system (x_1 … x_n)_k → (v_1 … v_n)_k; a velocity that is not used is 0."""
    axes = len(estimators)
    found = gain(np.zeros((axes, axes)).tolist())
    for place, name in enumerate(estimators):
        if not (space.b[:, 2 * place + 1].any() or space.d[:, 2 * place + 1].any()):
            continue
        if name is None:
            raise UsageError("a coupling that uses velocity needs an estimator on each of its axes")
        from haptic_fieldbus.numerics.estimators import linear_form  # only couplings that use velocity need it

        found = parallel([found, embedded(linear_form(name, period), place, axes)])
    return found


def loop_matrix(plants: Sequence[SampledPlant], environment: StateSpace) -> Matrix:
    """Return the matrix of one period of the closed loop on the states (ξ_1 … ξ_n, environment, earlier F_1, F_2 …)."""
    starts, inner, queues = _layout(plants, environment)
    size, axes = queues[-1].stop, range(len(plants))
    positions = np.zeros((len(plants), size))
    positions[axes, [start.start for start in starts]] = 1.0
    forces = environment.d @ positions
    forces[:, inner] = environment.c
    matrix = np.zeros((size, size))
    matrix[inner] = environment.b @ positions
    matrix[inner, inner] = environment.a
    for plant, own, queue, force in zip(plants, starts, queues, forces, strict=True):
        memory = queue.stop - queue.start
        acting = np.zeros((1 + memory, size))
        acting[0], acting[1:, queue] = force, np.eye(memory)
        matrix[own, own] = plant.transition
        matrix[own] += plant.after @ acting[plant.whole : plant.whole + 1]
        if plant.fraction:
            matrix[own] += plant.before @ acting[plant.whole + 1 : plant.whole + 2]
        matrix[queue] = acting[:memory]
    return matrix


def _layout(plants: Sequence[SampledPlant], environment: StateSpace) -> tuple[list[slice], slice, list[slice]]:
    """Return the places of the states of each plant, of the environment, and of the earlier forces of each axis."""
    orders = [len(plant.transition) for plant in plants]
    ends = np.cumsum([*orders, environment.order, *[plant.whole + bool(plant.fraction) for plant in plants]]).tolist()
    parts = [slice(*edge) for edge in zip([0, *ends[:-1]], ends, strict=True)]
    return parts[: len(plants)], parts[len(plants)], parts[len(plants) + 1 :]


def shift_modes(plants: Sequence[SampledPlant], environment: StateSpace) -> tuple[Matrix, Matrix]:
    """Return (directions, states): the independent shifts of the handles that meet no force, one in each column.

    `directions` is (n_axes, n_shifts). `states` is (order, n_shifts), the state of an environment that has followed.
    """
    step = environment.a - np.eye(environment.order)
    states = equilibrium(step, environment.b)
    held = np.array([[float(plant.shift is None)] for plant in plants]) * np.eye(len(plants))
    forces, moves = environment.c @ states + environment.d, step @ states + environment.b
    terms = [np.abs(environment.c) @ np.abs(states) + np.abs(environment.d)]
    terms += [np.abs(step) @ np.abs(states) + np.abs(environment.b), held]
    # A state that is exactly 0 at rest is computed as the rounding of its cancelling terms. A force may consist of
    # nothing else, and must then count as 0.
    rounding = ROUNDING * np.abs(environment.c) @ np.abs(np.linalg.pinv(step)) @ terms[1]
    found = np.vstack([np.where(np.abs(forces) > rounding, forces, 0.0), moves, held])
    size = np.vstack(terms)
    # Rows and columns are scaled by the sizes of their cancelling terms, so that one tolerance holds in all units.
    rows = _not_zero(size.max(axis=1, keepdims=True))
    columns = _not_zero((size / rows).max(axis=0, keepdims=True))
    _, values, basis = np.linalg.svd(found / rows / columns)
    directions: Matrix = (basis[values <= FORCELESS] / columns).T
    return directions, states @ directions


def _not_zero(size: Matrix) -> Matrix:
    return np.where(size > 0.0, size, 1.0)


def without_shifts(matrix: Matrix, plants: Sequence[SampledPlant], environment: StateSpace) -> Matrix:
    """Return a loop's matrix without the eigenvalue 1 of each shift mode.

    The columns of R are the modes of these shifts, scaled to the identity at as many positions. The other states minus
    R times these positions evolve by themselves.
    """
    directions, states = shift_modes(plants, environment)
    starts, inner, _ = _layout(plants, environment)
    axes, count = directions.shape
    # The positions that separate the shifts best: their part of the directions is inverted below.
    chosen = max(combinations(range(axes), count), key=lambda rows: abs(np.linalg.det(directions[list(rows)])))
    modes = np.zeros((len(matrix), count))
    modes[inner] = states
    for plant, own, direction in zip(plants, starts, directions, strict=True):
        if plant.shift is not None:
            modes[own] = np.outer(plant.shift, direction)
    modes = modes @ np.linalg.inv(directions[list(chosen)])
    pivots = [starts[place].start for place in chosen]
    kept = np.delete(np.arange(len(matrix)), pivots)
    return np.asarray(matrix[np.ix_(kept, kept)] - modes[kept] @ matrix[np.ix_(pivots, kept)])


def growth(plants: Sequence[SampledPlant], environment: StateSpace) -> float:
    """Return the spectral radius of the loop without its shift modes, if it has any; below 1 is stable."""
    return spectral_radius(without_shifts(loop_matrix(plants, environment), plants, environment))

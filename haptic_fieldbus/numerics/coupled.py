"""Several sampled plants under delayed holds, closed over one discrete environment: matrices and growth.

All positions are sampled at t_k = k·T, the environment gives all forces, (x_1 … x_n)_k → (F_1 … F_n)_k, and the force
of each axis is held from its own t_k + td until t_{k+1} + td. Each axis is a `sampled.SampledPlant`, and one period of
all is as exact as that of one.

Where a motion of the handles together meets no force (both ends of a virtual shaft turned alike) the loop has an
eigenvalue of exactly 1 for each such direction: the handles stay where they are left. That is no instability.

Two axes tied by a spring-damper, F1 = −K·u − B·u̇ and F2 = −n·F1 with u = x1 − n·x2: devices with the same b/m, delay
and torque loop leave one equation for u, that of one device of mass 1/(1/m1 + n²/m2) at a wall of K and B. Two equal
axes at n = 1 are the device itself at 2·K and 2·B.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, equilibrium, gain, parallel
from haptic_fieldbus.numerics.sampled import SampledPlant, discretised, estimated_by, spectral_radius

FORCELESS = 1e-9
"""Of the forces that cancel: less than this is none."""
ROUNDING = 1e-13
"""Of what cancels within the environment's states."""


def spring_damper(stiffness: float, damping: float = 0.0, ratio: float = 1.0) -> StateSpace:
    """The coupling (x1, v1, x2, v2) → (F1, F2) of a virtual shaft between x1 and `ratio`·x2."""
    one = np.array([stiffness, damping])
    first = np.concatenate([-one, ratio * one])
    return gain([first.tolist(), (-ratio * first).tolist()])


def embedded(space: StateSpace, place: int, axes: int) -> StateSpace:
    """A system of one axis among so many: it takes that axis' inputs and acts on it alone."""
    return among(space, (place,), axes)


def among(space: StateSpace, places: Sequence[int], axes: int) -> StateSpace:
    """A system of some axes among so many: it takes their inputs, in the order of `places`, and acts on them alone."""
    inputs = space.b.shape[1] // len(places)
    take, act = np.zeros((space.b.shape[1], inputs * axes)), np.zeros((axes, len(places)))
    for number, place in enumerate(places):
        take[number * inputs : (number + 1) * inputs, place * inputs : (place + 1) * inputs] = np.eye(inputs)
        act[place, number] = 1.0
    return StateSpace(space.a, space.b @ take, act @ space.c, act @ space.d @ take)


def environment(
    space: StateSpace, *, period: float, method: str | None, estimators: Sequence[str | None]
) -> StateSpace:
    """The loop's environment (x_1 … x_n)_k → (F_1 … F_n)_k of a continuous system with inputs (x_1, v_1, x_2, v_2, …).

    One estimator an axis; as for one axis, `method` may be None without virtual states and an estimator where that
    velocity does not matter, else UsageError.
    """
    if space.order and method is None:
        raise UsageError("a coupling with virtual states needs an integrator")
    space = discretised(space, period, method)
    return estimated_by(_velocities(space, period, estimators), space)


def _velocities(space: StateSpace, period: float, estimators: Sequence[str | None]) -> StateSpace:
    """(x_1 … x_n)_k → (v_1 … v_n)_k, 0 where a velocity does not matter."""
    axes = len(estimators)
    found = gain(np.zeros((axes, axes)).tolist())
    for place, name in enumerate(estimators):
        if not (space.b[:, 2 * place + 1].any() or space.d[:, 2 * place + 1].any()):
            continue
        if name is None:
            raise UsageError("a coupling that uses velocity needs an estimator on each of its axes")
        from haptic_fieldbus.numerics.estimators import linear_form

        found = parallel([found, embedded(linear_form(name, period), place, axes)])
    return found


def loop_matrix(plants: Sequence[SampledPlant], environment: StateSpace) -> Matrix:
    """One period of the closed loop on the states (ξ_1 … ξ_n, environment, F_1 of before and earlier, F_2 …)."""
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
    """Where the states of each plant, of the environment, and the forces of each axis stand."""
    orders = [len(plant.transition) for plant in plants]
    memories = [plant.whole + bool(plant.fraction) for plant in plants]
    ends = np.cumsum([*orders, environment.order, *memories]).tolist()
    parts = [slice(*edge) for edge in zip([0, *ends[:-1]], ends, strict=True)]
    return parts[: len(plants)], parts[len(plants)], parts[len(plants) + 1 :]


def shift_modes(plants: Sequence[SampledPlant], environment: StateSpace) -> tuple[Matrix, Matrix]:
    """(directions, states): the independent shifts of the handles that meet no force, one a column.

    A direction has an entry for each axis; beside it stands the state of an environment that has followed it.
    """
    step = environment.a - np.eye(environment.order)
    states = equilibrium(step, environment.b)
    held = np.array([[float(plant.shift is None)] for plant in plants]) * np.eye(len(plants))
    forces, moves = environment.c @ states + environment.d, step @ states + environment.b
    terms = [np.abs(environment.c) @ np.abs(states) + np.abs(environment.d)]
    terms += [np.abs(step) @ np.abs(states) + np.abs(environment.b), held]
    # A state that is 0 at rest is the rounding of what cancels in it, and may be all that a force is made of.
    rounding = ROUNDING * np.abs(environment.c) @ np.abs(np.linalg.pinv(step)) @ terms[1]
    found = np.vstack([np.where(np.abs(forces) > rounding, forces, 0.0), moves, held])
    size = np.vstack(terms)
    rows = _not_zero(size.max(axis=1, keepdims=True))
    columns = _not_zero((size / rows).max(axis=0, keepdims=True))
    _, values, basis = np.linalg.svd(found / rows / columns)
    directions: Matrix = (basis[values <= FORCELESS] / columns).T
    return directions, states @ directions


def _not_zero(size: Matrix) -> Matrix:
    return np.where(size > 0.0, size, 1.0)


def without_shifts(matrix: Matrix, plants: Sequence[SampledPlant], environment: StateSpace) -> Matrix:
    """A loop's matrix, an eigenvalue 1 left out for each direction in which the handles may be left anywhere.

    With R the modes of these shifts, scaled to 1 at as many positions, the other states minus R times these positions
    evolve by themselves.
    """
    directions, states = shift_modes(plants, environment)
    starts, inner, _ = _layout(plants, environment)
    axes, count = directions.shape
    chosen = max(combinations(range(axes), count), key=lambda rows: abs(np.linalg.det(directions[list(rows)])))
    modes = np.zeros((len(matrix), count))
    modes[inner] = states
    for plant, own, direction in zip(plants, starts, directions, strict=True):
        if plant.shift is not None:
            modes[own] = np.outer(plant.shift, direction)
    modes = modes @ np.linalg.inv(directions[list(chosen)])
    pivots = [starts[place].start for place in chosen]
    kept = np.setdiff1d(np.arange(len(matrix)), pivots)
    rest: Matrix = matrix[np.ix_(kept, kept)] - modes[kept] @ matrix[np.ix_(pivots, kept)]
    return rest


def growth(plants: Sequence[SampledPlant], environment: StateSpace) -> float:
    """Spectral radius of the loop without its shift modes, where it has some: below 1 is stable."""
    return spectral_radius(without_shifts(loop_matrix(plants, environment), plants, environment))

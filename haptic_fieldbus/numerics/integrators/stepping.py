"""Linear steps in plain floats, as the loop runs them: closures over a few numbers, nothing that grows.

A step works with deviations from where the handle is at its first call, at rest there: at a handle that stands still
the force is exactly constant, and digits are not spent on how far from zero that is. Numbers that are not finite are
passed on, an overflow becomes one of them; safety sees them in the force.
"""

from collections.abc import Callable

import numpy as np

from haptic_fieldbus.numerics.integrators.method import OneStep
from haptic_fieldbus.numerics.linear import Matrix, StateSpace

Step = Callable[..., float]
"""Position[, velocity] of this period → force or torque on the handle [N or N·m]; remembers the virtual states."""

Row = tuple[float, ...]


def bind_pair(system: StateSpace, stiffness: float) -> Step:
    """Two states driven by position, in the coordinates (C z, C E z), where by Cayley and Hamilton a step is short."""
    e, g, c = system.a, system.b[:, 0], system.c[0]
    trace, determinant = float(e[0, 0] + e[1, 1]), float(e[0, 0] * e[1, 1] - e[0, 1] * e[1, 0])
    g0, g1, d = float(c @ g), float(c @ e @ g), float(system.d[0, 0])
    origin: float | None = None
    z0 = z1 = base = 0.0

    def step(position: float) -> float:
        nonlocal origin, base, z0, z1
        if origin is None:
            origin, base = position, stiffness * position
        u = position - origin
        force: float = base + (z0 + d * u)
        z0, z1 = z0 + (z1 + g0 * u), z1 + (trace * z1 - determinant * z0 + g1 * u)
        return force

    return step


def bind_general(system: StateSpace, stiffness: float) -> Step:
    """Any number of states, driven by position and velocity."""
    updates, outputs = _rows(system.a, system.b), _rows(system.c, system.d)[0]
    state = [0.0] * system.order
    origin: float | None = None
    base = 0.0

    def step(position: float, velocity: float) -> float:
        nonlocal origin, base, state
        if origin is None:
            origin, base = position, stiffness * position
        known = (*state, position - origin, velocity)
        state = [z + _dot(row, known) for z, row in zip(state, updates, strict=True)]
        return base + _dot(outputs, known)

    return step


def bind_from(one: OneStep, start: Matrix) -> Callable[..., tuple[float, ...]]:
    """A step from given true states: inputs of this sample → (y_n…, z_n…), the outputs and then the true states."""
    system, (by_state, by_input) = one.increments, one.state
    updates = _rows(system.a, system.b)
    outputs = (*_rows(system.c, system.d), *_rows(by_state, by_input))
    state: list[float] | None = None

    def step(*inputs: float) -> tuple[float, ...]:
        nonlocal state
        if state is None:
            state = one.stored(start, np.array(inputs)).tolist()
        known = (*state, *inputs)
        state = [z + _dot(row, known) for z, row in zip(state, updates, strict=True)]
        return tuple(_dot(row, known) for row in outputs)

    return step


def _rows(left: Matrix, right: Matrix) -> tuple[Row, ...]:
    return tuple(map(tuple, np.hstack([left, right]).tolist()))


def _dot(left: Row, right: Row) -> float:
    return sum(map(float.__mul__, left, right))

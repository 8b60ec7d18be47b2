"""Definition of an integrator: a rule that turns a continuous linear system into one step, with its claimed figures.

Linear steps are in plain floats for the loop: closures over a few numbers, without allocations that grow. A step works
with deviations from the position of its first call, and is at rest there. The force on a handle that stands still is
therefore exactly constant, and no digits are lost to a position far from zero. Numbers that are not finite are passed
on, and an overflow becomes such a number; the safety of the cycle sees them in the force.

Of two and of four states, as the shipped elements have, each state is a variable of its own, because walking over rows
costs ten times as much as the products. All variants add the same products in the same order, the states' products
first, so that the choice of the variant does not change the numbers.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import mul

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import Matrix, StateSpace


@dataclass(frozen=True, eq=False)
class OneStep:
    """One step of a method on the states w that the method stores, and the true states z that belong to them.

    `increments` holds (E, G, C, D) of w_{n+1} − w_n = E w_n + G u_n and y_n = C w_n + D u_n. `state` holds (J, K) of
    z_n = J w_n + K u_n, shapes (n, n) and (n, n_in). E = Φ − I is kept instead of Φ, because it keeps all its digits
    when the period is tiny.
    """

    increments: StateSpace
    state: tuple[Matrix, Matrix]

    @property
    def system(self) -> StateSpace:
        """The discrete system w_{n+1} = Φ w_n + G u_n, y_n = C w_n + D u_n."""
        step = self.increments
        return StateSpace(step.a + np.eye(step.order), step.b, step.c, step.d)

    def stored(self, states: Matrix, inputs: Matrix) -> Matrix:
        """Return the stored states w (n,) for true states (n,) and inputs (n_in,) at the first sample."""
        by_state, by_input = self.state
        return np.asarray(np.linalg.solve(by_state, states - by_input @ inputs), dtype=np.float64)


@dataclass(frozen=True)
class Integrator:
    """A method: its name, the figures that it claims, and its step."""

    name: str
    order: int
    """Order of the error over a fixed time, ∝ period^order, for a smooth input that is known at the samples."""
    free_order: float
    """Order without input, from states given at the first sample; ∞ for a method without error."""
    inputs: str
    """Input samples that the step to z_n uses."""
    update: str
    """Order of the operations in a step, for people."""
    growth: Callable[[complex], complex] | None
    """Growth factor of a mode of eigenvalue λ in one step, from λ·T; None when it depends on more than λ·T."""
    oscillator_growth: Callable[[float], float]
    """Spectral radius of one step on an undamped oscillator, from h = T·√(k/m)."""
    oscillator_limit: float
    """Largest h at which the spectral radius is at most 1."""
    lag_limit: float
    """Largest T·λ at which a decay ż = −λ z does not grow."""
    discretise: Callable[[StateSpace, float], OneStep]
    """Function from (continuous system, period [s]) to one step; it does not check them."""


def check_system(space: StateSpace, period: float) -> None:
    """Check the period [s] and the entries of a system.

    Raises UsageError for a period that is not a finite number above 0, and for an entry that is not finite.
    """
    if not 0.0 < period < math.inf:
        raise UsageError(f"period {exactly(period)} s: expected a finite number above 0")
    for name in ("a", "b", "c", "d"):
        matrix: Matrix = getattr(space, name)
        if not np.isfinite(matrix).all():
            at = tuple(np.argwhere(~np.isfinite(matrix))[0].tolist())
            raise UsageError(
                f"{name.upper()}{list(at)} of the virtual states is {matrix[at]}: expected finite numbers; a mass must "
                "be above 0, a stiffness and a damping be numbers"
            )


Step = Callable[..., float]
"""Step from position[, velocity] of a period to the force on the handle [N or N·m]; it remembers the virtual states."""

Row = tuple[float, ...]
Rows = tuple[Row, ...]


def bind_pair(system: StateSpace, stiffness: float) -> Step:
    """Return a step of two states driven by position; `stiffness` is the force per position at rest.

    `system` holds increments (see `method.OneStep`). The coordinates are (C z, C E z): by the theorem of Cayley and
    Hamilton a step then needs the trace and the determinant of E alone.
    """
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
    """Return a step of any number of states, driven by position and velocity; the velocity is 0 when left out."""
    updates, outputs = _rows(system.a, system.b), _rows(system.c, system.d)[0]
    return _UNROLLED.get(system.order, _bind_many)(updates, outputs, stiffness)


def _bind_two(updates: Rows, outputs: Row, stiffness: float) -> Step:
    (e00, e01, g0, h0), (e10, e11, g1, h1) = updates
    c0, c1, d0, d1 = outputs
    origin: float | None = None
    z0 = z1 = base = 0.0

    def step(position: float, velocity: float = 0.0) -> float:
        nonlocal origin, base, z0, z1
        if origin is None:
            origin, base = position, stiffness * position
        u = position - origin
        force: float = base + (c0 * z0 + c1 * z1 + d0 * u + d1 * velocity)
        z0, z1 = (
            z0 + (e00 * z0 + e01 * z1 + g0 * u + h0 * velocity),
            z1 + (e10 * z0 + e11 * z1 + g1 * u + h1 * velocity),
        )
        return force

    return step


def _bind_four(updates: Rows, outputs: Row, stiffness: float) -> Step:
    (e00, e01, e02, e03, g0, h0), (e10, e11, e12, e13, g1, h1) = updates[:2]
    (e20, e21, e22, e23, g2, h2), (e30, e31, e32, e33, g3, h3) = updates[2:]
    c0, c1, c2, c3, d0, d1 = outputs
    origin: float | None = None
    z0 = z1 = z2 = z3 = base = 0.0

    def step(position: float, velocity: float = 0.0) -> float:
        nonlocal origin, base, z0, z1, z2, z3
        if origin is None:
            origin, base = position, stiffness * position
        u = position - origin
        force: float = base + (c0 * z0 + c1 * z1 + c2 * z2 + c3 * z3 + d0 * u + d1 * velocity)
        z0, z1, z2, z3 = (
            z0 + (e00 * z0 + e01 * z1 + e02 * z2 + e03 * z3 + g0 * u + h0 * velocity),
            z1 + (e10 * z0 + e11 * z1 + e12 * z2 + e13 * z3 + g1 * u + h1 * velocity),
            z2 + (e20 * z0 + e21 * z1 + e22 * z2 + e23 * z3 + g2 * u + h2 * velocity),
            z3 + (e30 * z0 + e31 * z1 + e32 * z2 + e33 * z3 + g3 * u + h3 * velocity),
        )
        return force

    return step


_UNROLLED: dict[int, Callable[[Rows, Row, float], Step]] = {2: _bind_two, 4: _bind_four}
"""Binding functions by the number of states."""


def _bind_many(updates: Rows, outputs: Row, stiffness: float) -> Step:
    state = [0.0] * len(updates)
    origin: float | None = None
    base = 0.0

    def step(position: float, velocity: float = 0.0) -> float:
        nonlocal origin, base, state
        if origin is None:
            origin, base = position, stiffness * position
        known = (*state, position - origin, velocity)
        state = [z + _dot(row, known) for z, row in zip(state, updates, strict=True)]
        return base + _dot(outputs, known)

    return step


def bind_from(one: OneStep, start: Matrix) -> Callable[..., tuple[float, ...]]:
    """Return a step from the inputs of a sample to (y_n…, z_n…), the outputs and then the true states.

    `start`, (n,), holds the true states at the first call.
    """
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


def _rows(left: Matrix, right: Matrix) -> Rows:
    return tuple(map(tuple, np.hstack([left, right]).tolist()))


def _dot(left: Sequence[float], right: Sequence[float]) -> float:
    """Return the dot product, added one product after the other."""
    # From Python 3.12 on `sum` adds with compensation: other digits than the unrolled steps, and slower.
    total = 0.0
    for product in map(mul, left, right):
        total += product
    return total


# A run of a method along given inputs, with its states; it ends at the first number that is not finite.


@dataclass(frozen=True, eq=False)
class SampledTrajectory:
    """Outputs (m, n_out) and true states (m, order) at the samples; m is less than requested when the run diverged."""

    outputs: Matrix
    states: Matrix
    diverged_at: int | None
    """First sample with an output or a state that is not finite, left out with all later samples; or None."""

    @property
    def diverged(self) -> bool:
        return self.diverged_at is not None


def follow(one: OneStep, inputs: NDArray[np.float64], start: Sequence[float] | Matrix) -> SampledTrajectory:
    """Run one step along inputs (N, n_in), from the true states `start` (n,) at the first sample."""
    step = bind_from(one, np.asarray(start, dtype=np.float64))
    rows: list[tuple[float, ...]] = []
    diverged_at = None
    for sample, row in enumerate(inputs.tolist()):
        found = step(*row)
        if not all(map(math.isfinite, found)):
            diverged_at = sample
            break
        rows.append(found)
    outputs = len(one.increments.c)
    table = np.array(rows, dtype=np.float64).reshape(len(rows), outputs + one.increments.order)
    return SampledTrajectory(table[:, :outputs], table[:, outputs:], diverged_at)

"""Linear systems in continuous and discrete time, as plain matrices."""

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
    """Return the z with A z + b = 0, shaped as `b`, (n,) or (n, m); the smallest of the best fits for a singular A."""
    try:
        return np.asarray(np.linalg.solve(a, -b), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(a, -b, rcond=None)[0], dtype=np.float64)

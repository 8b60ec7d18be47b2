"""Linear systems in continuous and discrete time, as plain matrices."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """ẋ = A x + B u, y = C x + D u (or x⁺ = …, where said so).

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
        """Whether the second input of a (position, velocity) system matters."""
        return bool(np.any(self.b[:, 1]) or np.any(self.d[:, 1]))


def gain(d: list[list[float]]) -> StateSpace:
    """A memoryless system y = D u."""
    matrix = np.array(d, dtype=float)
    n_out, n_in = matrix.shape
    return StateSpace(np.zeros((0, 0)), np.zeros((0, n_in)), np.zeros((n_out, 0)), matrix)


def parallel(systems: list[StateSpace]) -> StateSpace:
    """The sum of systems that share their inputs."""
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
    """The z with A z + b = 0; the smallest where it is not unique."""
    try:
        return np.asarray(np.linalg.solve(a, -b), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(a, -b, rcond=None)[0], dtype=np.float64)

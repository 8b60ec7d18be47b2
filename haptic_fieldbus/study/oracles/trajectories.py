"""Free motion of a linear system ẋ = A x at equally spaced instants, with the digits of `numpy.longdouble`.

The exponential is the series of a small part of A·T, squared again and again. The motion is doubled: the states from n
to 2n are those from 0 to n, moved by n·T. A motion of N steps therefore takes log₂ N products, and rounds as often.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Long = NDArray[np.longdouble]
TERMS, SMALL = 24, 0.25
"""Terms of the series, and the largest norm for which it is taken: the first term left out is below 1e-38."""


def states_of(system: Array, start: Array, period: float, steps: int) -> Array:
    """Return the states at 0, T, … steps·T for A (n, n) and a start (n,), shape (steps + 1, n)."""
    power = exponential(np.asarray(system, dtype=np.longdouble) * np.longdouble(period))
    states: Long = np.asarray(start, dtype=np.longdouble)[None]
    while len(states) <= steps:
        states = np.concatenate([states, states @ power.T])
        power = power @ power
    return states[: steps + 1].astype(np.float64)


def exponential(matrix: Long) -> Long:
    """Return e^M of a square matrix."""
    norm = float(np.abs(matrix).sum(axis=1).max(initial=0.0))
    halvings = max(0, math.ceil(math.log2(norm / SMALL))) if norm else 0
    part = matrix / np.longdouble(2) ** halvings
    total = term = np.eye(len(matrix), dtype=np.longdouble)
    for order in range(1, TERMS):
        term = term @ part / np.longdouble(order)
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total

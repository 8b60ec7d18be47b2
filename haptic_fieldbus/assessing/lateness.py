"""What of an error is delay alone: a force of the right shape that comes late.

An edge that the handle meets between two samples comes later than the loop by a part of a period, so that no single
delay explains all edges of a scene. Of all delays that the loop can have, the one that explains most is taken. The
torque loop rounds each edge off by its lag, which is no distortion either.
"""

import math

import numpy as np

from haptic_fieldbus.assessing.element_forces import POINTS_PER_PERIOD
from haptic_fieldbus.assessing.recording import Array, Times

LONGEST_LAG = 512
"""Points that a lag may reach back."""


class Lateness:
    """The delays of a loop with a `period`, a `transport` delay and a `lag` of the torque behind it [s]."""

    def __init__(self, period: float, transport: float, lag: float) -> None:
        parts = round(POINTS_PER_PERIOD)
        self.delays = [transport + period * part / parts for part in range(parts + 1)]
        """[s]"""
        points = max(1e-9, lag * POINTS_PER_PERIOD / period)
        length = min(LONGEST_LAG, math.ceil(8.0 * points))
        weights = np.exp(-np.arange(length) / points) if length else np.ones(1)
        self._weights: Array = weights / weights.sum()

    def ideals(self, times_ns: Times, nodes_ns: Times, ideal: Array) -> list[Array]:
        """Return the `ideal` of the nodes as it is with each delay at these times, each `(n_times,)`."""
        behind = np.convolve(ideal, self._weights)[: len(ideal)]
        return [np.interp(times_ns - 1e9 * delay, nodes_ns, behind) for delay in self.delays]

"""A run of a method along given inputs, with its states; it ends at the first number that is not finite."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics.integrators.method import OneStep
from haptic_fieldbus.numerics.integrators.stepping import bind_from
from haptic_fieldbus.numerics.linear import Matrix


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

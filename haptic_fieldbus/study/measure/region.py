"""The K–B region of a wall: predicted by eigenvalues and by passivity, measured by letting many loops run at once.

Measured: a handle that is flicked swings against a bilateral wall, period by period: sample, backward difference, force
after the delay, held. A loop whose largest excursion in the last quarter of the run is above that in the second is
unstable; close to a boundary, motions neither grow nor fade within a run, and it cannot tell.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.margins import passive_limit_of, stiffness_limit
from haptic_fieldbus.numerics import batch
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.loops import Array, loops
from haptic_fieldbus.numerics.sampled import environment
from haptic_fieldbus.study.measure.bench import Bench


@dataclass(frozen=True, eq=False)
class Region:
    """Of one bench: axes of the grid, what was measured there, and the predicted limits along the damping."""

    title: str
    stiffness: Array
    """(n,) [N/m]"""
    damping: Array
    """(m,) [N·s/m]"""
    grew: NDArray[np.bool_]
    """Measured, (m, n): whether the loop grew."""
    stable_limit: Array
    """Predicted, (m,) [N/m]"""
    passive_limit: Array
    """Predicted, (m,) [N/m]"""

    @property
    def agreement(self) -> float:
        """Share of grid points, further than 1 % from the predicted boundary, where both say the same."""
        predicted = self.stiffness[None, :] > self.stable_limit[:, None]
        apart = np.abs(self.stiffness[None, :] - self.stable_limit[:, None]) > 0.01 * self.stable_limit.max()
        return float((predicted == self.grew)[apart].mean())


def wall(stiffness: float, damping: float, period: float, estimator: str = DEFAULT_ESTIMATOR) -> StateSpace:
    """As the loop runs it."""
    return environment(gain([[-stiffness, -damping]]), period=period, method=None, estimator=estimator)


def predicted(bench: Bench, damping: float) -> tuple[float, float]:
    """(stable, passive) stiffness with that damping [N/m]."""
    loop = bench.plant, bench.period, bench.delay, partial(wall, damping=damping, period=bench.period)
    stable = stiffness_limit(*loop)
    return stable, min(passive_limit_of(*loop, stable), stable) if stable else 0.0


def largest_damping(bench: Bench) -> float:
    """About the virtual damping above which no stiffness is stable [N·s/m]."""
    low, high = 0.0, 2.0 * bench.plant.mass / bench.period
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        environment_of = partial(wall, damping=middle, period=bench.period)
        limit = stiffness_limit(bench.plant, bench.period, bench.delay, environment_of)
        low, high = (middle, high) if limit > 0.0 else (low, middle)
    return high


def grew(bench: Bench, stiffness: Array, damping: Array, periods: int) -> NDArray[np.bool_]:
    """Let loops run side by side from a flick of 1 m/s; stiffness and damping of the same shape."""
    plant = bench.plant
    flicked = loops(
        mass=plant.mass, damping=plant.damping, period=bench.period, delay=bench.delay, lag=plant.torque_lag,
        stiffness=stiffness.ravel(), virtual_damping=damping.ravel(), velocity=1.0,
    )  # fmt: skip
    finished = batch.run(flicked, periods, parts=4)
    found: NDArray[np.bool_] = finished.diverged | (finished.peaks[3] > finished.peaks[1])
    return found.reshape(stiffness.shape)


def region(title: str, bench: Bench, points: int, periods: int, damping: float | None = None) -> Region:
    """A grid of points × points over all that can be stable and a tenth more, or up to a damping [N·s/m]."""
    dampings = np.linspace(0.0, 1.1 * largest_damping(bench) if damping is None else damping, points)
    limits = np.array([predicted(bench, value) for value in dampings.tolist()])
    stiffnesses = (np.arange(points) + 0.5) / points * 1.1 * float(limits[:, 0].max())
    mesh = np.meshgrid(stiffnesses, dampings)
    return Region(title, stiffnesses, dampings, grew(bench, mesh[0], mesh[1], periods), limits[:, 0], limits[:, 1])

"""K–B region of a wall: predicted by eigenvalues and by passivity, measured by simulating many loops at once.

In the measurement, a handle that is flicked swings against a bilateral wall. In each period its position is sampled,
differentiated by backward difference, and the force acts after the delay until the next one. A loop is unstable when
its largest excursion in the last quarter of the run exceeds that in the second quarter. Close to a boundary, motions
neither grow nor fade within a run, so that the measurement is undecided there.
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
    """Measured grid of one bench, and the predicted limits along the damping."""

    title: str
    stiffness: Array
    """Stiffnesses of the grid [N/m], `(n,)`."""
    damping: Array
    """Dampings of the grid [N·s/m], `(m,)`."""
    grew: NDArray[np.bool_]
    """Mask of the loops that grew, measured, `(m, n)`."""
    stable_limit: Array
    """Predicted limit of stability for each damping [N/m], `(m,)`."""
    passive_limit: Array
    """Predicted limit of passivity for each damping [N/m], `(m,)`."""

    @property
    def agreement(self) -> float:
        """Share of grid points measured as predicted, among those further than 1 % from the predicted boundary."""
        predicted = self.stiffness[None, :] > self.stable_limit[:, None]
        apart = np.abs(self.stiffness[None, :] - self.stable_limit[:, None]) > 0.01 * self.stable_limit.max()
        return float((predicted == self.grew)[apart].mean())


def wall(stiffness: float, damping: float, period: float, estimator: str = DEFAULT_ESTIMATOR) -> StateSpace:
    """Return a wall with its estimator as the discrete environment of the loop."""
    return environment(gain([[-stiffness, -damping]]), period=period, method=None, estimator=estimator)


def predicted(bench: Bench, damping: float) -> tuple[float, float]:
    """Return the limits of stability and of passivity with that damping [N/m]."""
    loop = bench.plant, bench.period, bench.delay, partial(wall, damping=damping, period=bench.period)
    stable = stiffness_limit(*loop)
    return stable, min(passive_limit_of(*loop, stable), stable) if stable else 0.0


def largest_damping(bench: Bench) -> float:
    """Return the virtual damping above which no stiffness is stable [N·s/m], within 1 %."""
    low, high = 0.0, 2.0 * bench.plant.mass / bench.period
    while high - low > 0.01 * high:
        middle = 0.5 * (low + high)
        environment_of = partial(wall, damping=middle, period=bench.period)
        limit = stiffness_limit(bench.plant, bench.period, bench.delay, environment_of)
        low, high = (middle, high) if limit > 0.0 else (low, middle)
    return high


def grew(bench: Bench, stiffness: Array, damping: Array, periods: int) -> NDArray[np.bool_]:
    """Simulate loops side by side after a flick of 1 m/s, and return a mask of those that grew.

    `stiffness` [N/m], `damping` [N·s/m] and the mask have the same shape.
    """
    plant = bench.plant
    flicked = loops(
        mass=plant.mass, damping=plant.damping, period=bench.period, delay=bench.delay, lag=plant.torque_lag,
        stiffness=stiffness.ravel(), virtual_damping=damping.ravel(), velocity=1.0,
    )  # fmt: skip
    finished = batch.run(flicked, periods, parts=4)
    # Of the four quarters, the first is left out: it has the flick itself.
    found: NDArray[np.bool_] = finished.diverged | (finished.peaks[3] > finished.peaks[1])
    return found.reshape(stiffness.shape)


def region(title: str, bench: Bench, points: int, periods: int, damping: float | None = None) -> Region:
    """Return a grid of points × points up to a damping [N·s/m]; for None, over the stable region and a tenth more."""
    dampings = np.linspace(0.0, 1.1 * largest_damping(bench) if damping is None else damping, points)
    limits = np.array([predicted(bench, value) for value in dampings.tolist()])
    stiffnesses = (np.arange(points) + 0.5) / points * 1.1 * float(limits[:, 0].max())
    mesh = np.meshgrid(stiffnesses, dampings)
    return Region(title, stiffnesses, dampings, grew(bench, mesh[0], mesh[1], periods), limits[:, 0], limits[:, 1])

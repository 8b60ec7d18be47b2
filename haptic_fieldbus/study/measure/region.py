"""K–B region of a wall: predicted by eigenvalues and by passivity, measured by simulating many loops at once.

In the measurement, a handle that is flicked swings against a bilateral wall. In each period its position is sampled and
differentiated by backward difference. The force acts after the delay, until the next force. A loop is unstable when its
largest excursion in the last quarter of the run exceeds that in the second quarter. Close to a boundary, motions
neither grow nor fade within a run, so the measurement is undecided there.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.margins import passive_limit_of, stiffness_limit
from haptic_fieldbus.numerics import batch
from haptic_fieldbus.numerics.batch import Array, loops, run
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.sampled import environment
from haptic_fieldbus.study.measure.bench import DEFAULT_ESTIMATOR, Bench
from haptic_fieldbus.study.oracles.contact import bisected

# Plane of damping β = b/(K·T) and friction σ = fc/(K·D), measured by simulating walls, for motions of one size.
#
# Diolaiti et al. (IEEE Trans. Robotics 22(2), 2006, 256, doi:10.1109/TRO.2005.862487) divide the plane at β = ½ and σ =
# ½. Their quadrants hold for motions of any size. A motion of amplitude A grows only where sampling adds more energy in
# a swing than damping and friction remove; by describing functions, K·T/2 − b > 4·fc/(π·ω·A). That is below the line
#
#     σ = π/4·(A/D)·ωT·(½ − β),   ω = √(K/m).
#
# Above the line, the handle comes to rest when σ > ½; when σ < ½ it moves over the edge of a count for ever.

PERIOD, STIFFNESS, COUNT = 1e-3, 600.0, 1e-5
"""Period [s], stiffness [N/m] and encoder count [m]; in the plane's own units only `HEAVINESS` matters."""
HEAVINESS = 20.0
"""m/(K·T²), so that ωT = 0.22."""
LARGEST = 1.2
"""Upper end of both axes of the plane, β and σ."""
GROWN = 1.2
"""Ratio of final to initial amplitude above which a motion counts as growing."""


class Ending(IntEnum):
    """End of the motion of a handle that was pressed against the wall and pulled away."""

    RESTS = 0
    CYCLES = 1
    GROWS = 2


@dataclass(frozen=True, eq=False)
class Plane:
    """Measured endings of motions that begin `start` counts away from rest."""

    start: float
    axis: Array
    """Values of β and of σ, `(n,)`."""
    outcome: NDArray[np.int64]
    """Measured `Ending`, `(n, n)`; a row is one σ."""

    @property
    def border(self) -> Array:
        """Predicted σ below which a motion grows, for each β, `(n,)`."""
        return border(self.start, self.axis)

    @property
    def agreement(self) -> float:
        """Share of points that end as predicted; points within 5 % of the plane of a predicted border are left out."""
        sigma, steepness = self.axis[:, None], -_slope(self.start)
        # Distance from the slanted border, at a right angle to it.
        above = (sigma - self.border[None, :]) / math.hypot(1.0, steepness)
        predicted = np.where(above < 0.0, Ending.GROWS, np.where(sigma < 0.5, Ending.CYCLES, Ending.RESTS))
        strip = 0.05 * LARGEST
        # The border σ = ½ exists only above the slanted one.
        apart = (np.abs(above) > strip) & ((np.abs(sigma - 0.5) > strip) | (above < 0.0))
        return float((predicted == self.outcome)[apart].mean())


def border(start: float, beta: Array) -> Array:
    """Return the σ below which a motion of `start` counts grows, for each β, `(n,)`; 0 if it grows for no σ."""
    return np.maximum(0.0, _slope(start) * (0.5 - beta))


def _slope(start: float) -> float:
    """Return π/4·(A/D)·ωT, the steepness of the border."""
    return 0.25 * math.pi * start / math.sqrt(HEAVINESS)


def plane(start: float, points: int, periods: int) -> Plane:
    """Measure a grid of points × points up to `LARGEST`; each handle is pressed to the edge between two counts."""
    axis = (np.arange(points) + 0.5) / points * LARGEST
    beta, sigma = (each.ravel() for each in np.meshgrid(axis, axis))
    # The push is in balance with the wall at 1.5 counts, where a rounded position switches from 1 to 2.
    pressed = loops(
        mass=HEAVINESS * STIFFNESS * PERIOD**2, damping=beta * STIFFNESS * PERIOD, coulomb=sigma * STIFFNESS * COUNT,
        period=PERIOD, stiffness=STIFFNESS, resolution=COUNT, push=1.5 * STIFFNESS * COUNT,
        position=(1.5 + start) * COUNT,
    )  # fmt: skip
    ended = run(pressed, periods, parts=8)
    grown = ended.diverged | (ended.peaks[-1] / COUNT - 1.5 > GROWN * start)
    outcome = np.where(grown, Ending.GROWS, np.where(ended.velocity == 0.0, Ending.RESTS, Ending.CYCLES))
    return Plane(start, axis, outcome.reshape(points, points).astype(np.int64))


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
        """Share of grid points measured as predicted; points within 1 % of the predicted boundary are left out."""
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

    def is_stable(damping: float) -> bool:
        environment_of = partial(wall, damping=damping, period=bench.period)
        return stiffness_limit(bench.plant, bench.period, bench.delay, environment_of) > 0.0

    return bisected(is_stable, 0.0, 2.0 * bench.plant.mass / bench.period, 0.01)[1]


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
    """Return a grid of points × points up to a damping [N·s/m]; None: over the stable region and a tenth more."""
    dampings = np.linspace(0.0, 1.1 * largest_damping(bench) if damping is None else damping, points)
    limits = np.array([predicted(bench, value) for value in dampings.tolist()])
    stiffnesses = (np.arange(points) + 0.5) / points * 1.1 * float(limits[:, 0].max())
    mesh = np.meshgrid(stiffnesses, dampings)
    return Region(title, stiffnesses, dampings, grew(bench, mesh[0], mesh[1], periods), limits[:, 0], limits[:, 1])

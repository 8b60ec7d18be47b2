"""Plane of damping β = b/(K·T) and friction σ = fc/(K·D), measured by simulating walls, for motions of one size.

Diolaiti et al. (IEEE Trans. Robotics 22(2), 2006, 256, doi:10.1109/TRO.2005.862487) divide the plane at β = ½ and
σ = ½. Their quadrants hold for motions of any size. A motion of amplitude A grows only where sampling adds more energy
in a swing than damping and friction remove; by describing functions, K·T/2 − b > 4·fc/(π·ω·A). That is below the line

    σ = π/4·(A/D)·ωT·(½ − β),   ω = √(K/m).

Above the line, the handle comes to rest when σ > ½; when σ < ½ it moves over the edge of a count for ever.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics.batch import run
from haptic_fieldbus.numerics.loops import Array, loops

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
        """Share of points that end as predicted, among those further than 5 % of the plane from a predicted border."""
        sigma, steepness = self.axis[:, None], -_slope(self.start)
        # Distance from the slanted border, at a right angle to it.
        above = (sigma - self.border[None, :]) / math.hypot(1.0, steepness)
        predicted = np.where(above < 0.0, Ending.GROWS, np.where(sigma < 0.5, Ending.CYCLES, Ending.RESTS))
        strip = 0.05 * LARGEST
        # The border σ = ½ exists only above the slanted one.
        apart = (np.abs(above) > strip) & ((np.abs(sigma - 0.5) > strip) | (above < 0.0))
        return float((predicted == self.outcome)[apart].mean())


def border(start: float, beta: Array) -> Array:
    """Return the σ below which a motion of `start` counts grows, for each β, `(n,)`; 0 when it grows with no σ."""
    return np.maximum(0.0, _slope(start) * (0.5 - beta))


def _slope(start: float) -> float:
    """Return π/4·(A/D)·ωT, the steepness of the border."""
    return 0.25 * math.pi * start / math.sqrt(HEAVINESS)


def plane(start: float, points: int, periods: int) -> Plane:
    """Measure a grid of points × points up to `LARGEST`; each handle is pressed to the edge between two counts."""
    axis = (np.arange(points) + 0.5) / points * LARGEST
    beta, sigma = (each.ravel() for each in np.meshgrid(axis, axis))
    pressed = loops(
        mass=HEAVINESS * STIFFNESS * PERIOD**2,
        damping=beta * STIFFNESS * PERIOD,
        coulomb=sigma * STIFFNESS * COUNT,
        period=PERIOD,
        stiffness=STIFFNESS,
        resolution=COUNT,
        # The push is in balance with the wall at 1.5 counts, where a rounded position switches from 1 to 2.
        push=1.5 * STIFFNESS * COUNT,
        position=(1.5 + start) * COUNT,
    )
    ended = run(pressed, periods, parts=8)
    grown = ended.diverged | (ended.peaks[-1] / COUNT - 1.5 > GROWN * start)
    outcome = np.where(grown, Ending.GROWS, np.where(ended.velocity == 0.0, Ending.RESTS, Ending.CYCLES))
    return Plane(start, axis, outcome.reshape(points, points).astype(np.int64))

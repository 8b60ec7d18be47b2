"""The plane of damping β = b/(K·T) and friction σ = fc/(K·D), measured by letting walls run, for one size of motion.

Diolaiti et al. (IEEE Trans. Robotics 22(2), 2006, 256, doi:10.1109/TRO.2005.862487) divide the plane at β = ½ and
σ = ½. These quadrants are for motions of any size. A motion of one size A grows only where sampling gives more in a
swing than damping and friction take, by describing functions K·T/2 − b > 4·fc/(π·ω·A), that is below the line

    σ = π/4·(A/D)·ωT·(½ − β),   ω = √(K/m).

Above it and above σ = ½ the handle comes to rest, above it and below σ = ½ it moves over the edge of a count for ever.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics.batch import run
from haptic_fieldbus.numerics.loops import Array, loops

PERIOD, STIFFNESS, COUNT = 1e-3, 600.0, 1e-5
"""[s, N/m, m]; only the mass matters in the plane."""
HEAVINESS = 20.0
"""m/(K·T²); ωT = 0.22."""
LARGEST = 1.2
"""Of β and σ."""
GROWN = 1.2
"""Times its start, at the end of a run: grows."""


class Ending(IntEnum):
    """What became of a handle that was pressed against the wall and pulled away."""

    RESTS = 0
    CYCLES = 1
    GROWS = 2


@dataclass(frozen=True, eq=False)
class Plane:
    """For motions that begin with `start` counts."""

    start: float
    axis: Array
    """Of β and of σ, (n,)."""
    outcome: NDArray[np.int64]
    """Measured `Outcome`, (n, n): rows of one σ."""

    @property
    def border(self) -> Array:
        """Predicted: the σ below which it grows, (n,)."""
        return border(self.start, self.axis)

    @property
    def agreement(self) -> float:
        """Share of the points, further than 5 % of the plane from a predicted border, that are as predicted."""
        sigma, steepness = self.axis[:, None], -_slope(self.start)
        above = (sigma - self.border[None, :]) / math.hypot(1.0, steepness)
        predicted = np.where(above < 0.0, Ending.GROWS, np.where(sigma < 0.5, Ending.CYCLES, Ending.RESTS))
        strip = 0.05 * LARGEST
        apart = (np.abs(above) > strip) & ((np.abs(sigma - 0.5) > strip) | (above < 0.0))
        return float((predicted == self.outcome)[apart].mean())


def border(start: float, beta: Array) -> Array:
    """The σ below which a motion of so many counts grows; 0 where none does."""
    return np.maximum(0.0, _slope(start) * (0.5 - beta))


def _slope(start: float) -> float:
    return 0.25 * math.pi * start / math.sqrt(HEAVINESS)


def plane(start: float, points: int, periods: int) -> Plane:
    """A grid of points × points up to `LARGEST`; each handle is pressed to the edge between two counts."""
    axis = (np.arange(points) + 0.5) / points * LARGEST
    beta, sigma = (each.ravel() for each in np.meshgrid(axis, axis))
    pressed = loops(
        mass=HEAVINESS * STIFFNESS * PERIOD**2,
        damping=beta * STIFFNESS * PERIOD,
        coulomb=sigma * STIFFNESS * COUNT,
        period=PERIOD,
        stiffness=STIFFNESS,
        resolution=COUNT,
        push=1.5 * STIFFNESS * COUNT,
        position=(1.5 + start) * COUNT,
    )
    ended = run(pressed, periods, parts=8)
    grown = ended.diverged | (ended.peaks[-1] / COUNT - 1.5 > GROWN * start)
    outcome = np.where(grown, Ending.GROWS, np.where(ended.velocity == 0.0, Ending.RESTS, Ending.CYCLES))
    return Plane(start, axis, outcome.reshape(points, points).astype(np.int64))

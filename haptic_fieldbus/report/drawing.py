"""What all pictures share: colours, units, and the thinning of long lines.

Lines of many points are thinned to the least and the greatest value of each bin, so that no spike is lost. Colours are
from the palette of Okabe and Ito, made to be told apart with any colour vision (https://jfly.uni-koeln.de/color/).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.result import Array
from haptic_fieldbus.planning.limits import FELT_SHARE
from haptic_fieldbus.signals import Workspace

BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
GREY, INK = "#8a8a8a", "#222222"

FELT = FELT_SHARE
BINS = 900
"""Bins to which a line is thinned; about as many as the picture has columns of pixels for a panel."""


@dataclass(frozen=True)
class AxisUnits:
    """Units in which a picture shows the quantities of a workspace; `per_length` converts from m or rad to `length`."""

    length: str
    per_length: float
    effort: str
    effort_name: str


UNITS = {
    Workspace.LINEAR: AxisUnits("mm", 1e3, "N", "force"),
    Workspace.ROTARY: AxisUnits("°", 180 / np.pi, "N·m", "torque"),
}


def held(times: Array, values: Array, end: float) -> tuple[Array, Array]:
    """Return times and values of a staircase, each `(2 n,)`: a value is held until the next time, the last until `end`.

    `times` [s] and `values` have the shape `(n,)`.
    """
    # Every time except the first and the last is a corner twice: end of one step, begin of the next.
    corners = np.repeat(np.append(times, end), 2)[1:-1]
    return corners, np.repeat(values, 2)


def kept(values: Array, bins: int = BINS) -> NDArray[np.intp]:
    """Return the numbers of the least and the greatest value of each bin, and both ends, in their order.

    A line with fewer than four points a bin is kept as it is.
    """
    size = len(values) // bins
    if size < 4:
        return np.arange(len(values))
    # `size` is rounded down, so the last points may fill no bin; they are all kept.
    whole = len(values) // size * size
    blocks = values[:whole].reshape(-1, size)
    starts = np.arange(0, whole, size)
    rest = np.arange(whole, len(values))
    ends = [0, len(values) - 1]
    return np.unique(np.concatenate([starts + blocks.argmin(axis=1), starts + blocks.argmax(axis=1), rest, ends]))


def thin(times: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """Return times and values of the points that are `kept`, both of the shape `(n,)` before."""
    shown = kept(values, bins)
    return times[shown], values[shown]

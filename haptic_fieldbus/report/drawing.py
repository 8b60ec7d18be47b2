"""Parts that all pictures share: colours, units, and the thinning of long lines.

Lines of many points are thinned to the least and the greatest value of each bin, so that no spike is lost. Colours are
from the palette of Okabe and Ito, made to be told apart with any colour vision (https://jfly.uni-koeln.de/color/).
"""

from dataclasses import dataclass
from typing import Any

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


# Looks of curves: colours of Okabe and Ito and a marker, the same for a method or estimator in every figure.


@dataclass(frozen=True)
class CurveStyle:
    """Colour, marker and dashes of a curve; `size` is that of the marker [points]."""

    colour: str
    marker: str
    dashes: str = "-"
    size: float = 5.5
    hollow: bool = False


# Several methods give nearly the same curve: large hollow markers leave the smaller ones inside them visible.
LOOKS = {
    "forward-euler": CurveStyle(VERMILION, "o"),
    "backward-euler": CurveStyle(ORANGE, "s"),
    "trapezoidal": CurveStyle(PURPLE, "D", size=5.0),
    "semi-implicit": CurveStyle(SKY, "^", size=9.0, hollow=True),
    "semi-implicit-drift-first": CurveStyle(SKY, "v", "--"),
    "verlet": CurveStyle(BLUE, "<", size=5.0),
    "rk4": CurveStyle(GREEN, "P", size=9.0, hollow=True),
    "exact-zoh": CurveStyle(GREY, "X", "--", size=6.0),
    "exact-foh": CurveStyle(INK, "*", size=6.5),
    "backward-difference": CurveStyle(INK, "o", size=8.0, hollow=True),
    "moving-average": CurveStyle(BLUE, "s"),
    "low-pass": CurveStyle(SKY, "D", size=5.0),
    "filtered-derivative": CurveStyle(ORANGE, "v"),
    "least-squares": CurveStyle(GREEN, "^"),
    "foaw-end-fit": CurveStyle(VERMILION, "P", "--"),
    "foaw-best-fit": CurveStyle(VERMILION, "X"),
    "levant": CurveStyle(PURPLE, "*", "--", size=6.0),
    "kalman-velocity": CurveStyle(BLUE, ">", "--"),
    "kalman-acceleration": CurveStyle(GREEN, "<", "--"),
    "tick-interval": CurveStyle(GREY, "h", ":"),
}
OTHERS = (
    CurveStyle(BLUE, "o", ":"),
    CurveStyle(VERMILION, "s", ":"),
    CurveStyle(GREEN, "^", ":"),
    CurveStyle(PURPLE, "D", ":"),
    CurveStyle(ORANGE, "v", ":"),
    CurveStyle(SKY, "P", ":"),
)


def look_of(name: str) -> CurveStyle:
    """Return the look of a method; for an unknown name, one that depends on its letters alone."""
    # Not `hash`, which differs from run to run.
    return LOOKS.get(name) or OTHERS[sum(map(ord, name)) % len(OTHERS)]


def line(name: str, label: str | None = None, marked: bool = True) -> dict[str, Any]:
    """Return the arguments of `plot` for the curve of a method."""
    look = look_of(name)
    marker: dict[str, Any] = {"marker": look.marker, "markersize": look.size} if marked else {}
    if look.hollow and marked:
        marker |= {"markerfacecolor": "none", "markeredgewidth": 1.2}
    width = 1.3 if marked else 1.8
    return {"color": look.colour, "linestyle": look.dashes, "linewidth": width, "label": label or name, **marker}

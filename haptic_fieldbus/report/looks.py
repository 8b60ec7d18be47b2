"""Looks of curves: colours of Okabe and Ito and a marker, the same for a method or estimator in every figure."""

from dataclasses import dataclass
from typing import Any

from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION


@dataclass(frozen=True)
class Look:
    """Colour, marker and dashes of a curve; `size` is that of the marker [points]."""

    colour: str
    marker: str
    dashes: str = "-"
    size: float = 5.5
    hollow: bool = False


# Several methods give nearly the same curve: large hollow markers leave the smaller ones inside them visible.
LOOKS = {
    "forward-euler": Look(VERMILION, "o"),
    "backward-euler": Look(ORANGE, "s"),
    "trapezoidal": Look(PURPLE, "D", size=5.0),
    "semi-implicit": Look(SKY, "^", size=9.0, hollow=True),
    "semi-implicit-drift-first": Look(SKY, "v", "--"),
    "verlet": Look(BLUE, "<", size=5.0),
    "rk4": Look(GREEN, "P", size=9.0, hollow=True),
    "exact-zoh": Look(GREY, "X", "--", size=6.0),
    "exact-foh": Look(INK, "*", size=6.5),
    "backward-difference": Look(INK, "o", size=8.0, hollow=True),
    "moving-average": Look(BLUE, "s"),
    "low-pass": Look(SKY, "D", size=5.0),
    "filtered-derivative": Look(ORANGE, "v"),
    "least-squares": Look(GREEN, "^"),
    "foaw-end-fit": Look(VERMILION, "P", "--"),
    "foaw-best-fit": Look(VERMILION, "X"),
    "levant": Look(PURPLE, "*", "--", size=6.0),
    "kalman-velocity": Look(BLUE, ">", "--"),
    "kalman-acceleration": Look(GREEN, "<", "--"),
    "tick-interval": Look(GREY, "h", ":"),
}
OTHERS = (Look(BLUE, "o"), Look(VERMILION, "s"), Look(GREEN, "^"), Look(PURPLE, "D"), Look(ORANGE, "v"), Look(SKY, "P"))


def look_of(name: str) -> Look:
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

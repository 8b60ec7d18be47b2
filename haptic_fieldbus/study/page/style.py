"""Style of the figures: colours of Okabe and Ito and a marker for each curve, the same for a method in every figure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any, TypeVar

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION

Item = TypeVar("Item")
WIDTH = 11.4
"""Width of a figure that fits a page of 1180 px [inches]."""


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


def legend(drawn: Figure, labels: Mapping[str, str], marked: bool = True, **words: Any) -> None:
    """Put a legend below the figure; `labels` maps methods to their texts, `words` are passed on to matplotlib."""
    handles = [Line2D([], [], **line(name, label, marked)) for name, label in labels.items()]
    drawn.legend(handles=handles, loc="outside lower center", frameon=False, fontsize=9, **words)


def side_by_side(items: Sequence[Item], draw: Callable[[Axes, Item], None], height: float, ncols: int) -> Figure:
    """Return a figure with a panel for each item and one legend below, made from the first panel."""
    drawn = figure(height)
    for panel, each in zip(drawn.subplots(1, len(items), squeeze=False)[0], items, strict=True):
        draw(panel, each)
    handles, labels = drawn.axes[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=ncols, frameon=False)
    return drawn


def figure(height: float, width: float = WIDTH) -> Figure:
    """Return an empty figure of this size [inches]."""
    return Figure(figsize=(width, height), facecolor="white", layout="constrained")


def dress(panel: Axes, title: str, x: str, y: str) -> None:
    """Give a panel a title, labels of its axes, and a light grid."""
    panel.set_title(title, loc="left", size=10.5, color=INK)
    panel.set_xlabel(x)
    panel.set_ylabel(y)
    panel.grid(visible=True, which="major", color="#e4e4e4", linewidth=0.8)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)


def svg(drawn: Figure) -> str:
    """Return a figure as an SVG document; letters are outlines, so that no font is needed to show it."""
    buffer = BytesIO()
    # A fixed salt, and no date: the same figure gives the same text, so that reports can be compared.
    with rc_context({"svg.hashsalt": "haptic-fieldbus", "svg.fonttype": "path"}):
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue().decode("utf-8")

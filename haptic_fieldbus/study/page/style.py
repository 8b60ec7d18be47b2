"""Style of the figures of the report; the colours and markers of methods are those of `report.looks`."""

from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from typing import Any, TypeVar

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter

from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.report.drawing import INK
from haptic_fieldbus.report.looks import LOOKS, line, look_of

__all__ = ["CARD", "LOOKS", "WIDE_CARD", "WIDTH", "dress", "figure", "legend", "line", "look_of", "side_by_side", "svg"]

Item = TypeVar("Item")
WIDE_CARD, CARD = (2.5, 6.73), (2.5, 5.6)
"""Height and width of figures on the first screen of the page, left and right [inches]."""
WIDTH = 11.4
"""Width of a figure that fits a page of 1180 px [inches]."""


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
    for axis in (panel.xaxis, panel.yaxis):
        # As numbers stand in texts; powers as formulas would take most of the time of drawing.
        if axis.get_scale() in ("log", "symlog"):
            axis.set_major_formatter(lambda value, place: rounded(value))
            axis.set_minor_formatter(NullFormatter())


def card_panel(panel: Axes, title: str, x: str, y: str) -> None:
    """Dress a panel of a figure on the first screen, in small letters."""
    dress(panel, "", x, y)
    panel.set_title(title, loc="left", size=8.5, color=INK)
    for label in (panel.xaxis.label, panel.yaxis.label):
        label.set_fontsize(8)
    panel.tick_params(labelsize=7.5)


def note(panel: Axes, height: float, text: str, right: bool = True) -> None:
    """Write a small note just above a height of the vertical axis, at the right or left side, readable over curves."""
    place, side = (0.992, "right") if right else (0.008, "left")
    panel.annotate(text, (place, height), xycoords=panel.get_yaxis_transform(), xytext=(0, 2), va="bottom", ha=side,
                   textcoords="offset points", size=7, color="#555555",
                   bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6})  # fmt: skip


def svg(drawn: Figure) -> str:
    """Return a figure as an SVG document; letters are outlines, so that no font is needed to show it."""
    buffer = BytesIO()
    # A fixed salt, and no date: the same figure gives the same text, so that reports can be compared.
    with rc_context({"svg.hashsalt": "haptic-fieldbus", "svg.fonttype": "path"}):
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue().decode("utf-8")

"""Part of the region section on friction and encoder: the endings of motions of one size."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from haptic_fieldbus.numerals import exactly, percent
from haptic_fieldbus.report.drawing import INK
from haptic_fieldbus.study.measure.friction_plane import LARGEST, Ending, Plane, border
from haptic_fieldbus.study.page.html import paragraph, picture
from haptic_fieldbus.study.page.style import dress, side_by_side, svg

STARTS = (5.0, 20.0, 100.0)
"""Distances from rest at which motions begin, one for each panel [encoder counts]."""
COLOURS = {
    Ending.RESTS: ("#d3ebe0", "comes to rest"),
    Ending.CYCLES: ("#e7e1ee", "moves over the edge of a count for ever"),
    Ending.GROWS: ("#f8dcc4", "grows"),
}
EXPLAINED = """<b>Friction and encoder.</b> Over β = b/(K·T) and σ = fc/(K·D), D one encoder count, the regions of
Diolaiti et al. are the quadrants at ½: passive, locally stable (small motions stick, large ones grow), limit cycle and
unstable. They are for motions of any size. Here handles are pressed against a wall and let go a given number of counts
away, friction and rounding exact. A motion of size A grows only where sampling gives more in a swing than friction
takes, K·T/2 − b &gt; 4·fc/(π·ω·A): the larger it is, the nearer its border is to β = ½."""


def part(planes: Sequence[Plane]) -> tuple[str, str]:
    """Return the part as HTML, and the SVG document of its figure."""
    document = svg(side_by_side(planes, _panel, 4.2, ncols=5))
    share = min(plane.agreement for plane in planes)
    told = "all handles" if share == 1.0 else f"{percent(share, 3)} of the handles"
    caption = (
        f"{len(planes[0].axis)}² handles in each panel. Colours: measured. Dashed: the quadrants. Solid: predicted by "
        f"describing functions for motions of that size; {told} more than 5 % of the plane away from it end so."
    )
    return paragraph(EXPLAINED) + picture("friction-plane", document, caption), document


def _panel(panel: Axes, plane: Plane) -> None:
    """Draw the measured endings, the predicted border and the quadrants."""
    colours = ListedColormap([COLOURS[outcome][0] for outcome in Ending])
    panel.pcolormesh(plane.axis, plane.axis, plane.outcome, cmap=colours, vmin=-0.5, vmax=2.5, shading="nearest",
                     rasterized=True)  # fmt: skip
    for colour, label in COLOURS.values():  # empty areas, for the legend
        panel.fill_between([], [], color=colour, label=label)
    beta = np.linspace(0.0, 0.5, 50)
    panel.plot(beta, border(plane.start, beta), color="#0072B2", linewidth=2.0, label="predicted: grows below")
    panel.axvline(0.5, color=INK, linewidth=1.0, linestyle="--", label="quadrants")
    panel.axhline(0.5, color=INK, linewidth=1.0, linestyle="--")
    panel.set_xlim(0.0, LARGEST)
    panel.set_ylim(0.0, LARGEST)
    dress(panel, f"let go {exactly(plane.start)} counts away", "β = b/(K·T)", "σ = fc/(K·D)")
    panel.grid(visible=False)

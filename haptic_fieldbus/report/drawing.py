"""Style that all pictures share: colours, units, titles, names beside the lines, thinned lines, and files.

Lines of many points are thinned to the least and the greatest value of each bin, so that no spike is lost. Colours are
from the palette of Okabe and Ito, which can be distinguished with any colour vision (https://jfly.uni-koeln.de/color/).

Areas, and up to `NAMED` lines of a panel, have their names beside them instead of a legend. Many places along its line,
or inside its area, are tried for a name. The chosen place lies inside the panel, hides no other text, and covers the
fewest points of other lines. If a name has no such place, its panel gets a legend.

A PNG file contains its content as text (`content`), so that pictures drawn by older code can be found.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import pairwise
from pathlib import Path as FilePath
from textwrap import fill
from typing import Any, TypeVar

import numpy as np
from matplotlib import colors, patheffects, rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from haptic_fieldbus.assessing.result import Array
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.limits import FELT_SHARE
from haptic_fieldbus.signals import Workspace

BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
GREY, INK, NOTE = "#8a8a8a", "#222222", "#555555"
GRID, WALL, NOT_NOTICED, FAILS = "#e4e4e4", "#e9edf0", "#dcdcdc", "#fbeee6"
"""Light tints: grid, inside of a wall, errors that a hand does not notice, and where motions grow or methods fail."""

Item = TypeVar("Item")
WIDTH = 11.4
"""Width of a figure that fits a page of 1180 px [inches]."""
TITLE_SIZE, SUBTITLE_SIZE, PANEL_SIZE, NAME_SIZE = 14.5, 10.5, 10.5, 9.0
"""Sizes of letters [points]."""
DPI = 110

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
    None: AxisUnits("m or rad", 1.0, "N or N·m", "force"),
    Workspace.LINEAR: AxisUnits("mm", 1e3, "N", "force"),
    Workspace.ROTARY: AxisUnits("°", 180 / np.pi, "N·m", "torque"),
}


def held(times: Array, values: Array, end: float) -> tuple[Array, Array]:
    """Return times and values of a staircase, each `(2 n,)`: each value is held until the next time.

    The last value is held until `end`. `times` [s] and `values` have the shape `(n,)`.
    """
    # Every time except the first and the last is a corner twice: end of one step, begin of the next.
    corners = np.repeat(np.append(times, end), 2)[1:-1]
    return corners, np.repeat(values, 2)


def kept(values: Array, bins: int = BINS) -> NDArray[np.intp]:
    """Return the indices of the least and the greatest value of each bin, and of both ends, in order.

    A line with fewer than four points per bin is kept unchanged.
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
    """Return times and values of the `kept` points; the arguments have the shape `(n,)`."""
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
OTHERS = [CurveStyle(*look, ":") for look in zip((BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY), "os^DvP", strict=True)]


def look_of(name: str) -> CurveStyle:
    """Return the style of a method; for an unknown name, a style that depends on its letters alone."""
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


# Figures, their titles and their panels.


def figure(height: float, width: float = WIDTH, title: str = "", subtitle: Sequence[str] = ()) -> Figure:
    """Return an empty figure of this size [inches], with a title and smaller lines below it."""
    drawn = Figure(figsize=(width, height), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(drawn)
    top = 0.1
    bold: dict[str, Any] = {"weight": "bold", "color": INK}
    # Letters are about so much of their size wide.
    for text, size, share, looks in ((title, TITLE_SIZE, 0.7, bold),
                                     ("\n".join(subtitle), SUBTITLE_SIZE, 0.57, {"color": NOTE})):  # fmt: skip
        lines = [fill(line, int((width - 0.4) * 72 / (share * size))) for line in text.splitlines()]
        if lines:
            drawn.text(0.2 / width, 1.0 - top / height, "\n".join(lines), size=size, va="top", **looks)
            top += 1.35 * size / 72 * "\n".join(lines).count("\n") + 1.5 * size / 72
    if title:
        drawn.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 1.0 - top / height))
    return drawn


def dress(panel: Axes, title: str = "", x: str = "", y: str = "") -> None:
    """Give a panel a title, labels of its axes with units, and a light grid."""
    panel.set_title(title, loc="left", size=PANEL_SIZE, color=INK)
    panel.set(xlabel=x, ylabel=y)
    panel.grid(visible=True, which="major", color=GRID, linewidth=0.8)
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


def note(panel: Axes, height: float, text: str, right: bool = True, size: float = 7.0) -> None:
    """Write a small note just above a height of the vertical axis, at the right or left side, readable over curves."""
    place, side = (0.992, "right") if right else (0.008, "left")
    panel.annotate(text, (place, height), xycoords=panel.get_yaxis_transform(), xytext=(0, 2), va="bottom", ha=side,
                   textcoords="offset points", size=size, color=NOTE,
                   bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6})  # fmt: skip


def legend(drawn: Figure, labels: Mapping[str, str], marked: bool = True, **words: Any) -> None:
    """Put a legend below the figure; `labels` maps methods to their texts, `words` are passed on to matplotlib."""
    handles = [Line2D([], [], **line(name, label, marked)) for name, label in labels.items()]
    drawn.legend(handles=handles, loc="outside lower center", frameon=False, fontsize=NAME_SIZE, **words)


def side_by_side(items: Sequence[Item], draw: Callable[[Axes, Item], None], height: float, ncols: int) -> Figure:
    """Return a figure with a panel for each item and one legend below, made from the first panel."""
    drawn = figure(height)
    for panel, each in zip(drawn.subplots(1, len(items), squeeze=False)[0], items, strict=True):
        draw(panel, each)
    handles, labels = drawn.axes[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=ncols, frameon=False)
    return drawn


# Names beside lines and areas.

NAMED = 6
"""Largest number of lines of a panel that have their names beside them instead of a legend."""
GAP = 4.0
"""Distance of a name from its line [pixels]."""
CELL = 3.0
"""Width of the cells of a panel in which points of lines are counted [pixels]."""
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))
"""Directions in which a name is tried beside a point of its line."""
HALO = (patheffects.withStroke(linewidth=2.5, foreground="white"),)


def name_lines(drawn: Figure, panels: Iterable[Axes] | None = None) -> None:
    """Write the names of all lines and areas with a label beside them, in all panels or in these.

    The layout is fixed before and does not change any more.
    """
    engine = drawn.get_layout_engine()
    if engine is not None:
        engine.execute(drawn)
        drawn.set_layout_engine("none")
    for panel in drawn.axes if panels is None else panels:
        handles, labels = panel.get_legend_handles_labels()
        lines = sum(isinstance(each, Line2D) for each in handles)
        if len(labels) > 0 and lines <= NAMED and not _name_all(panel, list(zip(handles, labels, strict=True))):
            panel.legend(fontsize=NAME_SIZE - 1.0, loc="best", framealpha=0.85, edgecolor="none")


def _name_all(panel: Axes, named: list[tuple[Artist, str]]) -> bool:
    """Write the names of a panel; returns False and writes none if a name has no place."""
    frame = panel.get_window_extent()
    areas = [handle for handle, _ in named if isinstance(handle, PolyCollection)]
    known = {each: _inside(_points(each), frame) for each in (*panel.lines, *areas)}
    taken = [text.get_window_extent() for text in panel.texts]
    written: list[Text] = []
    # Areas come last: they leave more places.
    for handle, label in sorted(named, key=lambda each: not isinstance(each[0], Line2D)):
        colour = _legible(handle)
        text = panel.text(0, 0, label, size=NAME_SIZE, color=colour, transform=None, path_effects=HALO, ha="center",
                          va="center", in_layout=False, zorder=9)  # fmt: skip
        size = text.get_window_extent()
        others = np.concatenate([np.zeros((0, 2)), *(points for each, points in known.items() if each is not handle)])
        own = known[handle] if isinstance(handle, Line2D) else None
        centre = _place(handle, own, others, (size.width, size.height), frame, taken)
        written.append(text)
        if centre is None:
            for each in written:
                each.remove()
            return False
        # In shares of the panel: the file may have another resolution.
        text.set_transform(panel.transAxes)
        text.set_position(tuple(panel.transAxes.inverted().transform(centre)))
        taken.append(text.get_window_extent())
    return True


def _place(
    handle: Artist, own: Array | None, others: Array, size: tuple[float, float], frame: Any, taken: Sequence[Any]
) -> Array | None:
    """Return the best centre of a name of this size [pixels]; None when it has none."""
    half = np.array(size) / 2.0
    if own is not None:
        centres = _beside(own, half)
        cost = np.zeros(len(centres))
        everything = np.concatenate([own, others])
    else:
        inside, edge = _within(handle, half, frame), _beside(_inside(_points(handle), frame), half)
        centres = np.concatenate([inside, edge])
        cost = np.repeat([0.0, 1.5], [len(inside), len(edge)])
        everything = others
    low, high = centres - half - 2.0, centres + half + 2.0
    fits = (low >= (frame.x0, frame.y0)).all(axis=1) & (high <= (frame.x1, frame.y1)).all(axis=1)
    for box in taken:
        fits &= (low[:, 0] > box.x1) | (high[:, 0] < box.x0) | (low[:, 1] > box.y1) | (high[:, 1] < box.y0)
    if not fits.any():
        return None
    # Among equals the middle of the panel: at its left edge the drives are still being enabled.
    middle = ((frame.x0 + 2.0 * frame.x1) / 3.0, (frame.y0 + frame.y1) / 2.0)
    cost += (np.abs(centres - middle) / (frame.width, frame.height)).sum(axis=1)
    centres, low, high, cost = centres[fits], low[fits], high[fits], cost[fits]
    cost += _counts(everything, low, high, frame) + 0.25 * _counts(others, low - 5.0, high + 5.0, frame)
    return np.asarray(centres[int(np.argmin(cost))])


def _counts(points: Array, low: Array, high: Array, frame: Any) -> Array:
    """Return how many cells of the panel inside each box have a point, `(n_boxes,)`."""
    origin, cells = np.array([frame.x0, frame.y0]), (int(frame.width / CELL) + 2, int(frame.height / CELL) + 2)
    at = ((points - origin) / CELL).astype(int)
    table = np.zeros((cells[0] + 1, cells[1] + 1))
    table[at[:, 0] + 1, at[:, 1] + 1] = 1.0
    # Sums from the corner (Crow, SIGGRAPH 1984): any box is the sum of four of them.
    table = table.cumsum(axis=0).cumsum(axis=1)
    (x0, y0), (x1, y1) = (np.clip((edge - origin) / CELL, 0, cells).astype(int).T for edge in (low, high + CELL))
    return np.asarray(table[x1, y1] - table[x0, y1] - table[x1, y0] + table[x0, y0])


def _beside(points: Array, half: Array) -> Array:
    """Return centres of a name on all sides of some points of a line, `(n, 2)`."""
    chosen = points[np.unique(np.linspace(0, max(len(points) - 1, 0), 60).astype(int))] if len(points) else points
    return np.concatenate([chosen + side * (half + GAP) for side in np.array(SIDES, float)])


def _within(area: Artist, half: Array, frame: Any) -> Array:
    """Return centres of a name inside an area, `(n, 2)`."""
    grid = np.stack(np.meshgrid(np.linspace(frame.x0, frame.x1, 25), np.linspace(frame.y0, frame.y1, 17)), -1)
    centres = grid.reshape(-1, 2)
    corners = half * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    found = np.ones(len(centres), bool)
    for corner in corners:
        found &= np.any([path.contains_points(centres + corner) for path in _paths(area)], axis=0)
    return centres[found]


def _paths(artist: Artist) -> list[Path]:
    """Return the outlines of a line or area [pixels]."""
    paths = artist.get_paths() if isinstance(artist, PolyCollection) else [artist.get_path()]  # type: ignore[attr-defined]
    return [artist.get_transform().transform_path(path) for path in paths]


def _points(artist: Artist) -> Array:
    """Return points along a line or an outline, at most 5 pixels apart, `(n, 2)`."""
    found = [np.zeros((0, 2))]
    for path in _paths(artist):
        vertices = np.asarray(path.vertices, float)
        # Far outside of the panel a line needs no points.
        corners = np.clip(vertices[np.isfinite(vertices).all(axis=1)], -1e4, 1e4)
        steps = (np.abs(np.diff(corners, axis=0)).max(axis=1) // 5.0).astype(int) + 1
        starts = np.repeat(np.cumsum(steps) - steps, steps)
        share = ((np.arange(steps.sum()) - starts) / np.repeat(steps, steps))[:, None]
        before, after = (np.repeat(ends, steps, axis=0) for ends in (corners[:-1], corners[1:]))
        found += [before * (1.0 - share) + after * share, corners[-1:]]
    return np.concatenate(found)


def _inside(points: Array, frame: Any) -> Array:
    """Return the points inside a panel, one of each cell, in their order."""
    shown = points[((points >= (frame.x0, frame.y0)) & (points <= (frame.x1, frame.y1))).all(axis=1)]
    cells = (shown // CELL).astype(int)
    _, first = np.unique(cells[:, 0] * 100_000 + cells[:, 1], return_index=True)
    return np.asarray(shown[np.sort(first)])


def _legible(handle: Artist) -> Any:
    """Return the colour of a line, darkened until it can be read on white; a dark grey for an area."""
    if not isinstance(handle, Line2D):
        return NOTE
    share = np.array(colors.to_rgb(handle.get_color()))
    # Contrast of 4.5 to 1 on white (WCAG 2.2, 1.4.3): relative luminance below 0.183.
    while _luminance(share) > 0.183:
        share = 0.95 * share
    return tuple(share)


def _luminance(share: Array) -> float:
    """Return the relative luminance of a colour in sRGB (IEC 61966-2-1)."""
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


# Envelope of a line that would be a smear.

TURNS, BANDS = 250, 160
"""Number of turns from which the envelope of a line is drawn instead, and number of points of the envelope."""
SWING = 0.1
"""Smallest reversal of a line that counts as a turn, as a share of its range."""


def is_smear(values: Array) -> bool:
    """Return whether a line turns so often that its strokes would merge."""
    shown = values[kept(values)]
    least = SWING * float(np.ptp(shown)) if len(shown) else 0.0
    turns, rising, extreme = 0, True, float(shown[0]) if len(shown) else 0.0
    for value in shown.tolist():
        if value > extreme if rising else value < extreme:
            extreme = value
        elif abs(value - extreme) > least:
            turns, rising, extreme = turns + 1, not rising, value
    return turns > TURNS


def envelope(times: Array, values: Array, bins: int = BANDS) -> tuple[Array, Array, Array]:
    """Return times, and the least and the greatest value around each, `(n,)` each."""
    edges = np.linspace(0, len(values), bins + 1).astype(int)
    low, high = (np.array([pick(values[a:b]) for a, b in pairwise(edges)]) for pick in (np.min, np.max))
    # A swing can be cut by the end of a bin, so each has its neighbours' values too.
    padded_low, padded_high = np.pad(low, 1, mode="edge"), np.pad(high, 1, mode="edge")
    low = np.minimum(np.minimum(padded_low[:-2], low), padded_low[2:])
    high = np.maximum(np.maximum(padded_high[:-2], high), padded_high[2:])
    return times[(edges[:-1] + edges[1:]) // 2], low, high


# Files.

CONTENT = "Content"
"""Key of the content text in a PNG file."""
BLOCKS = 12
"""Number of parts of a line; the text has the least and the greatest value of each."""
MEASURED = "measured"
"""Name (`gid`) of a panel with numbers that differ from machine to machine, which the text leaves out."""


def save(drawn: Figure, path: FilePath, description: str = "") -> None:
    """Write a figure into a file; the suffix selects the format; raises OSError when it cannot be written.

    The description stands in the field that the format has for one.
    """
    words = {"Software": "haptic-fieldbus", CONTENT: json.dumps(content(drawn))} if path.suffix == ".png" else {}
    if description:
        words["Subject" if path.suffix == ".pdf" else "Description"] = description
    whole = BytesIO()  # so that a file which cannot be written has one kind of error in all formats
    drawn.savefig(whole, format=path.suffix[1:], metadata=words)
    path.write_bytes(whole.getvalue())


def with_description(document: str, description: str) -> str:
    """Return the SVG document of `svg` with a description, in the field where `save` has it."""
    return document.replace("</cc:Work>", f"<dc:description>{description}</dc:description></cc:Work>", 1)


def content(drawn: Figure) -> dict[str, Any]:
    """Return the content of a figure: its texts, the range of each panel, and its lines and areas in a few numbers.

    Numbers at ticks are chosen by matplotlib, and are left out.
    """
    ticks = {label for panel in drawn.axes for axis in (panel.xaxis, panel.yaxis)
             for label in axis.get_ticklabels(which="both")}  # fmt: skip
    texts = [text.get_text() for text in drawn.findobj(Text) if text not in ticks]
    return {"texts": sorted(filter(None, texts)), "panels": [_panel_content(panel) for panel in drawn.axes]}


def _panel_content(panel: Axes) -> dict[str, Any]:
    """Return the range of a panel and its lines and areas; measured numbers are left out."""
    measured = panel.get_gid() == MEASURED
    rows = [[str(each.get_color()), str(each.get_linestyle()), float(each.get_linewidth()), str(each.get_marker()),
             [] if measured else _blocks(np.asarray(each.get_xydata(), float))] for each in panel.lines]  # fmt: skip
    areas = [_blocks(np.asarray(path.vertices, float)) for each in panel.collections for path in each.get_paths()]
    return {"scales": [panel.get_xscale(), panel.get_yscale()],
            "range": [] if measured else [float(f"{v:.6g}") for v in (*panel.get_xlim(), *panel.get_ylim())],
            "lines": rows, "areas": [] if measured else areas}  # fmt: skip


def _blocks(points: Array) -> list[list[float]]:
    """Return the least and the greatest x and y of each of `BLOCKS` parts of a line."""
    parts = [part for part in np.array_split(points, BLOCKS) if len(part)]
    ends = [(*part.min(axis=0), *part.max(axis=0)) for part in parts]
    return [[float(f"{value:.5g}") if np.isfinite(value) else 0.0 for value in each] for each in ends]


def svg(drawn: Figure) -> str:
    """Return a figure as an SVG document; letters are outlines, so that no font is needed to show it."""
    buffer = BytesIO()
    # A fixed salt, and no date: the same figure gives the same text, so that reports can be compared.
    with rc_context({"svg.hashsalt": "haptic-fieldbus", "svg.fonttype": "path"}):
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue().decode("utf-8")

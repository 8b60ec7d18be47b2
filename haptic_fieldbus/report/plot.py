"""Picture of a run: position and wall, force, and error, over the whole run and around the first force.

On real drives the error is not known; there the last panel shows how late the periods began and how old feedback was.

Lines of many points are thinned to the least and the greatest value of each bin, so that no spike is lost. Colours are
from the palette of Okabe and Ito, made to be told apart with any colour vision (https://jfly.uni-koeln.de/color/).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure

from haptic_fieldbus.assessing.period_times import PeriodTimes
from haptic_fieldbus.assessing.result import Array, Result, Trace
from haptic_fieldbus.numerals import percent
from haptic_fieldbus.report.words import key_figures
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace

BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
GREY, INK = "#8a8a8a", "#222222"

FELT = 0.08
"""Smallest change of a force that a hand can tell, as a share of the force.

Pang, Tan and Durlach measured 7 % from 2.5 to 10 N: Manual discrimination of force using active finger motion,
Perception & Psychophysics 49 (1991).
"""
BINS = 900
"""Bins to which a line is thinned; about as many as the picture has columns of pixels for a panel."""
ZOOM_BEFORE, ZOOM_AFTER = 12, 28
"""Periods shown before and after the first considerable force in the right-hand panels."""
COUNTS = 0.05
"""Share of the greatest force from which a force is considerable."""

SIZE = (13.5, 8.4)
DPI = 110


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


def plot_run(result: Result, path: Path) -> None:
    """Draw the traces of a run into a file, whose suffix tells the format.

    Raises OSError when the file cannot be written.
    """
    # Places of the texts are shares of the figure, which is `axes` times as high as for one axis.
    axes = max(1, len(result.traces))
    figure = Figure(figsize=(SIZE[0], SIZE[1] * axes), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    title = fill(result.verdict or result.scene, 105)
    below = 0.055 + 0.025 * title.count("\n")
    figure.text(0.02, 1.0 - 0.015 / axes, title, size=14.5, weight="bold", color=INK, va="top")
    figure.text(0.02, 1.0 - below / axes, key_figures(result), size=10.5, color="#555555", va="top")
    for part, trace in zip(figure.subfigures(len(result.traces), 1, squeeze=False)[:, 0], result.traces, strict=True):
        walls = [element for element in _elements(result, trace.axis) if isinstance(element, Wall)]
        name = f"{trace.axis}: " if axes > 1 else ""
        draw_axis(part, trace, walls, [change.time for change in result.changes], name, result.periods)
    figure.savefig(path)


def _elements(result: Result, axis: str) -> tuple[object, ...]:
    return result.plan.scene.of_axis(axis) if result.plan else ()


def draw_axis(
    figure: SubFigure | Figure,
    trace: Trace,
    walls: list[Wall],
    changes: Sequence[float] = (),
    name: str = "",
    periods: PeriodTimes | None = None,
) -> None:
    """Draw three panels over the whole run, and the same three around the first force when there is one.

    `changes` are the times [s] at which the scene was changed; `name` precedes the titles. The times of `periods` take
    the place of the error, if they are given.
    """
    window = first_force(trace)
    columns = 2 if window else 1
    panels = figure.subplots(
        3,
        columns,
        squeeze=False,
        sharex="col",
        gridspec_kw={"width_ratios": [1.9, 1.0][:columns], "height_ratios": [1.15, 1.0, 0.8]},
    )
    figure.subplots_adjust(left=0.065, right=0.985, top=0.87, bottom=0.07, hspace=0.2, wspace=0.18)
    units = UNITS[trace.workspace]
    _column(panels[:, 0], trace, walls, units, f"{name}the whole run", "time [s]", 1.0)
    _mark_fade_in(panels[:, 0], trace, units)
    _mark_changes(panels[:, 0], changes)
    if periods is not None:
        _draw_times(panels[2, 0], periods)
    elif trace.ideal is None:
        panels[2, 0].text(0.5, 0.5, "the error is not known", transform=panels[2, 0].transAxes, ha="center")
    _legends(panels[:, 0])
    if window:
        close = cut(trace, *window)
        _column(panels[:, 1], close, walls, units, f"{name}a closer look, period by period", "time [ms]", 1e3)
        panels[0, 0].axvspan(*window, color=ORANGE, alpha=0.35, linewidth=0)


def _column(
    panels: Array, trace: Trace, walls: list[Wall], units: AxisUnits, title: str, time_label: str, per_second: float
) -> None:
    """Draw position, force and error below one another; `per_second` converts times to the unit of their axis."""
    draws: tuple[Callable[[Axes, Trace, AxisUnits, float], None], ...] = (_draw_position, _draw_force, _draw_error)
    for panel, draw in zip(panels, draws, strict=True):
        draw(panel, trace, units, per_second)
        panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0)
    _shade_walls(panels[0], walls, units)
    panels[0].set_title(title, loc="left", size=11, color=INK)
    panels[2].set_xlabel(time_label)


def _draw_position(panel: Axes, trace: Trace, units: AxisUnits, per_second: float) -> None:
    if trace.samples is not None and trace.sample_times is not None:
        times, samples = held(trace.sample_times, trace.samples, float(trace.times[-1]))
        _line(panel, times * per_second, samples * units.per_length, ORANGE, 1.6, f"{trace.sensor}, held for a period")
    _line(panel, trace.times * per_second, trace.position * units.per_length, BLUE, 1.6, "handle")
    for (name, position), colour in zip(trace.virtual.items(), cycle((PURPLE, GREEN, SKY)), strict=False):
        _line(panel, trace.times * per_second, position * units.per_length, colour, 1.4, f"virtual mass of {name}")
    panel.set_ylabel(f"position [{units.length}]")


def _draw_force(panel: Axes, trace: Trace, units: AxisUnits, per_second: float) -> None:
    times = trace.times * per_second
    _line(panel, times, trace.force, SKY, 3.0, "rendered")
    if trace.ideal is not None:
        _line(panel, times, trace.ideal, INK, 1.1, "ideal: continuous, exact")
    panel.set_ylabel(f"{units.effort_name} on the handle [{units.effort}]")


def _draw_error(panel: Axes, trace: Trace, units: AxisUnits, per_second: float) -> None:
    if trace.ideal is None:
        return
    times = trace.times * per_second
    at, felt = thin(times, FELT * np.abs(trace.ideal))
    panel.fill_between(at, -felt, felt, color="#dcdcdc", linewidth=0, label=f"±{percent(FELT)}: a hand cannot tell")
    _line(panel, times, trace.force - trace.ideal, VERMILION, 1.0, "rendered − ideal")
    panel.set_ylabel(f"error [{units.effort}]")


def _draw_times(panel: Axes, periods: PeriodTimes) -> None:
    _line(panel, periods.times, 1e3 * periods.age, ORANGE, 1.0, "age of the feedback")
    _line(panel, periods.times, 1e3 * periods.lateness, BLUE, 1.0, "began late by")
    panel.set_ylabel("time [ms]")
    panel.set_ylim(bottom=0.0)


def _line(panel: Axes, times: Array, values: Array, colour: str, width: float, label: str) -> None:
    panel.plot(*thin(times, values), color=colour, linewidth=width, label=label, solid_capstyle="butt")


def _shade_walls(panel: Axes, walls: list[Wall], units: AxisUnits) -> None:
    """Draw the surface of each wall, and hatch the side on which a wall acts."""
    # The hatching reaches to the edge of the panel, so the limits must be settled before.
    low, high = panel.get_ylim()
    for wall in walls:
        surface = wall.position * units.per_length
        low, high = min(low, surface), max(high, surface)
    margin = 0.12 * (high - low)
    low, high = low - margin, high + margin
    for wall in walls:
        surface = wall.position * units.per_length
        panel.axhline(surface, color=GREY, linewidth=1.2)
        if wall.sides == "unilateral":
            inside = (surface, high) if wall.side == "positive" else (low, surface)
            panel.axhspan(*inside, facecolor="#ececec", edgecolor="#c4c4c4", hatch="///", linewidth=0, label="wall")
    panel.set_ylim(low, high)


def _mark_fade_in(panels: Array, trace: Trace, units: AxisUnits) -> None:
    """Shade the fade-in, before the traces begin; the error is not computed there, only the encoder is shown."""
    if trace.sample_times is None or not trace.sample_times[0] < trace.times[0]:
        return
    first, last = float(trace.sample_times[0]), float(trace.times[0])
    for panel in panels:
        panel.axvspan(first, last, color="#f1f6fa", linewidth=0, zorder=0)
    place = {"transform": panels[1].get_xaxis_transform(), "ha": "center", "va": "center", "rotation": 90, "size": 9}
    panels[1].text((first + last) / 2, 0.5, "limit fades in", color="#555555", **place)


def _mark_changes(panels: Array, changes: Sequence[float]) -> None:
    """Draw a dotted line at each change of the scene."""
    for time in changes:
        for panel in panels:
            panel.axvline(time, color=PURPLE, linewidth=1.2, linestyle=":")
        place = {"transform": panels[1].get_xaxis_transform(), "ha": "right", "va": "bottom", "rotation": 90, "size": 9}
        panels[1].text(time, 0.03, "changed ", color=PURPLE, **place)


def _legends(panels: Array) -> None:
    """Put a legend above each panel, where it hides no line."""
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        if labels:
            place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
            panel.legend(handles, labels, ncols=len(labels), fontsize=9, frameon=False, **place)


def first_force(trace: Trace) -> tuple[float, float] | None:
    """Return the times [s] around the first considerable force; None without force, or without samples to show."""
    if trace.sample_times is None or len(trace.sample_times) < 2:
        return None
    force = np.abs(trace.ideal if trace.ideal is not None else trace.force)
    if not force.any():
        return None
    period = trace.period or float(np.median(np.diff(trace.sample_times)))
    at = float(trace.times[np.argmax(force >= COUNTS * force.max())])
    first = max(float(trace.times[0]), at - ZOOM_BEFORE * period)
    return first, min(float(trace.times[-1]), first + (ZOOM_BEFORE + ZOOM_AFTER) * period)


def cut(trace: Trace, first: float, last: float) -> Trace:
    """Return the part of a trace between two times [s]."""
    inside = (trace.times >= first) & (trace.times <= last)
    sampled = _between(trace.sample_times, first, last)
    return Trace(
        trace.axis,
        trace.workspace,
        trace.times[inside],
        trace.position[inside],
        trace.force[inside],
        None if trace.ideal is None else trace.ideal[inside],
        None if trace.sample_times is None else trace.sample_times[sampled],
        None if trace.samples is None else trace.samples[sampled],
        {name: position[inside] for name, position in trace.virtual.items()},
        trace.sensor,
        trace.period,
    )


def _between(times: Array | None, first: float, last: float) -> slice:
    if times is None:
        return slice(0, 0)
    return slice(int(np.searchsorted(times, first)), int(np.searchsorted(times, last, side="right")))


def held(times: Array, values: Array, end: float) -> tuple[Array, Array]:
    """Return times and values of a staircase, each `(2 n,)`: a value is held until the next time, the last until `end`.

    `times` [s] and `values` have the shape `(n,)`.
    """
    # Every time except the first and the last is a corner twice: end of one step, begin of the next.
    corners = np.repeat(np.append(times, end), 2)[1:-1]
    return corners, np.repeat(values, 2)


def thin(times: Array, values: Array, bins: int = BINS) -> tuple[Array, Array]:
    """Return the least and the greatest value of each bin, and both ends, in order of time.

    `times` and `values` have the shape `(n,)`. A line with fewer than four points a bin is returned as it is.
    """
    size = len(values) // bins
    if size < 4:
        return times, values
    # `size` is rounded down, so the last points may fill no bin; they are all kept.
    whole = len(values) // size * size
    blocks = values[:whole].reshape(-1, size)
    starts = np.arange(0, whole, size)
    rest = np.arange(whole, len(values))
    ends = [0, len(values) - 1]
    kept = np.unique(np.concatenate([starts + blocks.argmin(axis=1), starts + blocks.argmax(axis=1), rest, ends]))
    return times[kept], values[kept]

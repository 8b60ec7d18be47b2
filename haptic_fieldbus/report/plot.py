"""Picture of a run: position and wall, force, and error, over the whole run and around the first force.

On real drives the error is not known; there the last panel shows how late the periods began and how old feedback was.
"""

from collections.abc import Callable, Sequence
from itertools import cycle, pairwise
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure

from haptic_fieldbus.assessing.result import Array, PeriodTimes, Result, Trace
from haptic_fieldbus.numerals import percent
from haptic_fieldbus.report.drawing import (
    BLUE,
    FELT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    UNITS,
    VERMILION,
    AxisUnits,
    held,
    kept,
    thin,
)
from haptic_fieldbus.report.texts import key_figures
from haptic_fieldbus.scenes.element import StaticElement
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

# Panel of a run: force over position, with the law of the scene, its wells and stops, and the motor's limit.

AT_PLACE, AT_PLACE_AND_SPEED = (Signal.POSITION,), (Signal.POSITION, Signal.VELOCITY)
PLACES = 2001
"""Places at which the law of the scene is drawn."""
AROUND = 0.08
"""Share of the way by which the law is drawn beyond it."""
NEAR = 0.5
"""Share of the motor's limit from which it is drawn."""


def draw_law(panel: Axes, trace: Trace, elements: Sequence[object], effort: float | None, units: AxisUnits) -> None:
    """Draw the rendered and the ideal force over the position of the handle.

    `effort` is the limit of the motor [N or N·m]; None where it is not known.
    """
    low, high = float(trace.position.min()), float(trace.position.max())
    margin = AROUND * (high - low or 1e-3)
    places = np.linspace(low - margin, high + margin, PLACES)
    law = law_at_rest(elements, places)
    if law is not None:
        panel.plot(places * units.per_length, law, color=GREY, linewidth=1.0, linestyle="--", label="force at rest")
        for number, well in enumerate(wells(places, law)):
            label = "well" if not number else None
            panel.axvline(well * units.per_length, color=GREEN, linewidth=1.0, linestyle=":", label=label)
    _path(panel, trace.position, trace.force, units, SKY, 3.0)
    asked = trace.force
    if trace.ideal is not None:
        _path(panel, trace.position, trace.ideal, units, INK, 1.1)
        asked = trace.ideal
    if effort is not None and np.abs(asked).max() > NEAR * effort:
        for number, limit in enumerate((-effort, effort)):
            panel.axhline(
                limit, color=VERMILION, linewidth=1.2, linestyle="-.", label=None if number else "limit of the motor"
            )
    for number, stop in enumerate(_surfaces(elements, low - margin, high + margin)):
        panel.axvline(stop * units.per_length, color=PURPLE, linewidth=1.2, label=None if number else "wall or stop")
    panel.set_ylabel(f"{units.effort_name} [{units.effort}]")
    if panel.get_legend_handles_labels()[1]:  # the colours of both paths are those of the force beside
        panel.legend(fontsize=8, loc="best", framealpha=0.85, edgecolor="none")


def law_at_rest(elements: Sequence[object], places: Array) -> Array | None:
    """Return the force of the scene on a handle that rests at each place, `(n_places,)`.

    What remembers, such as friction, is left out; None when nothing else depends on the place.
    """
    laws = [
        (element.force, [0.0] * (len(element.needs) - 1))
        for element in elements
        if isinstance(element, StaticElement) and element.needs in (AT_PLACE, AT_PLACE_AND_SPEED)
    ]
    if not laws:
        return None
    return np.array([sum(force(place, *rest) for force, rest in laws) for place in places.tolist()])


def wells(places: Array, law: Array) -> list[float]:
    """Return the places to which the law draws the handle from both sides, between two of `places`."""
    found = []
    for (left, before), (right, after) in pairwise(zip(places.tolist(), law.tolist(), strict=True)):
        if before > 0.0 >= after and after != before:
            found.append(left + (right - left) * before / (before - after))
    return found


def _surfaces(elements: Sequence[object], low: float, high: float) -> list[float]:
    """Return the places of walls and end stops within a range."""
    found: list[float] = []
    for element in elements:
        if isinstance(element, Wall):
            found.append(element.position)
        elif isinstance(element, EndStop):
            found += [element.lower, element.upper]
    return [place for place in found if low <= place <= high]


def _path(panel: Axes, position: Array, force: Array, units: AxisUnits, colour: str, width: float) -> None:
    shown = np.union1d(kept(force), kept(position))
    x, y = position[shown] * units.per_length, force[shown]
    panel.plot(x, y, color=colour, linewidth=width, solid_capstyle="butt")


ZOOM_BEFORE, ZOOM_AFTER = 12, 28
"""Periods shown before and after the first considerable force in the right-hand panels."""
COUNTS = 0.05
"""Share of the greatest force from which a force is considerable."""

SIZE = (13.5, 8.4)
DPI = 110


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
        name = f"{trace.axis}: " if axes > 1 else ""
        elements = result.plan.scene.of_axis(trace.axis) if result.plan else ()
        times = [change.time for change in result.changes]
        draw_axis(part, trace, elements, times, name, result.periods, _limit(result, trace.axis))
    figure.savefig(path)


def _limit(result: Result, name: str) -> float | None:
    """Return the effort limit of an axis [N or N·m]; None where it is not known."""
    axes = result.plan.axes if result.plan else ()
    return next((axis.limits.effort for axis in axes if axis.name == name), None)


def draw_axis(
    figure: SubFigure | Figure,
    trace: Trace,
    elements: Sequence[object],
    changes: Sequence[float] = (),
    name: str = "",
    periods: PeriodTimes | None = None,
    effort: float | None = None,
) -> None:
    """Draw position, force and error over the whole run, and beside them, when there is force: force over position, and
    position and force around the first force.

    `changes` are the times [s] at which the scene was changed; `name` precedes the titles. The times of `periods` take
    the place of the error, if they are given. `effort` is the limit of the motor [N or N·m].
    """
    window = first_force(trace)
    columns = 2 if window else 1
    panels = figure.subplots(
        3,
        columns,
        squeeze=False,
        gridspec_kw={"width_ratios": [1.5, 1.0][:columns], "height_ratios": [1.15, 1.0, 0.8]},
    )
    figure.subplots_adjust(left=0.065, right=0.985, top=0.87, bottom=0.07, hspace=0.32, wspace=0.18)
    walls = [element for element in elements if isinstance(element, Wall)]
    units = UNITS[trace.workspace]
    _column(panels[:, 0], trace, walls, units, f"{name}the whole run", "time [s]", 1.0)
    _mark_fade_in(panels[:, 0], trace, units)
    _mark_changes(panels[:, 0], changes)
    if periods is not None:
        _draw_times(panels[2, 0], periods)
    elif trace.ideal is None:
        panels[2, 0].text(0.5, 0.5, "error unknown", transform=panels[2, 0].transAxes, ha="center")
    _legends(panels[:, 0])
    if window:
        draw_law(panels[0, 1], trace, elements, effort, units)
        _dress(panels[0, 1], f"{name}{units.effort_name} over position [{units.length}]")
        close = cut(trace, *window)
        _column(panels[1:, 1], close, walls, units, f"{name}detail, period by period", "time [ms]", 1e3)
        panels[2, 1].set_ylabel(f"{units.effort_name} [{units.effort}]")
        panels[0, 0].axvspan(*window, color=ORANGE, alpha=0.35, linewidth=0)


def _column(
    panels: Array, trace: Trace, walls: list[Wall], units: AxisUnits, title: str, time_label: str, per_second: float
) -> None:
    """Draw position, force and, with three panels, error below one another, over one time.

    `per_second` converts times to the unit of their axis.
    """
    draws: tuple[Callable[[Axes, Trace, AxisUnits, float], None], ...] = (_draw_position, _draw_force, _draw_error)
    for panel, draw in zip(panels, draws, strict=False):
        draw(panel, trace, units, per_second)
        if panel is not panels[-1]:
            panel.sharex(panels[-1])
        _dress(panel, title if panel is panels[0] else "")
    _shade_walls(panels[0], walls, units)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    panels[-1].set_xlabel(time_label)


def _dress(panel: Axes, title: str) -> None:
    panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.margins(x=0)
    if title:
        panel.set_title(title, loc="left", size=11, color=INK)


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
    panel.fill_between(at, -felt, felt, color="#dcdcdc", linewidth=0, label=f"±{percent(FELT)}: not noticeable")
    _line(panel, times, trace.force - trace.ideal, VERMILION, 1.0, "rendered − ideal")
    panel.set_ylabel(f"error [{units.effort}]")


def _draw_times(panel: Axes, periods: PeriodTimes) -> None:
    _line(panel, periods.times, 1e3 * periods.age, ORANGE, 1.0, "feedback age")
    _line(panel, periods.times, 1e3 * periods.lateness, BLUE, 1.0, "late by")
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
    panels[1].text((first + last) / 2, 0.5, "fade-in of the limit", color="#555555", **place)


def _mark_changes(panels: Array, changes: Sequence[float]) -> None:
    """Draw a dotted line at each change of the scene."""
    for time in changes:
        for panel in panels:
            panel.axvline(time, color=PURPLE, linewidth=1.2, linestyle=":")
        place = {"transform": panels[1].get_xaxis_transform(), "ha": "right", "va": "bottom", "rotation": 90, "size": 9}
        panels[1].text(time, 0.03, "changed ", color=PURPLE, **place)


def _legends(panels: Array) -> None:
    for panel in panels:
        _legend(panel)


def _legend(panel: Axes) -> None:
    """Put a legend above a panel, where it hides no line."""
    handles, labels = panel.get_legend_handles_labels()
    if labels:
        panel.legend(
            handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=len(labels),
            fontsize=9, frameon=False,
        )  # fmt: skip


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

"""Picture of a run: position and wall, force, and error, over the whole run and around the first force.

Its title is the verdict in a few words and a number; the rest of the verdict stands below it.

On real drives the error is not known; the last panel then shows the lateness of periods and the age of feedback.

The page of a certificate says what was seen on which bench, and shows the growth of the contact over its stiffness.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle, pairwise
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from haptic_fieldbus.assessing.loop_report import PeriodTimes
from haptic_fieldbus.assessing.result import Array, Result, Trace
from haptic_fieldbus.identification.certificate import BEFORE, WELL_DAMPED, Certificate
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.numerals import exactly, in_unit, lines_of, percent, rounded_limit
from haptic_fieldbus.planning.refusal import CAVEATS
from haptic_fieldbus.report.drawing import (
    BLUE,
    FELT,
    GREEN,
    GREY,
    INK,
    NAME_SIZE,
    NOT_NOTICED,
    NOTE,
    ORANGE,
    PURPLE,
    SKY,
    SUBTITLE_SIZE,
    UNITS,
    VERMILION,
    WALL,
    AxisUnits,
    dress,
    envelope,
    figure,
    held,
    is_smear,
    kept,
    name_lines,
    thin,
)
from haptic_fieldbus.report.texts import key_figures, parameter_units
from haptic_fieldbus.scenes.element import StaticElement
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

# Panel of a run: force over position, with the law of the scene, its wells and stops, and the motor's limit.

AT_PLACE, AT_PLACE_AND_SPEED = (Signal.POSITION,), (Signal.POSITION, Signal.VELOCITY)
PLACES = 2001
"""Number of positions at which the law of the scene is drawn."""
AROUND = 0.08
"""Range of the drawn law beyond the travel, as a share of the travel."""
NEAR = 0.5
"""Force from which the motor's limit is drawn, as a share of the limit."""


def draw_law(panel: Axes, trace: Trace, elements: Sequence[object], effort: float | None, units: AxisUnits) -> None:
    """Draw the rendered and the ideal force over the position of the handle.

    `effort` is the limit of the motor [N or N·m]; None where it is not known.
    """
    low, high = float(trace.position.min()), float(trace.position.max())
    margin = AROUND * (high - low or 1e-3)
    places = np.linspace(low - margin, high + margin, PLACES)
    law = law_at_rest(elements, places)
    if law is not None:
        at_rest = f"{units.effort_name} at rest"
        panel.plot(places * units.per_length, law, color=GREY, linewidth=1.0, linestyle="--", label=at_rest)
        for number, well in enumerate(wells(places, law)):
            label = "detent" if not number else None
            panel.axvline(well * units.per_length, color=GREEN, linewidth=1.0, linestyle=":", label=label)
    _path(panel, trace.position, trace.force, units, SKY, 3.0, "commanded" if trace.ideal is None else "rendered")
    asked = trace.force
    if trace.ideal is not None:
        _path(panel, trace.position, trace.ideal, units, INK, 0.9, "ideal")
        asked = trace.ideal
    shown = [float(np.concatenate([trace.force, asked]).min()), float(np.concatenate([trace.force, asked]).max())]
    for limit in (-effort, effort) if effort is not None else ():
        # The law may go far beyond what was rendered; the limit on the side of the force tells enough.
        if limit * asked[np.argmax(np.abs(asked))] > 0.0 and np.abs(asked).max() > NEAR * abs(limit):
            panel.axhline(limit, color=VERMILION, linewidth=1.2, linestyle="-.", label="motor limit")
            shown.append(limit)
    stops = _surfaces(elements, low - margin, high + margin)
    for number, stop in enumerate(stops):
        label = "wall" if any(isinstance(each, Wall) and each.position == stop for each in elements) else "stop"
        panel.axvline(stop * units.per_length, color=PURPLE, linewidth=1.2, label=None if number else label)
    room = AROUND * (max(shown) - min(shown) or 1e-3)
    panel.set_ylim(min(shown) - room, max(shown) + room)
    panel.set(xlabel=f"position [{units.length}]", ylabel=f"{units.effort_name} [{units.effort}]")


def law_at_rest(elements: Sequence[object], places: Array) -> Array | None:
    """Return the force of the scene on a handle at rest at each place, `(n_places,)`.

    Elements with memory, such as friction, are left out; None if no other element depends on the place.
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
    """Return the places to which the law pulls the handle from both sides, between two of `places`."""
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


def _path(panel: Axes, position: Array, force: Array, units: AxisUnits, colour: str, width: float, label: str) -> None:
    shown = np.union1d(kept(force), kept(position))
    x, y = position[shown] * units.per_length, force[shown]
    panel.plot(x, y, color=colour, linewidth=width, solid_capstyle="butt", label=label)


ZOOM_BEFORE, ZOOM_AFTER = 12, 28
"""Periods shown before and after the first considerable force in the right-hand panels."""
COUNTS = 0.05
"""Share of the greatest force from which a force is considerable."""

WIDTH, HEIGHT = 13.5, 8.0
"""Size of the picture of one axis [inches]."""
OPPOSES = 0.9
"""Share of the considerable force opposite to the travel from which the scene counts as pushing back."""


def draw_run(result: Result) -> Figure:
    """Return a figure of the traces of a run, one axis below the other."""
    axes = max(1, len(result.traces))
    title, rest = headline(result)
    drawn = figure(HEIGHT * axes, WIDTH, title, [each for each in (rest, key_figures(result)) if each])
    for part, trace in zip(drawn.subfigures(len(result.traces), 1, squeeze=False)[:, 0], result.traces, strict=True):
        name = f"{trace.axis}: " if axes > 1 else ""
        elements = result.plan.scene.of_axis(trace.axis) if result.plan else ()
        times = [change.time for change in result.changes]
        draw_axis(part, trace, elements, times, name, result.periods, _limit(result, trace.axis))
    name_lines(drawn)
    return drawn


def headline(result: Result) -> tuple[str, str]:
    """Return the verdict in a few words and a number, and the rest of it.

    Without a verdict it is the trip of the run, or the name of the scene.
    """
    verdict = result.verdict or next((trip.message for trip in result.trips), result.scene)
    for axis in result.plan.axes if result.plan and verdict.startswith("Unstable") else ():
        found, unit = axis.stability, parameter_units(axis.workspace)["stiffness"]
        if found is not None and found.stiffness is not None and found.stiffness_limit.stable is not None:
            limit = min(found.stiffness_limit.stable, limit_drawn(found))
            if found.stiffness > limit:
                return (
                    f"Unstable: {exactly(found.stiffness)} {unit}, limit {rounded_limit(limit)} {unit}",
                    f"{_capital(verdict.partition(': ')[2])}{_caveat(found)}",
                )
    few, _, rest = re.sub(r" \(|[,;.] |\.$", "|", verdict, count=1).partition("|")
    # A bracket that was opened at the cut has no other half.
    rest = re.sub(r"^([^(]*)\)", r"\1", rest)
    return few, _capital(rest)


def _caveat(stability: Stability) -> str:
    """Return the caveat of a limit as a sentence; empty without one."""
    known = CAVEATS.get(stability.limit.basis)
    return f" {_capital(known)}." if known else ""


def _capital(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def limit_drawn(stability: Stability) -> float:
    """Return the limit of an axis [N/m or N·m/rad]; ∞ without a limit."""
    return math.inf if stability.stiffness is None else stability.limit.value


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
    """Draw position, force and error over the whole run, and if there is force, panels beside them.

    These panels show force over position, and position and force around the first force. `changes` are the times [s] at
    which the scene was changed; `name` precedes the titles. If given, the times of `periods` replace the error.
    `effort` is the limit of the motor [N or N·m]. Without error and times, the force takes their place.
    """
    window = first_force(trace)
    columns = 2 if window else 1
    ratios = {"width_ratios": [1.5, 1.0][:columns], "height_ratios": [1.15, 1.0, 0.8]}
    panels = figure.subplots(3, columns, squeeze=False, gridspec_kw=ratios)
    walls = [element for element in elements if isinstance(element, Wall)]
    units = UNITS[trace.workspace]
    whole = panels[:, 0]
    if periods is None and trace.ideal is None:
        whole[2].remove()
        whole = whole[:2]
        whole[1].set_subplotspec(whole[0].get_gridspec()[1:, 0])
    _column(whole, trace, walls, units, f"{name}whole run", "time [s]", 1.0)
    _mark_fade_in(whole, trace)
    _mark_changes(whole, changes)
    if periods is not None:
        _draw_times(whole[2], periods)
    if window:
        draw_law(panels[0, 1], trace, elements, effort, units)
        _frame(panels[0, 1], f"{name}{units.effort_name} over position")
        close = cut(trace, *window)
        _column(panels[1:, 1], close, walls, units, f"{name}first force, period by period", "time [ms]", 1e3)
        panels[0, 0].axvspan(*window, color=ORANGE, alpha=0.35, linewidth=0, label="first force")


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
        _frame(panel, title if panel is panels[0] else "")
    _shade_walls(panels[0], walls, units)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    panels[-1].set_xlabel(time_label)


def _frame(panel: Axes, title: str) -> None:
    dress(panel, title, panel.get_xlabel(), panel.get_ylabel())
    panel.margins(x=0)


def _draw_position(panel: Axes, trace: Trace, units: AxisUnits, per_second: float) -> None:
    times, samples, one = trace.sample_times, trace.samples, False
    if samples is not None and times is not None:
        one = np.array_equal(samples, trace.position)
        times, samples = held(times, samples, float(trace.times[-1]))
        colour, label = (BLUE, f"handle ({trace.sensor})") if one else (ORANGE, trace.sensor)
        _line(panel, times * per_second, samples * units.per_length, colour, 1.6, label)
    if not one:
        _line(panel, trace.times * per_second, trace.position * units.per_length, BLUE, 1.6, "handle")
    for (name, position), colour in zip(trace.virtual.items(), cycle((PURPLE, GREEN, SKY)), strict=False):
        _line(panel, trace.times * per_second, position * units.per_length, colour, 1.4, f"mass of {name}")
    panel.set_ylabel(f"position [{units.length}]")


def _draw_force(panel: Axes, trace: Trace, units: AxisUnits, per_second: float) -> None:
    times = trace.times * per_second
    _line(panel, times, trace.force, SKY, 3.0, "commanded" if trace.ideal is None else "rendered")
    if trace.ideal is not None:
        _line(panel, times, trace.ideal, INK, 0.9, "ideal")
    if pushes_back(trace):
        low, high = panel.get_ylim()
        panel.axhspan(low, min(0.0, high), facecolor="none", edgecolor="none", label="pushes back")
        panel.set_ylim(low, high)
    panel.set_ylabel(f"{units.effort_name} [{units.effort}]")


def pushes_back(trace: Trace) -> bool:
    """Return whether there is negative force, and nearly all considerable force points to the start of the handle."""
    considerable = np.abs(trace.force) > COUNTS * float(np.abs(trace.force).max(initial=0.0))
    force, way = trace.force[considerable], trace.position[considerable] - trace.position[0]
    return bool((force < 0.0).any()) and float(np.mean(force * way < 0.0)) > OPPOSES


def _draw_error(panel: Axes, trace: Trace, units: AxisUnits, per_second: float) -> None:
    if trace.ideal is None:
        return
    times, error = trace.times * per_second, trace.force - trace.ideal
    at, felt = thin(times, FELT * np.abs(trace.ideal))
    panel.fill_between(at, -felt, felt, color=NOT_NOTICED, linewidth=0, label=f"below ±{percent(FELT)}: not noticed")
    if is_smear(error):
        at, low, high = envelope(times, error)
        panel.fill_between(at, low, high, color=VERMILION, alpha=0.45, linewidth=0.6, label="error")
    else:
        _line(panel, times, error, VERMILION, 1.0, "error")
    panel.set_ylabel(f"error [{units.effort}]")


def _draw_times(panel: Axes, periods: PeriodTimes) -> None:
    _line(panel, periods.times, 1e3 * periods.age, ORANGE, 1.0, "feedback age")
    _line(panel, periods.times, 1e3 * periods.lateness, BLUE, 1.0, "period starts late by")
    panel.set_ylabel("time [ms]")
    panel.set_ylim(bottom=0.0)


def _line(panel: Axes, times: Array, values: Array, colour: str, width: float, label: str) -> None:
    panel.plot(*thin(times, values), color=colour, linewidth=width, label=label, solid_capstyle="butt")


def _shade_walls(panel: Axes, walls: list[Wall], units: AxisUnits) -> None:
    """Draw the surface of each wall, and tint the side on which a wall acts."""
    # The tint reaches to the edge of the panel, so the limits must be settled before.
    low, high = panel.get_ylim()
    for wall in walls:
        surface = wall.position * units.per_length
        low, high = min(low, surface), max(high, surface)
    margin = 0.12 * (high - low)
    low, high = low - margin, high + margin
    for number, wall in enumerate(walls):
        surface = wall.position * units.per_length
        panel.axhline(surface, color=GREY, linewidth=1.2)
        if wall.sides == "unilateral":
            inside = (surface, high) if wall.side == "positive" else (low, surface)
            panel.axhspan(*inside, facecolor=WALL, linewidth=0, zorder=0, label=None if number else "wall")
    panel.set_ylim(low, high)


def _mark_fade_in(panels: Array, trace: Trace) -> None:
    """Shade the fade-in, before the traces begin; there is no error there, and only the encoder is shown."""
    if trace.sample_times is None or not trace.sample_times[0] < trace.times[0]:
        return
    first, last = float(trace.sample_times[0]), float(trace.times[0])
    for panel in panels:
        panel.axvspan(first, last, color="#f1f6fa", linewidth=0, zorder=0)
    place = {"transform": panels[1].get_xaxis_transform(), "ha": "center", "va": "center", "rotation": 90}
    panels[1].text((first + last) / 2, 0.5, "force fades in", color=NOTE, size=NAME_SIZE, **place)


def _mark_changes(panels: Array, changes: Sequence[float]) -> None:
    """Draw a dotted line at each change of the scene."""
    for time in changes:
        for panel in panels:
            panel.axvline(time, color=PURPLE, linewidth=1.2, linestyle=":")
        place = {"transform": panels[1].get_xaxis_transform(), "ha": "right", "va": "bottom", "rotation": 90}
        panels[1].text(time, 0.03, "changed ", color=PURPLE, size=NAME_SIZE, **place)


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
    part = replace(
        trace,
        times=trace.times[inside],
        position=trace.position[inside],
        force=trace.force[inside],
        ideal=None if trace.ideal is None else trace.ideal[inside],
        virtual={name: position[inside] for name, position in trace.virtual.items()},
    )
    if trace.sample_times is None:
        return part
    sampled = (trace.sample_times >= first) & (trace.sample_times <= last)
    samples = None if trace.samples is None else trace.samples[sampled]
    return replace(part, sample_times=trace.sample_times[sampled], samples=samples)


PAGE = (11.0, 8.3)
"""Height and width of the page of a certificate [inches]."""
LINE = 88
"""Longest line of its text."""


def draw_certificate(found: Certificate) -> Figure:
    """Return the page of a certificate."""
    seen = "No stiffness was" if found.seen is None else f"{in_unit(found.seen, found.unit)} was"
    drawn = figure(*PAGE, f"Certificate: {seen} seen well damped")
    page, panel = drawn.subplots(2, 1, height_ratios=(0.36, 1.0))
    page.axis("off")
    page.set(xticks=[], yticks=[])
    lines = [
        ("" if number else label, part)
        for label, text in lines_of(each for each in found.rows() if not each.detail)
        for number, part in enumerate(wrap(text, LINE))
    ]
    for place, (column, colour) in enumerate(((0.0, INK), (0.14, NOTE))):
        words = "\n".join(line[place] for line in lines)
        page.text(column, 1.0, words, size=SUBTITLE_SIZE - 1.5, va="top", linespacing=1.6, color=colour)
    swung = [each for each in found.contacts if each.growth is not None]
    panel.plot([each.stiffness for each in swung], [each.growth or 0.0 for each in swung], "o-", color=BLUE)
    for growth, words, colour in ((1.0, "does not decay", VERMILION), (WELL_DAMPED, "well damped below", GREEN)):
        panel.axhline(growth, color=colour, linewidth=1.0)
        panel.annotate(
            words, (0.01, growth), xycoords=panel.get_yaxis_transform(), va="bottom", size=NAME_SIZE, color=NOTE
        )
    if found.onset is not None:
        panel.axvspan(found.onset.low, min(found.onset.high, 3.0 * found.predicted), color=ORANGE, alpha=0.3)
    marks = [("limit", found.limit, GREY, "-"), ("predicted onset", found.predicted, VERMILION, "--")]
    marks += [] if found.onset is None else [("extrapolated onset", found.onset.value, ORANGE, "-")]
    for label, at, colour, style in reversed([each for each in marks if math.isfinite(each[1])]):
        panel.axvline(at, color=colour, linewidth=1.4, linestyle=style, label=f"{label} {in_unit(at, found.unit)}")
    panel.set_ylim(0.0, 1.1)
    panel.set_xlim(0.0, 1.05 * max(panel.get_xlim()[1], found.predicted if math.isfinite(found.predicted) else 0.0))
    panel.legend(loc="lower center", edgecolor="none", framealpha=1.0)
    ratio = f"swing over the one {BEFORE} [1]"
    dress(panel, f"each swing of the contact beside the one {BEFORE}", f"stiffness [{found.unit}]", ratio)
    return drawn

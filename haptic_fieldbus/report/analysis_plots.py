"""Pictures of stability regions, models, responses and estimates."""

import math
from collections.abc import Mapping
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from haptic_fieldbus.api.estimation import Estimation
from haptic_fieldbus.api.model import EnvironmentModel, poles_along, poles_of, step_growth
from haptic_fieldbus.api.open_loop import Response
from haptic_fieldbus.api.stability_limits import Judgement
from haptic_fieldbus.api.sweep_folder import Sweep
from haptic_fieldbus.assessing.result import Array
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.identification import IdentifiedBench, interval_text
from haptic_fieldbus.identification.fit import errors_after, prediction_errors, torque_balance
from haptic_fieldbus.identification.shaft import ShaftModel, ShaftRecord
from haptic_fieldbus.numerals import exactly, in_unit, rounded, rounded_limit
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.planning.explain import margin_text
from haptic_fieldbus.planning.refusal import CAVEATS, passivity_condition
from haptic_fieldbus.report.analysis_texts import estimate_lines
from haptic_fieldbus.report.drawing import (
    BLUE,
    FAILS,
    GREEN,
    GREY,
    NAME_SIZE,
    ORANGE,
    PURPLE,
    SKY,
    UNITS,
    VERMILION,
    dress,
    figure,
    line,
    name_lines,
    thin,
)
from haptic_fieldbus.report.plot import limit_drawn
from haptic_fieldbus.report.texts import parameter_units

# Picture of a model: the poles of each method on the z-plane, and the growth of a free motion in a step.
#
# On the z-plane each method draws a path from 1, where the period is 0, over its poles at the chosen period, which have
# the marker. Poles outside of the unit circle grow.

PATHS = 160
"""Periods of a curve of the growth; a path on the z-plane has twice as many."""
FASTEST, SLOWEST = 0.01, 3.0
"""Range of the periods, as multiples of the time constant of the fastest virtual state: 1/|s|."""
VIEW = 1.6
"""Half of the width of the z-plane that is shown."""
GROWN = 3.0
"""Largest growth per step that is shown."""


def draw_model(model: EnvironmentModel, title: str) -> Figure:
    """Return a figure of the poles on the z-plane, and of the growth of a step over the period."""
    known = {method: growth for method, growth in model.growth.items() if growth is not None}
    worst = max(known, key=lambda method: known[method])
    told = f"{title}; markers at a period of {in_unit(model.period, 's')}, dots at other periods"
    drawn = figure(6.6, 13.0, f"{worst}: spectral radius {rounded(known[worst])}", [told])
    plane, growth = drawn.subplots(1, 2, width_ratios=[1.0, 1.2])
    periods = _periods(model)
    _draw_plane(plane, model, periods)
    _draw_growth(growth, model, periods)
    handles, labels = growth.get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=NAME_SIZE,
                 title=f"spectral radius at {in_unit(model.period, 's')}", title_fontsize=NAME_SIZE)  # fmt: skip
    return drawn


def _periods(model: EnvironmentModel) -> Matrix:
    """Return periods [s] from far below to far above the time constant of the fastest virtual state, (PATHS,)."""
    fastest = float(np.abs(poles_of(model.integrated.a)).max()) or 1.0 / model.period
    low, high = min(FASTEST / fastest, model.period), max(SLOWEST / fastest, model.period)
    return np.geomspace(low, high, PATHS)


def _draw_plane(panel: Axes, model: EnvironmentModel, periods: Matrix) -> None:
    turn = np.exp(2j * math.pi * np.linspace(0.0, 1.0, 361))
    panel.set_facecolor(FAILS)
    panel.fill(turn.real, turn.imag, color="white", zorder=0)
    panel.plot(turn.real, turn.imag, color=GREY, linewidth=1.0)
    even = np.linspace(periods[0], periods[-1], 2 * PATHS)
    for method in METHODS:
        poles = np.array([*poles_along(model.integrated, even, method)])
        if len(poles):
            look = line(method, marked=False) | {"linestyle": "none", "marker": ".", "markersize": 2.2, "alpha": 0.6}
            panel.plot(poles.real.ravel(), poles.imag.ravel(), **look)
        for each in poles_along(model.integrated, np.array([model.period]), method):
            panel.plot(each.real, each.imag, **line(method) | {"linestyle": "none"}, zorder=3)
    panel.set(xlim=(-VIEW, VIEW), ylim=(-VIEW, VIEW), aspect="equal")
    told = "z-plane: motion decays inside the circle"
    dress(panel, told, "real part of the pole [1]", "imaginary part of the pole [1]")


def _draw_growth(panel: Axes, model: EnvironmentModel, periods: Matrix) -> None:
    for method, at_period in model.growth.items():
        curve = [step_growth(model.integrated, period, method) for period in periods.tolist()]
        told = "no step" if at_period is None else rounded_limit(at_period)
        values = np.array([np.nan if value is None else value for value in curve])
        panel.plot(1e3 * periods, values, **line(method, f"{method}: {told}", marked=False))
        if at_period is not None:
            panel.plot([1e3 * model.period], [at_period], **line(method) | {"linestyle": "none", "label": "_"})
    panel.axvline(1e3 * model.period, color=GREY, linewidth=1.0, linestyle=":")
    panel.axhspan(1.0, GROWN, color=FAILS, linewidth=0, zorder=0)
    panel.set(xscale="log", ylim=(0.0, GROWN))
    for height, word in ((0.93, "grows"), (0.05, "decays")):
        panel.text(0.02, height * GROWN, word, transform=panel.get_yaxis_transform(), size=NAME_SIZE, color=GREY)
    dress(panel, "growth in a step", "period [ms]", "spectral radius, largest |z| [1]")
    panel.margins(x=0)


# Picture of an open-loop response: positions, velocities and force over time, as in the figures of the lecture.

GROWS = 1.0 + 1e-6
"""Spectral radius from which a motion grows, above the errors of rounding."""
COLOURS = (ORANGE, GREEN, PURPLE, SKY)
OUTER = 0.02
"""Share of the samples that may leave the panel of the force: a one-period impulse would hide everything else."""


def draw_response(response: Response, title: str) -> Figure:
    """Return a figure of positions, velocities and the force over time."""
    units = UNITS[response.workspace]
    velocities = [name for name in response.states if name.endswith("velocity")]
    method = f"; integrator {response.method}" if response.method else ""
    size = f"{units.effort_name} {in_unit(float(np.abs(response.force).max()), units.effort)}"
    grows = response.spectral_radius is not None and response.spectral_radius > GROWS
    few = "Diverges" if response.diverged else f"{'Grows to a' if grows else 'Largest'} {size}"
    told = f"{title}{method}; period {in_unit(_period(response), 's')}"
    drawn = figure(7.6 if velocities else 5.6, 10.0, few, [told])
    panels = list(drawn.subplots(3 if velocities else 2, 1, sharex=True))
    positions = {name: value for name, value in response.states.items() if name not in velocities}
    _panel(panels[0], response, {"handle": response.position, **positions}, units.per_length)
    dress(panels[0], "position", "", f"position [{units.length}]")
    if velocities:
        _panel(panels[1], response, {name: response.states[name] for name in velocities}, units.per_length)
        dress(panels[1], "velocity of the virtual masses", "", f"velocity [{units.length}/s]")
    panels[-1].plot(*thin(response.time, response.force), color=BLUE, linewidth=1.6)
    shown, beyond = _shown_range(response.force), ""
    if shown is not None:
        extreme = float(response.force[np.argmax(np.abs(response.force))])
        beyond = f", an impulse of {rounded(extreme)} {units.effort} goes beyond the frame"
        panels[-1].set_ylim(shown)
    dress(panels[-1], f"{units.effort_name} on the handle{beyond}", "time [s]", f"{units.effort_name} [{units.effort}]")
    for panel in panels:
        panel.margins(x=0)
        low, high = panel.get_ylim()
        panel.set_ylim(min(low, 0.0), max(high, 0.0))
    name_lines(drawn)
    return drawn


def _period(response: Response) -> float:
    """Return the period of the samples [s]."""
    return float(response.time[1] - response.time[0]) if len(response.time) > 1 else 0.0


def _panel(panel: Axes, response: Response, shown: dict[str, Array], per_length: float) -> None:
    """Draw the handle and virtual states."""
    colours = {"handle": BLUE, **dict(zip((name for name in shown if name != "handle"), cycle(COLOURS), strict=False))}
    for name, values in shown.items():
        label = name if name == "handle" else f"virtual {name}"
        panel.plot(*thin(response.time, per_length * values), color=colours[name], linewidth=1.6, label=label)


def _shown_range(force: Array) -> tuple[float, float] | None:
    """Return the range of all but a few samples of the force; None if these few hide nothing."""
    inner = np.quantile(force, (OUTER / 2, 1.0 - OUTER / 2))
    room = 0.15 * float(np.ptp(inner))
    low, high = float(inner[0]) - room, float(inner[1]) + room
    return (low, high) if room and np.ptp(force) > 2.0 * (high - low) else None


# Picture of an estimate: the signal above, what the estimator makes of it below.

ESTIMATE_UNITS = {"position": "m or rad", "velocity": "m/s or rad/s"}
TOLD = ("noise", "delay", "drift")


def draw_estimate(found: Estimation, file: str) -> Figure:
    """Return a figure of a signal and its estimate over time."""
    told = dict(estimate_lines(found, file))
    few = told["noise"].partition(":")[0]
    notes = [f"{key}: {told[key]}" for key in TOLD]
    drawn = figure(6.6, 10.0, f"Noise {few}", [f"{file}, estimator {found.estimator}", *notes])
    panels = drawn.subplots(2, 1, sharex=True)
    signal, estimate = found.signal, found.estimate
    rows = (
        ("measured", signal.quantity, signal.values, BLUE),
        ("estimated", estimate.quantity, estimate.values, ORANGE),
    )
    for panel, (which, quantity, values, colour) in zip(panels, rows, strict=True):
        panel.plot(*thin(signal.times, values), color=colour, linewidth=1.4)
        label = "" if panel is panels[0] else "time [s]"
        dress(panel, f"{which} {quantity}", label, f"{quantity} [{ESTIMATE_UNITS[quantity]}]")
        panel.margins(x=0)
    return drawn


# Picture of the limit of a loop over virtual stiffness and damping.

POINTS = 24
"""Number of dampings at which limits are computed."""
HEADROOM = 1.3
"""Height of the picture over the largest stiffness that is marked at the damping of the scene."""
NAMED_FROM = 0.01
"""Share of the panel from which an area has a name."""
DAMPINGS = 2.5
"""Width of the picture over the damping of the scene, or of the device if that is larger."""


def draw_region(judgement: Judgement) -> Figure:
    """Return a figure of the stiffness at which the loop becomes unstable over damping, the limit, and the scene.

    The limit includes all uncertain values; the onset has the values of rig and profile.

    Raises UsageError when no element of the scene has both parameters.
    """
    element, stability = judgement.group.stiffest, judgement.stability
    if element is None or not hasattr(element, "damping") or stability.stiffness is None:
        raise UsageError("--plot needs an element with stiffness and damping; this scene has none")
    units = parameter_units(judgement.workspace)
    own = float(element.damping)
    # The last term keeps the panel from having no width when neither device nor scene has damping.
    end = DAMPINGS * max(stability.plant.damping, own, 1e-9 * judgement.group.largest_damping)
    dampings = np.union1d(np.linspace(0.0, end, POINTS), [own])
    onset = np.array([judgement.group.limit(value) for value in dampings.tolist()])
    limit = np.minimum([_limit_at(judgement, value) for value in dampings.tolist()], onset)
    at = int(np.searchsorted(dampings, own))
    top = HEADROOM * max(each for each in (stability.stiffness, onset[at], limit[at]) if math.isfinite(each))
    drawn = figure(5.6, 9.0, *_region_words(judgement, float(limit[at]), float(onset[at]), units["stiffness"]))
    panel = drawn.subplots()
    stable, inside = (np.where(np.isfinite(values), values, 2.0 * top) for values in (onset, limit))
    _tint(panel, dampings, np.zeros_like(inside), inside, "#cfe9e0", "inside the limit", top)
    _tint(panel, dampings, inside, stable, "#dbe9f3", "stable at the nominal values only", top)
    _tint(panel, dampings, stable, np.maximum(stable, 2.0 * top), FAILS, "unstable", top)
    panel.plot(dampings, stable, color=BLUE, linewidth=1.8)
    panel.plot(dampings, inside, color=GREEN, linewidth=1.8)
    bounded = zip(dampings.tolist(), onset.tolist(), strict=True)
    passive = np.array([judgement.group.passive_limit(value, most) for value, most in bounded])
    if passive.any():
        condition = passivity_condition(stability)
        below = np.where(np.isfinite(passive), np.minimum(passive, stable), 2.0 * top)
        panel.plot(dampings, below, color=PURPLE, linewidth=1.4, linestyle="--", label=f"passive below{condition}")
    panel.set(xlim=(0.0, end), ylim=(0.0, top or 1.0))
    _mark(panel, own, (stability.stiffness, float(limit[at]), float(onset[at])), units["stiffness"])
    dress(panel, "", f"virtual damping [{units['damping']}]", f"virtual stiffness [{units['stiffness']}]")
    name_lines(drawn)
    return drawn


def _tint(panel: Axes, x: Array, low: Array, high: Array, tint: str, label: str, top: float) -> None:
    """Tint an area, and give it a name if it takes a considerable part of the panel."""
    share = float(np.mean(np.minimum(high, top) - np.minimum(low, top))) / (top or 1.0)
    panel.fill_between(x, low, high, color=tint, linewidth=0, label=label if share > NAMED_FROM else None)


def _region_words(judgement: Judgement, limit: float, onset: float, unit: str) -> tuple[str, list[str]]:
    """Return the title of the picture of a region, and the lines below it."""
    asked, stability = judgement.stability.stiffness or 0.0, judgement.stability
    where = "inside the limit" if asked <= limit else ("above the limit" if asked <= onset else "unstable")
    title = f"{judgement.scene.name}: {exactly(asked)} {unit} is {where}"
    parts = judgement.delays.get(judgement.axis)
    total = stability.delay_s if parts is None else parts.total  # with the torque loop, as in the text
    delay = f"period {in_unit(stability.period_s, 's')}, delay {in_unit(total, 's')}"
    margin = f"margin {margin}; " if (margin := margin_text(stability)) else ""
    known = CAVEATS.get(stability.limit.basis)
    return title, [f"{margin}{delay}{f'; {known}' if known else ''}"]


def _mark(panel: Axes, damping: float, marked: tuple[float, float, float], unit: str) -> None:
    """Mark scene, limit and onset at the damping of the scene."""
    asked, limit, onset = marked
    for value, colour, marker, label in (
        (onset, BLUE, "_", f"unstable above {rounded_limit(onset)} {unit}"),
        (limit, GREEN, "_", f"limit {rounded_limit(limit)} {unit}"),
        (asked, VERMILION, "o", f"scene {exactly(asked)} {unit}"),
    ):
        if math.isfinite(value):
            panel.plot([damping], [value], marker, color=colour, markersize=9, markeredgewidth=2.4, label=label,
                       zorder=4, clip_on=False)  # fmt: skip


def _limit_at(judgement: Judgement, damping: float) -> float:
    """Return the limit [N/m or N·m/rad] with this damping of the stiffest element; ∞ without a limit."""
    group = judgement.group
    own = float(getattr(group.stiffest, "damping", 0.0))
    return limit_drawn((group if damping == own else group._damped(damping)).stability)


# Picture of a sweep: a map over two parameters, or a line over one.

KINDS_OF_POINTS = {
    "passive": "#8fd0b5", "stable": "#a9cfe8", "limit-cycle": "#f2d58a", "unstable": "#eda98a", "done": "#a9cfe8",
    "False": "#a9cfe8", "True": "#eda98a", "tripped": "#eda98a", "refused": "#c9c9c9",
}  # fmt: skip
"""Colour of each kind of point; "True" and "False" are loops that grew and that did not."""
USUAL_COLUMNS = {"verdict": "verdict", "loop": "grew", "full": "error_rms"}
MOST_DRAWN = 200_000
"""Number of dots of a picture; more are thinned evenly."""
LARGEST_DOT = 8.0
"""Diameter of a dot [points]."""


def draw_sweep(found: Sweep, column: str | None = None) -> Figure:
    """Return a map of a column over the first two varied parameters, or a line over the only one.

    Refused points are grey. Raises UsageError for a sweep without a varied number, and for an unknown column.
    """
    chosen = USUAL_COLUMNS[found.engine] if column is None else column
    table = found.to_arrow([*found.names, "outcome", chosen])
    if chosen not in table.column_names:
        raise UsageError(
            f"no column {chosen}: nothing to draw; expected one of {', '.join(found.to_arrow().column_names)}"
        )
    columns = {name: np.array(table[name].to_pylist()) for name in table.column_names if name != chosen}
    names = [name for name in found.names if columns[name].dtype.kind in "if" and len(np.unique(columns[name])) > 1]
    if not names:
        raise UsageError("nothing to draw: no parameter with numbers is varied")
    values = table[chosen].to_pylist()
    numbers = all(isinstance(each, int | float) and not isinstance(each, bool) for each in values if each is not None)
    labels = None if numbers else _labels(found, chosen)
    refused = f", {found.outcomes['refused']} refused" * (found.outcomes["refused"] > 0)
    title = f"{'motion' if chosen == 'grew' else chosen} of {len(table)} points{refused}"
    drawn = figure(5.6, 9.0, title, [_others(found, names[:2])])
    panel = drawn.subplots()
    axes = [columns[name] for name in names[:2]]
    if len(names) == 1:
        _draw_line(panel, axes[0], values, columns["outcome"], labels)
        dress(panel, "", _named(found, names[0]), _named(found, chosen) if numbers else "")
    else:
        _draw_map(panel, axes[0], axes[1], values, columns["outcome"], labels, _named(found, chosen))
        dress(panel, "", *(_named(found, name) for name in names[:2]))
    if panel.get_legend_handles_labels()[0]:
        drawn.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False)
    return drawn


def _labels(found: Sweep, column: str) -> dict[str, str]:
    """Return the label of each kind of points."""
    motion = {"True": "motion grows", "False": "motion decays"} if column == "grew" else {}
    passive = "passive" if found.shipped_bench else "passive at the values of the rig"
    return {kind: kind for kind in KINDS_OF_POINTS} | {"passive": passive} | motion


def _named(found: Sweep, name: str) -> str:
    """Return the label of an axis: the parameter or figure with its unit."""
    unit = found.units.get(name)
    return f"{name} [{unit}]" if unit else name


def _others(found: Sweep, shown: list[str]) -> str:
    rest = [name for name in found.names if name not in shown]
    return f"engine {found.engine}" + (f"; all values of {', '.join(rest)} on top of each other" if rest else "")


def _spaced(panel: Axes, direction: str, values: Array) -> None:
    """Give an axis a logarithmic scale where the values are spaced so."""
    ends = np.unique(values)
    if len(ends) > 2 and ends[0] > 0.0 and ends[-1] / ends[0] > 30.0:
        getattr(panel, f"set_{direction}scale")("log" if np.median(ends) < 0.25 * ends[-1] else "linear")


def _draw_line(panel: Axes, x: Array, values: list[object], outcome: Array, labels: Mapping[str, str] | None) -> None:
    """Draw numbers as a line, and kinds, which have `labels`, as ticks."""
    order = np.argsort(x, kind="stable")
    _spaced(panel, "x", x)
    if labels is None:
        panel.plot(x[order], np.array(values, float)[order], ".-", color=BLUE, linewidth=1.2, markersize=4)
        return
    kinds, found = _kinds(values, outcome)
    for place, kind in enumerate(found):
        own = x[kinds == kind]
        panel.plot(own, np.full(len(own), place), "|", markersize=18, markeredgewidth=2, color=KINDS_OF_POINTS[kind])
    panel.set_yticks(range(len(found)), [labels[kind] for kind in found])
    panel.set_ylim(-0.6, len(found) - 0.4)


def _kinds(values: list[object], outcome: Array) -> tuple[NDArray[np.str_], list[str]]:
    """Return the kind of each point, and the kinds that there are in the order of the legend."""
    kinds = np.where(outcome == "refused", "refused", np.array([str(each) for each in values]))
    return kinds, [kind for kind in KINDS_OF_POINTS if (kinds == kind).any()]


def _draw_map(
    panel: Axes, x: Array, y: Array, values: list[object], outcome: Array, labels: Mapping[str, str] | None, name: str
) -> None:
    """Draw a grid as an area, and other points as dots, in colours of their numbers or of kinds, which have `labels`.

    `name` is the label of the numbers.
    """
    shown, look = list[str](), dict[str, Any](cmap="viridis")
    if labels is None:
        shades = np.array(values, float)
    else:
        kinds, shown = _kinds(values, outcome)
        shades = np.select([kinds == kind for kind in shown], [float(place) for place in range(len(shown))])
        colours = ListedColormap([KINDS_OF_POINTS[kind] for kind in shown])
        look = {"cmap": colours, "vmin": -0.5, "vmax": len(shown) - 0.5}
    for direction, each in (("x", x), ("y", y)):
        _spaced(panel, direction, each)
    across, upward = np.unique(x), np.unique(y)
    if len(across) * len(upward) == len(x):
        area = np.full((len(upward), len(across)), math.nan)
        area[np.searchsorted(upward, y), np.searchsorted(across, x)] = shades
        panel.set_facecolor(KINDS_OF_POINTS["refused"])
        drawn: Any = panel.pcolormesh(across, upward, area, shading="nearest", rasterized=True, **look)
    else:
        kept = slice(None, None, max(len(x) // MOST_DRAWN, 1))
        size = min(max(200.0 / math.sqrt(len(x)), 1.2), LARGEST_DOT)
        drawn = panel.scatter(x[kept], y[kept], c=shades[kept], s=size**2, linewidths=0.0, **look)
    if labels is None:
        panel.figure.colorbar(drawn, ax=panel, label=name)
        return
    for kind in shown:
        panel.plot([], [], "s", color=KINDS_OF_POINTS[kind], label=labels[kind])


# Picture of a measured bench: its motion, the prediction error, and the response from torque to position.

SEGMENTS = 8
"""Number of half-overlapping segments of a record, over which spectra are averaged."""
BALANCE_POINTS = 200
"""Points of the measured friction and load; each is a mean."""
COHERENT = 0.9
"""Least coherence of a point that is drawn."""


def draw_identified(found: IdentifiedBench) -> Figure:
    """Return a figure of motion, prediction error, Bode plot, friction over speed, and load over travel.

    Raises ValueError where dynamics were skipped.
    """
    if (fit := found.fit) is None:
        raise ValueError("dynamics were skipped: there is no motion to draw")
    values, (_, used, unused) = fit.values, found.records
    told = [
        f"damping {interval_text(values['viscous_damping'])}, friction {interval_text(values['coulomb_friction'])}, "
        f"delay and lag {interval_text(values['delay_and_lag'])}"
    ]
    drawn = figure(13.0, 11.0, f"Inertia {interval_text(values['inertia'])}", told)
    panels = drawn.subplots(4, 2, height_ratios=(1.0, 1.0, 1.0, 0.5))
    (motion, error), (size, friction), (phase, travel), (shared, blank) = panels
    blank.set_axis_off()
    begin = 0.0
    for record, errors, colour, label in (
        (used, prediction_errors(fit.model, used), BLUE, "used in the fit"),
        (unused, errors_after(fit.model, used, unused), ORANGE, "predicted only"),
    ):
        times: Array = begin + record.period * np.arange(len(record.positions), dtype=float)
        begin = float(times[-1])
        motion.plot(*thin(times, np.array(record.positions)), color=colour, linewidth=1.2, label=label)
        error.plot(*thin(times[-len(errors) :], errors), color=colour, linewidth=0.8)
    dress(motion, "motion of the motor", "time [s]", "angle [rad]")
    dress(error, "prediction error", "time [s]", "error [counts]")
    frequencies, response, coherence = measured_response(used)
    good = coherence > COHERENT
    grid = np.geomspace(frequencies.min(), frequencies.max(), 200) if len(frequencies) else np.array([1.0, 10.0])
    model = modelled_response(fit.model, used.period, grid)
    size.set_yscale("log")
    for each in (size, phase, shared):
        span_frequencies(each, grid)
    size.plot(grid, np.abs(model), color=GREY, linewidth=1.6, label="model")
    size.plot(frequencies[good], np.abs(response[good]), ".", color=BLUE, label="measured")
    phase.plot(grid, _degrees(model), color=GREY, linewidth=1.6)
    phase.plot(frequencies[good], _degrees(response[good]), ".", color=BLUE)
    shared.plot(frequencies, coherence, ".", color=BLUE)
    dress(size, f"from torque to angle, where the coherence is above {COHERENT}", "", "angle / torque [rad/(N·m)]")
    dress(phase, "", "", "phase [degrees]")
    dress(shared, "", "frequency [Hz]", "coherence")
    _draw_balance(friction, travel, fit.model, used)
    name_lines(drawn, [motion, size])
    return drawn


def span_frequencies(panel: Axes, shown: Array) -> None:
    """Give a panel a logarithmic axis over these frequencies [Hz], with numbers at 1 and 3 of each decade."""
    panel.set(xscale="log", xlim=(min(3.0, shown.min()), max(100.0, shown.max())))
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))


def _draw_balance(friction: Axes, travel: Axes, model: ShaftModel, record: ShaftRecord) -> None:
    """Draw friction over speed and load over travel, measured against the model."""
    positions, moved, resisting, acting = torque_balance(model, record)
    speeds = np.linspace(moved.min(), moved.max(), 400)
    places = np.linspace(positions.min(), positions.max(), 400)
    curve = np.sign(speeds) * model.friction_at(speeds, np) + model.damping * speeds
    for axes, x, y, grid, known in (
        (friction, moved, resisting, speeds, curve),
        (travel, positions, acting, places, np.broadcast_to(model.torque_at(places, 0.0, np), places.shape)),
    ):
        order = np.argsort(x)
        parts = [each for each in np.array_split(order, BALANCE_POINTS) if len(each)]
        axes.plot([x[each].mean() for each in parts], [y[each].mean() for each in parts], ".", color=BLUE)
        axes.plot(grid, known, color=GREY, linewidth=1.6)
    dress(friction, "friction and damping", "speed [rad/s]", "torque [N·m]")
    dress(travel, "load and cogging", "angle [rad]", "torque [N·m]")


def _degrees(response: Array) -> Array:
    """Return the phase between −360° and 0°."""
    return np.asarray(-np.mod(-np.degrees(np.angle(response)), 360.0))


def measured_response(record: ShaftRecord) -> tuple[Array, Array, Array]:
    """Return frequencies [Hz], the response from torque to angle, and the coherence of both, where there is torque."""
    length = 2 * len(record.positions) // (SEGMENTS + 1)
    window = np.hanning(length)
    torque, angle, both = (np.zeros(length // 2 + 1, dtype) for dtype in (float, float, complex))
    times = np.arange(length)
    for number in range(SEGMENTS):
        here = slice(number * length // 2, number * length // 2 + length)
        parts = [np.array(each[here]) for each in (record.torques, record.positions)]
        # Without its mean and slope.
        u, y = (np.fft.rfft(window * (part - np.polyval(np.polyfit(times, part, 1), times))) for part in parts)
        torque, angle, both = torque + abs(u) ** 2, angle + abs(y) ** 2, both + y * np.conj(u)
    frequencies = np.fft.rfftfreq(length, record.period)
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.nan_to_num(abs(both) ** 2 / (torque * angle))
        response = both / torque
    # A line of the window leaks into its neighbours; the slowest ones are the slow motion, where friction rules.
    driven = (torque > 0.01 * torque.max()) & (frequencies > 3.0)
    return frequencies[driven], response[driven], coherence[driven]


def modelled_response(model: ShaftModel, period: float, frequencies: Array) -> Array:
    """Return the response of the shaft without Coulomb friction, with the hold of the set-points."""
    s = 2j * math.pi * frequencies
    hold = (1.0 - np.exp(-s * period)) / (s * period)
    shaft = 1.0 / (s * (model.inertia * s + model.damping))
    return np.asarray(hold * np.exp(-s * model.delay) / (1.0 + s * model.lag) * shaft)

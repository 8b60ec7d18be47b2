"""Pictures of stability regions, models, responses and estimates."""

import math
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from haptic_fieldbus.api.estimation import Estimation
from haptic_fieldbus.api.model import EnvironmentModel, poles_along, poles_of, step_growth
from haptic_fieldbus.api.open_loop import Response
from haptic_fieldbus.api.stability_limits import Judgement
from haptic_fieldbus.assessing.result import Array
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.report.analysis_texts import estimate_lines
from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION, line, thin
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


def plot_model(model: EnvironmentModel, title: str, path: Path) -> None:
    """Draw a model with virtual states into a file, whose suffix tells the format.

    Raises OSError when the file cannot be written.
    """
    figure = Figure(figsize=(13.0, 6.4), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{title} · poles by method", size=13, weight="bold", color=INK, x=0.01, ha="left")
    plane, growth = figure.subplots(1, 2)
    periods = _periods(model)
    _draw_plane(plane, model, periods)
    _draw_growth(growth, model, periods)
    figure.legend(*growth.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path)


def _periods(model: EnvironmentModel) -> Matrix:
    """Return periods [s] from far below to far above the time constant of the fastest virtual state, (PATHS,)."""
    fastest = float(np.abs(poles_of(model.integrated.a)).max()) or 1.0 / model.period
    low, high = min(FASTEST / fastest, model.period), max(SLOWEST / fastest, model.period)
    return np.geomspace(low, high, PATHS)


def _draw_plane(panel: Axes, model: EnvironmentModel, periods: Matrix) -> None:
    turn = np.exp(2j * math.pi * np.linspace(0.0, 1.0, 361))
    panel.fill(turn.real, turn.imag, color="#f2f5f7", zorder=0)
    panel.plot(turn.real, turn.imag, color=GREY, linewidth=1.0)
    even = np.linspace(periods[0], periods[-1], 2 * PATHS)
    for method in METHODS:
        poles = np.array([*poles_along(model.integrated, even, method)])
        if len(poles):
            look = line(method, marked=False) | {"linestyle": "none", "marker": ".", "markersize": 2.2, "alpha": 0.6}
            panel.plot(poles.real.ravel(), poles.imag.ravel(), **look)
        for each in poles_along(model.integrated, np.array([model.period]), method):
            panel.plot(each.real, each.imag, **line(method) | {"linestyle": "none"}, zorder=3)
    panel.set(xlim=(-VIEW, VIEW), ylim=(-VIEW, VIEW), aspect="equal", xlabel="Re z", ylabel="Im z")
    panel.set_title(f"z-plane: markers at {in_unit(model.period, 's')}, paths over all periods", loc="left", size=10.5)
    panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)


def _draw_growth(panel: Axes, model: EnvironmentModel, periods: Matrix) -> None:
    for method, at_period in model.growth.items():
        curve = [step_growth(model.integrated, period, method) for period in periods.tolist()]
        told = "no step" if at_period is None else rounded(at_period, 9)
        values = np.array([np.nan if value is None else value for value in curve])
        panel.plot(1e3 * periods, values, **line(method, f"{method}: {told}", marked=False))
        if at_period is not None:
            look = line(method)
            panel.plot([1e3 * model.period], [at_period], **look | {"linestyle": "none", "label": "_"})
    panel.axvline(1e3 * model.period, color=GREY, linewidth=1.0, linestyle=":")
    panel.set(xscale="log", ylim=(0.0, GROWN), xlabel="period [ms]", ylabel="spectral radius, largest |z| [1]")
    panel.set_title(
        f"spectral radius per step; below, by method, at {in_unit(model.period, 's')}", loc="left", size=10.5
    )
    panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)
    panel.spines[["top", "right"]].set_visible(False)
    panel.margins(x=0)


# Picture of an open-loop response: positions, velocities and force over time, as in the figures of the lecture.

COLOURS = (ORANGE, GREEN, PURPLE, SKY)


def plot_response(response: Response, title: str, path: Path) -> None:
    """Draw a response into a file, whose suffix tells the format; raises OSError when it cannot be written."""
    velocities = [name for name in response.states if name.endswith("velocity")]
    figure = Figure(figsize=(10.0, 7.2 if velocities else 5.2), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    method = f" · {response.method}" if response.method else ""
    figure.suptitle(f"{title}{method}", size=13, weight="bold", color=INK, x=0.01, ha="left")
    panels = list(figure.subplots(3 if velocities else 2, 1, sharex=True))
    length, effort = response.workspace.length_unit, response.workspace.effort_unit
    _panel(
        panels[0],
        response,
        [n for n in response.states if n not in velocities],
        f"position [{length}]",
        response.position,
    )
    if velocities:
        _panel(panels[1], response, velocities, f"velocity [{length}/s]", None)
    panels[-1].plot(*thin(response.time, response.force), color=BLUE, linewidth=1.6)
    panels[-1].set_ylabel(f"{response.workspace.effort_name} on the puck [{effort}]")
    panels[-1].set_xlabel("time [s]")
    for panel in panels:
        panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0)
    figure.savefig(path)


def _panel(panel: Axes, response: Response, names: list[str], label: str, puck: NDArray[np.float64] | None) -> None:
    """Draw the named virtual states, and the puck unless it is None."""
    if puck is not None:
        panel.plot(*thin(response.time, puck), color=BLUE, linewidth=1.6, label="puck")
    for name, colour in zip(names, cycle(COLOURS), strict=False):
        panel.plot(*thin(response.time, response.states[name]), color=colour, linewidth=1.6, label=f"virtual {name}")
    panel.set_ylabel(label)
    panel.legend(frameon=False, fontsize=9, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)


# Picture of an estimate: the signal above, what the estimator makes of it below.

UNITS = {"position": "m or rad", "velocity": "m/s or rad/s"}
TOLD = ("noise", "delay", "drift")


def plot_estimate(found: Estimation, file: str, path: Path) -> None:
    """Draw an estimate into a file, whose suffix tells the format; raises OSError when it cannot be written."""
    figure = Figure(figsize=(10.0, 6.4), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{file} · {found.estimator}", size=13, weight="bold", color=INK, x=0.01, ha="left")
    panels = figure.subplots(2, 1, sharex=True)
    signal, estimate = found.signal, found.estimate
    drawn = ((signal.quantity, signal.values, BLUE), (f"estimated {estimate.quantity}", estimate.values, ORANGE))
    for panel, (name, values, colour) in zip(panels, drawn, strict=True):
        panel.plot(*thin(signal.times, values), color=colour, linewidth=1.4)
        panel.set_ylabel(f"{name} [{UNITS[name.split()[-1]]}]")
        panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0)
    panels[-1].set_xlabel("time [s]")
    told = dict(estimate_lines(found, file))
    panels[-1].text(
        0.0, -0.24, "\n".join(f"{key}: {told[key]}" for key in TOLD), transform=panels[-1].transAxes, size=9, va="top"
    )
    figure.savefig(path)


# Picture of the stable and the passive region of a loop over virtual stiffness and damping.

POINTS = 48
"""Number of dampings at which limits are computed for each panel."""


def plot_region(judgement: Judgement, path: Path) -> None:
    """Draw the limits of stiffness over damping: on the left the whole region, on the right around the scene.

    The suffix of the file tells the format. Raises UsageError when no element of the scene has both parameters, and
    OSError when the file cannot be written.
    """
    element = judgement.group.stiffest
    if element is None or not hasattr(element, "damping"):
        raise UsageError("--plot needs an element with stiffness and damping; this scene has none")
    stability = judgement.stability
    # The last term keeps the panel from having no width when neither device nor scene has damping.
    near = 4.0 * max(stability.plant.damping, float(element.damping), 1e-9 * judgement.group.largest_damping)
    figure = Figure(figsize=(11.0, 5.0), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(
        f"{judgement.scene.name}: period {rounded(1e3 * stability.period_s)} ms, "
        f"delay {rounded(1e3 * stability.delay_s)} ms",
        size=12, weight="bold", color=INK, x=0.01, ha="left",
    )  # fmt: skip
    panels = figure.subplots(1, 2)
    for panel, end in zip(panels, (_end(judgement), near), strict=True):
        _draw(panel, judgement, end)
        if stability.stiffness is not None:
            panel.plot(
                [float(element.damping)], [stability.stiffness], "o", color=VERMILION, label=stability.verdict.value
            )
    panels[0].set_title("the whole region", loc="left", size=10, color=INK)
    panels[1].set_title("around the scene", loc="left", size=10, color=INK)
    panels[1].legend(frameon=False)
    figure.savefig(path)


def _draw(panel: Axes, judgement: Judgement, end: float) -> None:
    """Draw both limits for dampings from 0 to `end`."""
    units = parameter_units(judgement.workspace)
    damping, stable, passive = _limits(judgement, end)
    panel.fill_between(damping, stable, color=BLUE, alpha=0.16, linewidth=0)
    panel.plot(damping, stable, color=BLUE, linewidth=1.8, label="stable below")
    panel.fill_between(damping, passive, color=GREEN, alpha=0.25, linewidth=0)
    panel.plot(damping, passive, color=GREEN, linewidth=1.8, label="passive with any hand")
    panel.set_xlabel(f"virtual damping [{units['damping']}]")
    panel.set_ylabel(f"virtual stiffness [{units['stiffness']}]")
    panel.margins(x=0)
    panel.set_ylim(bottom=0.0)
    panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)
    panel.spines[["top", "right"]].set_visible(False)


def _limits(judgement: Judgement, end: float) -> tuple[Array, Array, Array]:
    """Return dampings from 0 to `end`, and for each the limits of stability and of passivity, each `(POINTS,)`."""

    def both(damping: float) -> tuple[float, float]:
        stable = _drawn(judgement.group.limit(damping))
        return stable, min(stable, judgement.group.passive_limit(damping, stable))

    dampings = np.linspace(0.0, end, POINTS)
    limits = np.array([both(damping) for damping in dampings.tolist()])
    return dampings, limits[:, 0], limits[:, 1]


def _drawn(limit: float) -> float:
    """Return the limit; 0 for an infinite one, which cannot be drawn."""
    return limit if math.isfinite(limit) else 0.0


def _end(judgement: Judgement) -> float:
    """Return a damping [N·s/m or N·m·s/rad] with which no stiffness is stable; at most about twice the largest one."""
    scale = judgement.group.largest_damping
    value = 1e-3 * scale
    while value < 2.0 * scale and judgement.group.limit(value):
        value *= math.sqrt(2.0)
    return value

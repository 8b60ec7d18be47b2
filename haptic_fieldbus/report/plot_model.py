"""Picture of a model: the poles of each method on the z-plane, and the growth of a free motion in a step.

On the z-plane each method draws a path from 1, where the period is 0, over its poles at the chosen period, which have
the marker. Poles outside of the unit circle grow.
"""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from haptic_fieldbus.api.model import EnvironmentModel, Poles, poles_along, poles_of, step_growth
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.report.drawing import GREY, INK
from haptic_fieldbus.report.looks import line

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
        _draw_poles(panel, method, [*poles_along(model.integrated, np.array([model.period]), method)])
    panel.set(xlim=(-VIEW, VIEW), ylim=(-VIEW, VIEW), aspect="equal", xlabel="Re z", ylabel="Im z")
    panel.set_title(f"z-plane: markers at {in_unit(model.period, 's')}, paths over all periods", loc="left", size=10.5)
    panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)


def _draw_poles(panel: Axes, method: str, poles: list[Poles]) -> None:
    for each in poles:
        panel.plot(each.real, each.imag, **line(method) | {"linestyle": "none"}, zorder=3)


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
    panel.set(xscale="log", ylim=(0.0, GROWN), xlabel="period [ms]", ylabel="growth per step, largest |z| [1]")
    panel.set_title(
        f"growth of a free motion in a step; below, by method, at {in_unit(model.period, 's')}", loc="left", size=10.5
    )
    panel.grid(visible=True, color="#e4e4e4", linewidth=0.8)
    panel.spines[["top", "right"]].set_visible(False)
    panel.margins(x=0)

"""Picture of the stable and the passive region of a loop over virtual stiffness and damping."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from haptic_fieldbus.api.judging import Judgement
from haptic_fieldbus.assessing.result import Array
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.report.drawing import BLUE, GREEN, INK, VERMILION
from haptic_fieldbus.report.words import parameter_units

POINTS = 48
"""Number of dampings at which limits are computed for each panel."""


def plot_region(judgement: Judgement, path: Path) -> None:
    """Draw the limits of stiffness over damping: on the left the whole region, on the right around the scene.

    The suffix of the file tells the format. Raises UsageError when no element of the scene has both parameters, and
    OSError when the file cannot be written.
    """
    element = judgement.group.stiffest
    if element is None or not hasattr(element, "damping"):
        raise UsageError("--plot draws stiffness over damping; this scene has no element with both")
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
    panel.plot(damping, passive, color=GREEN, linewidth=1.8, label="passive below, with any hand")
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

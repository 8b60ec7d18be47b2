"""Picture of an open-loop response: positions, velocities and force over time, as in the figures of the lecture."""

from itertools import cycle
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from haptic_fieldbus.api.open_loop import Array, Response
from haptic_fieldbus.report.drawing import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, thin

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


def _panel(panel: Axes, response: Response, names: list[str], label: str, puck: Array | None) -> None:
    """Draw the named virtual states, and the puck unless it is None."""
    if puck is not None:
        panel.plot(*thin(response.time, puck), color=BLUE, linewidth=1.6, label="puck")
    for name, colour in zip(names, cycle(COLOURS), strict=False):
        panel.plot(*thin(response.time, response.states[name]), color=colour, linewidth=1.6, label=f"virtual {name}")
    panel.set_ylabel(label)
    panel.legend(frameon=False, fontsize=9, ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)

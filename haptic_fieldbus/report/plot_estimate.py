"""Picture of an estimate: the signal above, what the estimator makes of it below."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from haptic_fieldbus.api.estimation import Estimation
from haptic_fieldbus.report.drawing import BLUE, INK, ORANGE, thin
from haptic_fieldbus.report.estimates import estimate_lines

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

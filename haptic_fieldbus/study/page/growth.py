"""Section on the growth of the error along a run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.report.drawing import FELT, GREY, INK, card_panel, dress, figure, legend, line, look_of, note, svg
from haptic_fieldbus.study.measure import loops
from haptic_fieldbus.study.measure.loops import Growth
from haptic_fieldbus.study.page.html import CARD, Card, Cell, Context, Section, paragraph, picture, table

QUICK, FULL = 10**5, 10**7
"""Steps of each run."""
LOWEST, HIGHEST = 1e-16, 1e2
"""Ends of the frame, from the rounding of doubles to errors far larger than the force itself."""
APART = 0.075
"""Least distance of the names of two curves, as a share of the height."""

EXPLAINED = """The puck is held, and the virtual mass (200 N/m, 0.5 kg) oscillates behind it at 1 kHz for the given
number of steps. Each step is a call of the step that the loop runs. The exact force is k·A·cos ωt. Left: the
largest error within the last half period. Right: the drift of the energy, which should be 0. Forward Euler grows at
<i>every</i> step size, backward Euler decays. Symplectic methods keep the energy within a band and lose only phase,
in proportion to time; the exact steps lose only rounding errors."""


def growth_section(context: Context) -> Section:
    """Measure all methods and return their section."""
    total = QUICK if context.quick else FULL
    told = f"{rounded(total)} steps of "
    found = [
        loops.free_swing(method, total) for method in context.with_progress(METHODS, lambda method: f"{told}{method}")
    ]
    document = svg(draw(found))
    caption = (
        f"{rounded(total)} steps are {rounded(total * loops.PERIOD)} s of simulated time. Values outside the frame "
        "are drawn at its edge; × marks the first value that is not finite."
    )
    body = [paragraph(EXPLAINED), picture("growth", document, caption), growth_table(found)]
    short = svg(draw_card(found))
    return Section(
        "growth",
        "Error along the run",
        "".join(body),
        (_finding(found, total),),
        {"growth": document, "growth-force": short},
        [asdict(each) for each in found],
        Card("How does the error grow along a run?", picture("growth-force", short, caption)),
    )


def draw(swings: Sequence[Growth]) -> Figure:
    """Return a figure of the force's error and of the energy's drift over the steps."""
    drawn = figure(4.9)
    left, right = drawn.subplots(1, 2)
    for swing in swings:
        _curve(left, swing, swing.error)
        _curve(right, swing, swing.energy)
    left.axhline(FELT, color=GREY, linewidth=1.0, linestyle=(0, (5, 4)))
    note(left, FELT, "noticeable above", right=False, size=8.5)
    dress(left, "error of the force", "steps [1]", "largest error over amplitude [1]")
    dress(right, "drift of the energy", "steps [1]", "|energy / energy at the start − 1| [1]")
    legend(drawn, {swing.method: swing.method for swing in swings}, ncols=5)
    return drawn


def draw_card(swings: Sequence[Growth]) -> Figure:
    """Return a small figure of the force's error, its curves named at their ends."""
    drawn = figure(*CARD)
    panel = drawn.subplots()
    for swing in swings:
        panel.loglog(swing.steps, np.clip(swing.error, LOWEST, HIGHEST), **line(swing.method, marked=False))
    panel.axhline(FELT, color=INK, linewidth=0.9, linestyle=(0, (5, 4)))
    note(panel, FELT, "noticeable above", right=False)
    panel.set_ylim(LOWEST, HIGHEST)
    panel.set_xlim(swings[0].steps[0], swings[0].steps[-1])
    card_panel(panel, "", "steps of the loop [1]", "largest error over amplitude [1]")
    _name_ends(panel, {swing.method: min(max(swing.error[-1], LOWEST), HIGHEST) for swing in swings})
    return drawn


def _name_ends(panel: Axes, ends: Mapping[str, float]) -> None:
    """Name curves at their ends, from the top down; names that would overlap are moved apart."""
    scale = math.log10(HIGHEST / LOWEST)
    places = {name: math.log10(end / LOWEST) / scale for name, end in sorted(ends.items(), key=lambda each: -each[1])}
    lowest_free = 1.0 + APART
    for left, (name, place) in enumerate(places.items(), 1 - len(places)):
        lowest_free = max(min(place, lowest_free - APART), -left * APART)
        colour = look_of(name).colour
        arrow = {"arrowstyle": "-", "relpos": (0.0, 0.5), "color": colour, "linewidth": 0.6}
        panel.annotate(name, (1.0, place), (1.06, lowest_free), xycoords="axes fraction", textcoords="axes fraction",
                       size=7.2, color=colour, va="center", annotation_clip=False, arrowprops=arrow)  # fmt: skip


def _curve(panel: Axes, swing: Growth, values: Sequence[float]) -> None:
    """Draw one method; values outside the frame are drawn at its edge, × marks where numbers overflowed."""
    panel.loglog(swing.steps, np.clip(np.abs(values), LOWEST, HIGHEST), **line(swing.method))
    if swing.diverged_at is not None:
        panel.loglog([swing.diverged_at], [HIGHEST], linestyle="none", marker="x", markersize=9, markeredgewidth=2.0,
                     color=look_of(swing.method).colour, clip_on=False)  # fmt: skip
    panel.set_ylim(LOWEST, HIGHEST)


def growth_table(swings: Sequence[Growth]) -> str:
    """Return a table of the last errors and the energy drifts."""
    rows = [
        [
            swing.method,
            Cell(f"by step {swing.diverged_at}", "bad") if swing.diverged_at is not None else "no",
            *(swing.error[-1], swing.energy[-1], max(map(abs, swing.energy))),
        ]
        for swing in swings
    ]
    headings = ("method", "overflowed", "last error / amplitude", "last energy drift", "largest energy drift")
    return table(headings, rows)


def _finding(swings: Sequence[Growth], total: int) -> str:
    by_name = {swing.method: swing for swing in swings}
    best, leapfrog, euler = by_name["exact-foh"], by_name["semi-implicit"], by_name["forward-euler"]
    lost = "overflows" if euler.diverged_at is not None else f"is {rounded(euler.error[-1], 2)} times the force"
    return (
        f"After {rounded(total)} steps the force error of an oscillating mass is {rounded(best.error[-1], 2)} of its "
        f"force with <code>exact-foh</code> and {percent(leapfrog.error[-1])} with <code>semi-implicit</code> (phase "
        f"only); with <code>forward-euler</code> it {lost}."
    )

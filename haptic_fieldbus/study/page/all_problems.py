"""Error against cost of all problems in one figure: the first thing that the page shows."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.report.drawing import BLUE, FELT, GREY, INK, ORANGE
from haptic_fieldbus.study.measure.problems import problems
from haptic_fieldbus.study.measure.work_precision import FAILED, Set, at_fixed_period, computing, has_failed
from haptic_fieldbus.study.page.style import WIDE_CARD, card_panel, figure, line, look_of, note

LOWEST, TOP = 1e-7, 300.0
"""Ends of the frame: errors as a share of the largest force."""
BEST, SIMPLE = "exact-foh", "forward-euler"
LOOPS = {
    "wall-in-hand": (GREY, "wall"),
    "damped-wall-in-hand": (ORANGE, f"damped wall,\n{len(ESTIMATORS)} estimators"),
    "sprung-mass-in-hand": (BLUE, f"sprung mass,\n{len(METHODS)} integrators"),
}
"""Colour and label of each loop in a hand."""

TOLD = """Error of every method over its cost: on the left the median over the problems, thick, and each problem, faint;
on the right the loops in a hand. Shortest of 25 repeats in turn; × marks a median that failed."""

Curve = list[tuple[float, float]]
"""Computing time for a second [µs] and error as a share of the largest force; ∞ for a run that failed."""


def curve(runs: Set) -> Curve:
    """Return the runs of a method on one problem."""
    return [(computing(p), math.inf if has_failed(p, runs.peak) else (p.error_rms or 0.0) / runs.peak)
            for p in runs.points]  # fmt: skip


def median_curve(curves: Sequence[Curve]) -> Curve:
    """Return the median of costs and errors over problems, step size by step size; a failed run is the worst."""
    return [(float(np.median([cost for cost, _ in runs])), float(np.median([error for _, error in runs])))
            for runs in zip(*curves, strict=True)]  # fmt: skip


def draw(sets_of_problems: Sequence[Sequence[Set]]) -> Figure:
    """Return a figure with a panel for the steps by themselves, and one for the loops in a hand."""
    drawn = figure(*WIDE_CARD)
    alone, loops = drawn.subplots(1, 2, sharey=True, width_ratios=[1.25, 1.0])
    known = [sets for sets in sets_of_problems if sets[0].problem in problems()]
    for each in known[0] if known else ():
        _method(alone, each.method, [curve(runs) for sets in known for runs in sets if runs.method == each.method])
    for sets in sets_of_problems:
        colour, _ = LOOPS.get(sets[0].problem, ("", ""))
        for runs in sets if colour else ():
            _line(loops, curve(runs), color=colour, linewidth=0.9, marker="o", markersize=2.0)
    for panel in (alone, loops):
        _frame(panel)
    card_panel(alone, f"step alone: median of {len(known)} problems", "", "rms error / largest force")
    card_panel(loops, "in the loop, held by a hand", "", "")
    drawn.supxlabel("computing time for one second of simulated time [µs]", size=8)
    _legend(drawn, [each.method for each in known[0]] if known else [])
    return drawn


def _method(panel: Axes, method: str, curves: Sequence[Curve]) -> None:
    """Draw a method: faint on each problem, and its median over all."""
    look = look_of(method)
    for each in curves:
        _line(panel, each, color=look.colour, linewidth=0.5, alpha=0.35)
    middle = median_curve(curves)
    _line(panel, middle, **{**line(method), "markersize": 0.7 * look.size})
    failed = [cost for cost, error in middle if error > FAILED]
    panel.plot(failed, [math.sqrt(FAILED * TOP)] * len(failed), linestyle="none", marker="x", markersize=4,
               color=look.colour)  # fmt: skip


def _line(panel: Axes, points: Curve, **looks: object) -> None:
    """Draw the runs that did not fail; what is below the frame is drawn at its edge."""
    good = [(cost, max(error, LOWEST)) for cost, error in points if error <= FAILED]
    panel.loglog([cost for cost, _ in good], [error for _, error in good], **looks)


def _frame(panel: Axes) -> None:
    """Scale the axes; mark what a hand cannot tell, and where runs count as failed."""
    panel.set_ylim(LOWEST, TOP)
    panel.axhspan(FAILED, TOP, color="#fbeee6", linewidth=0, zorder=0)
    panel.axhline(FELT, color=INK, linewidth=0.9, linestyle=(0, (5, 4)), zorder=1)
    note(panel, FAILED, "failed")
    note(panel, FELT, "a hand feels it from here up")


def _legend(drawn: Figure, methods: Sequence[str]) -> None:
    """Put the methods, and the loops, to the right of the panels."""
    handles = [Line2D([], [], **{**line(method), "markersize": 0.7 * look_of(method).size}) for method in methods]
    handles += [Line2D([], [], color=colour, marker="o", markersize=2.0, label=f"in a hand: {label}")
                for colour, label in LOOPS.values()]  # fmt: skip
    drawn.legend(handles=handles, loc="outside right center", frameon=False, fontsize=7.2, labelspacing=0.32,
                 handlelength=1.9)  # fmt: skip


def problems_finding(sets_of_problems: Sequence[Sequence[Set]]) -> str:
    """Return how the best and the simplest method err and compare in cost near 1 kHz; empty without all problems."""
    known = [{runs.method: runs for runs in sets} for sets in sets_of_problems if sets[0].problem in problems()]
    loops = [runs for sets in sets_of_problems if sets[0].problem == "sprung-mass-in-hand" for runs in sets]
    if not known or not loops:
        return ""
    best, simple = (float(np.median([_share(of[name]) for of in known])) for name in (BEST, SIMPLE))
    times = float(np.median([of[BEST].cost.ratio(of[SIMPLE].cost)[1] for of in known]))
    worst = max(_share(runs) for runs in loops)
    period = at_fixed_period(loops[0]).period_s
    return (
        f"At {rounded(1e3 * period, 2)} ms <code>{BEST}</code> is off by {percent(best)} of the largest force, "
        f"<code>{SIMPLE}</code> by {percent(simple)}, for {times:.2f} times the computing (medians of {len(known)} "
        f"problems); in the loop all are of first order, off by up to {percent(worst)}."
    )


def _share(runs: Set) -> float:
    point = at_fixed_period(runs)
    return math.inf if has_failed(point, runs.peak) else (point.error_rms or 0.0) / runs.peak

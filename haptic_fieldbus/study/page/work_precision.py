"""Sections on error against computing time, and on how errors of force and energy grow with the number of steps."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, astuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.numerics.estimators import ESTIMATORS
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.report import drawing
from haptic_fieldbus.study.measure import loops, work_precision
from haptic_fieldbus.study.measure.loops import Contact, Growth
from haptic_fieldbus.study.measure.problems import Problem, problems, step_counts
from haptic_fieldbus.study.measure.work_precision import FAILED, Set, at_fixed_period, computing, has_failed, step_limit
from haptic_fieldbus.study.page import html

# Error against cost of all problems in one figure: the first thing that the page shows.

LOWEST, TOP = 1e-7, 300.0
"""Ends of the frame: errors as a share of the largest force."""
BEST, SIMPLE = "exact-foh", "forward-euler"
LOOPS = {
    "wall-in-hand": (drawing.GREY, "wall"),
    "damped-wall-in-hand": (drawing.ORANGE, f"damped wall,\n{len(ESTIMATORS)} estimators"),
    "sprung-mass-in-hand": (drawing.BLUE, f"sprung mass,\n{len(METHODS)} integrators"),
}
"""Colour and label of each loop in a hand."""

TOLD = """Error over cost of every method. Left: median over the problems (thick) and each problem (faint). Right:
loops with a hand. Shortest of 25 repeats in turn; × marks a failed median."""

Curve = list[tuple[float, float]]
"""Computing time for a second [µs] and error as a share of the largest force; ∞ for a run that failed."""


def curve(runs: Set) -> Curve:
    """Return the runs of a method on one problem."""
    return [(computing(p), math.inf if has_failed(p, runs.peak) else (p.error_rms or 0.0) / runs.peak)
            for p in runs.points]  # fmt: skip


def median_curve(curves: Sequence[Curve]) -> Curve:
    """Return the median of costs and errors over problems, for each step size; a failed run counts as the worst."""
    return [(float(np.median([cost for cost, _ in runs])), float(np.median([error for _, error in runs])))
            for runs in zip(*curves, strict=True)]  # fmt: skip


def draw_all(sets_of_problems: Sequence[Sequence[Set]]) -> Figure:
    """Return a figure with a panel for the steps by themselves, and one for the loops in a hand."""
    drawn = drawing.figure(*html.WIDE_CARD)
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
    drawing.card_panel(alone, f"step alone: median of {len(known)} problems", "", "rms error over largest force [1]")
    drawing.card_panel(loops, "in the loop, held by a hand", "", "")
    drawn.supxlabel("computing time for one second of simulated time [µs]", size=8)
    _legend(drawn, [each.method for each in known[0]] if known else [])
    return drawn


def _method(panel: Axes, method: str, curves: Sequence[Curve]) -> None:
    """Draw a method: faint on each problem, and its median over all."""
    look = drawing.look_of(method)
    for each in curves:
        _line(panel, each, color=look.colour, linewidth=0.5, alpha=0.35)
    middle = median_curve(curves)
    _line(panel, middle, **{**drawing.line(method), "markersize": 0.7 * look.size})
    failed = [cost for cost, error in middle if error > FAILED]
    panel.plot(failed, [math.sqrt(FAILED * TOP)] * len(failed), linestyle="none", marker="x", markersize=4,
               color=look.colour)  # fmt: skip


def _line(panel: Axes, points: Curve, **looks: object) -> None:
    """Draw the runs that did not fail; points below the frame are drawn at its edge."""
    good = [(cost, max(error, LOWEST)) for cost, error in points if error <= FAILED]
    panel.loglog([cost for cost, _ in good], [error for _, error in good], **looks)


def _frame(panel: Axes) -> None:
    """Scale the axes; mark imperceptible errors and the zone of failures."""
    panel.set_ylim(LOWEST, TOP)
    panel.axhspan(FAILED, TOP, color="#fbeee6", linewidth=0, zorder=0)
    panel.axhline(drawing.FELT, color=drawing.INK, linewidth=0.9, linestyle=(0, (5, 4)), zorder=1)
    drawing.note(panel, FAILED, "failed")
    drawing.note(panel, drawing.FELT, "noticeable above")


def _legend(drawn: Figure, methods: Sequence[str]) -> None:
    """Put the methods, and the loops, to the right of the panels."""
    handles = [
        Line2D([], [], **{**drawing.line(method), "markersize": 0.7 * drawing.look_of(method).size})
        for method in methods
    ]
    handles += [Line2D([], [], color=colour, marker="o", markersize=2.0, label=f"in a hand: {label}")
                for colour, label in LOOPS.values()]  # fmt: skip
    drawn.legend(handles=handles, loc="outside right center", frameon=False, fontsize=7.2, labelspacing=0.32,
                 handlelength=1.9)  # fmt: skip


def problems_finding(sets_of_problems: Sequence[Sequence[Set]]) -> str:
    """Return a sentence on error and cost of the best and the simplest method near 1 kHz; empty unless all were run."""
    known = [{runs.method: runs for runs in sets} for sets in sets_of_problems if sets[0].problem in problems()]
    loops = [runs for sets in sets_of_problems if sets[0].problem == "sprung-mass-in-hand" for runs in sets]
    if not known or not loops:
        return ""
    best, simple = (float(np.median([_share(of[name]) for of in known])) for name in (BEST, SIMPLE))
    times = float(np.median([of[BEST].cost.ratio(of[SIMPLE].cost)[1] for of in known]))
    worst = max(_share(runs) for runs in loops)
    period = at_fixed_period(loops[0]).period_s
    return (
        f"At {rounded(1e3 * period, 2)} ms <code>{BEST}</code> has an error of {percent(best)} of the largest force, "
        f"<code>{SIMPLE}</code> of {percent(simple)}, for {times:.2f} times the computing (medians of {len(known)} "
        f"problems). In the loop all methods are of first order, with errors up to {percent(worst)}."
    )


def _share(runs: Set) -> float:
    point = at_fixed_period(runs)
    return math.inf if has_failed(point, runs.peak) else (point.error_rms or 0.0) / runs.peak


ZONE = 0.22
"""Height of the zone of failures, as a share of the logarithmic scale below it."""
CLOSE = 0.05
"""Permitted difference of observed and claimed orders."""
FIXED_COST = 300.0
"""Computing time for a second of simulated time [µs] at which methods are compared in the table."""

EXPLAINED = """Each marker is one run with one step size; its force is compared with the exact force at every
sample. Left: error over step size; a method of order <i>p</i> falls by 10<sup><i>p</i></sup> per decade. Right: the
same runs over their cost, the computing time for one second of simulated time (median of 25 repeats, methods in
turn). <b>×</b> at the top marks a failure, one row per method: values not finite, or an error above ten times the
largest force. A hand does not notice an error below the dashed line (8 % of the largest force). Every method reads
the input at the samples only, as a loop does. A held input makes any method first order, a straight line between
samples second order; therefore <code>rk4</code> and <code>exact-foh</code> are on one line. With a constant input
the classic orders appear."""


def work_precision_section(context: html.Context) -> html.Section:
    """Measure the chosen problems and contacts with all their methods, and return their section."""
    every: dict[str, Problem | Contact] = {**problems(), **loops.contacts()}
    chosen = [(name, item) for name, item in every.items() if context.is_chosen(name)]
    body, figures, found = [html.paragraph(EXPLAINED)], {}, []
    for place, (name, item) in enumerate(chosen):
        context.progress(name, place / len(chosen))
        sets = list(_sets(context, item))
        context.costs.extend(each.cost for each in sets)
        for point in (point for each in sets for point in each.points):
            context.add("work_precision", asdict(point))
        found.append(sets)
        document = drawing.svg(draw(sets))
        figures[f"work-precision-{name}"] = document
        body += [f"<h3>{item.title[0].upper()}{item.title[1:]}</h3>", html.picture(name, document, _caption(sets))]
        body.append(html.folded("Figures of each method", sets_table(sets)))
    card = None
    if context.names is None:
        body += ["<h3>Largest stable step</h3>", html.paragraph(LIMITS_EXPLAINED), _limits_table()]
        figures["all-problems"] = drawing.svg(draw_all(found))
        card = html.Card("What does accuracy cost?", html.picture("all-problems", figures["all-problems"], TOLD))
    title = "Error against the time it costs"
    return html.Section("work-precision", title, "".join(body), tuple(_findings(found)), figures, card=card)


LIMITS_EXPLAINED = """Stability limits that each method states, and those that bisection on its own step finds: the
largest <i>h</i> = T·√(k/m) at which an undamped oscillator does not grow, and the largest T/τ at which a decay with
time constant τ does not grow. 0: it grows at every step size. This table covers the integrator alone; the sampled
loop is below."""


def _sets(context: html.Context, item: Problem | Contact) -> Iterator[Set]:
    """Return an iterator that measures one method after another; their costs are taken in turn before."""
    steps = step_counts(context.quick)
    if isinstance(item, Problem):
        costs = work_precision.step_costs(item, METHODS)
        return (work_precision.measure(item, method, steps, costs[method]) for method in METHODS)
    costs = loops.law_costs(item, item.methods, context.bench)
    return (loops.measure(item, method, context.bench, steps, costs[method]) for method in item.methods)


def draw(sets: Sequence[Set]) -> Figure:
    """Return a figure of errors over step size and over cost, with the zone of failures at the top."""
    drawn = drawing.figure(5.1)
    left, right = drawn.subplots(1, 2, sharey=True)
    peak = sets[0].peak
    errors = [p.error_rms for each in sets for p in each.points if p.error_rms and not has_failed(p, peak)]
    # The scale is logarithmic: heights in the zone are powers of the ratio of its ends. No axis goes below rounding.
    low, edge = max(min(errors, default=1e-6) / 3.0, 1e-17), FAILED * peak
    top = edge * (edge / low) ** ZONE
    for row, each in enumerate(sets):
        height = edge * (top / edge) ** ((row + 0.7) / len(sets))
        _curve(left, each, [1e3 * point.period_s for point in each.points], height)
        _curve(right, each, [computing(point) for point in each.points], height)
    for panel, place, side in ((left, 0.006, "left"), (right, 0.994, "right")):  # where small steps are: few fail
        panel.axhspan(edge, top, color="#fbeee6", linewidth=0, zorder=0)
        panel.text(place, 0.985, "failed", transform=panel.transAxes, ha=side, va="top", size=8.5, color="#888888")
        panel.axhline(drawing.FELT * peak, color=drawing.GREY, linewidth=1.0, linestyle=(0, (5, 4)), zorder=1)
        panel.set_ylim(low, top)
    left.annotate("not noticeable", (0.995, drawing.FELT * peak), xycoords=("axes fraction", "data"), ha="right",
                  va="top", size=8.5, color="#666666", xytext=(0, -2), textcoords="offset points")  # fmt: skip
    drawing.dress(left, "error over step size", "period [ms]", "rms error of the force [N]")
    drawing.dress(right, "error over cost", "computing time for one second of simulated time [µs]", "")
    right.set_gid(drawing.MEASURED)
    labels = {each.method: f"{each.method}  {order_words(each)}" for each in sets}
    drawing.legend(drawn, labels, ncols=3, title="method, and order observed (claimed)", title_fontsize=9)
    return drawn


def _curve(panel: Axes, runs: Set, places: Sequence[float], height: float) -> None:
    """Draw the runs of one method; those that failed stand at `height` in the zone of failures."""
    good = [(x, p.error_rms) for x, p in zip(places, runs.points, strict=True) if not has_failed(p, runs.peak)]
    failed = [x for x, p in zip(places, runs.points, strict=True) if has_failed(p, runs.peak)]
    panel.loglog([x for x, _ in good], [max(e or 0.0, 1e-17) for _, e in good], **drawing.line(runs.method))
    if failed:
        panel.loglog(failed, [height] * len(failed), linestyle="none", marker="x", markersize=5, markeredgewidth=1.6,
                     color=drawing.look_of(runs.method).colour)  # fmt: skip


def is_as_claimed(runs: Set) -> bool:
    """Return whether the observed order is the claimed one, or nothing is claimed.

    An exact method shows rounding only, and has no observed order.
    """
    order = math.inf if runs.order is None else runs.order
    return runs.claimed is None or order == runs.claimed or abs(order - runs.claimed) <= CLOSE


def order_words(runs: Set) -> str:
    """Return the observed order, and the claimed one in brackets."""
    observed = "rounding only" if runs.order is None else f"{runs.order:.2f}"
    if runs.claimed is None:
        return f"{observed} (no claim)"
    return f"{observed} ({'exact' if math.isinf(runs.claimed) else f'{exactly(runs.claimed)}'})"


def _caption(sets: Sequence[Set]) -> str:
    """Return the caption: numbers of runs, failures and unstable steps."""
    failed = sum(has_failed(point, each.peak) for each in sets for point in each.points)
    total = sum(len(each.points) for each in sets)
    unstable = sum(not point.stable for each in sets for point in each.points)
    return (
        f"{total} runs, {failed} failed; {unstable} with a step that makes some mode grow, which a short run can "
        f"survive. Largest exact force {rounded(sets[0].peak)} N."
    )


def at_fixed_cost(runs: Set, cost: float = FIXED_COST) -> float | None:
    """Return the rms error [N] at a computing time `cost` [µs] for a second; None when it lies outside the runs.

    Between two runs the error is interpolated by a straight line of logarithms.
    """
    known = sorted((computing(p), p.error_rms) for p in runs.points if p.error_rms)
    if not known or not known[0][0] <= cost <= known[-1][0]:
        return None
    costs, errors = np.log(known).T
    return math.exp(np.interp(math.log(cost), costs, errors))


def sets_table(sets: Sequence[Set]) -> str:
    """Return a table of all methods on one problem: orders, largest stable step, errors and cost."""
    period = 1e3 * at_fixed_period(sets[0]).period_s

    def row(each: Set) -> list[html.Entry]:
        point = at_fixed_period(each)
        failed = html.Cell("failed", "bad") if has_failed(point, each.peak) else None
        share = None if failed or point.error_rms is None else 100.0 * point.error_rms / each.peak
        largest = max((p.period_s for p in each.points if p.stable), default=None)
        return [
            each.method,
            html.Cell(order_words(each), "good" if is_as_claimed(each) else "bad"),
            "none of them" if largest is None else f"{rounded(1e3 * largest)} ms",
            *(failed or error for error in (point.error_final, point.error_rms, point.error_max)),
            share,
            f"{point.ns_per_step:.0f} ({point.ns_quartiles[0]:.0f} to {point.ns_quartiles[2]:.0f})",
            at_fixed_cost(each),
        ]

    headings = (
        "method", "order: observed (claimed)", "largest stable step tried", f"final error at {rounded(period)} ms [N]",
        "rms [N]", "max [N]", "rms, % of largest force", "ns per step (half of the repeats)",
        f"rms [N] for {exactly(FIXED_COST)} µs a second",
    )  # fmt: skip
    return html.table(headings, map(row, sets))


def _limits_table() -> str:
    """Return a table of the largest stable steps of all methods."""
    rows = [
        [name, *(html.number_text(each, 6) for each in limits), f"{radius:.9f}"]
        for name, *limits, radius in map(astuple, map(step_limit, METHODS))
    ]
    headings = ("method", "oscillator: claimed h", "measured h", "decay: claimed T/τ", "measured T/τ",
                "spectral radius at h = 0.1, undamped")  # fmt: skip
    return html.table(headings, rows)


def _findings(sets_of_problems: Sequence[Sequence[Set]]) -> Iterator[str]:
    """Yield the findings that the measured sets permit: on orders, and on the two exact steps."""
    yield from filter(None, [problems_finding(sets_of_problems)])
    every = [each for sets in sets_of_problems for each in sets]
    told = [each for each in every if each.claimed is not None]
    if told:
        failed = sum(has_failed(p, each.peak) for each in every for p in each.points)
        yield (
            f"Observed orders match the claims within {exactly(CLOSE)} in {sum(map(is_as_claimed, told))} of "
            f"{len(told)} sets of runs; {failed} of {sum(len(each.points) for each in every)} runs failed and are "
            "drawn as failures."
        )
    smooth = next((sets for sets in sets_of_problems if sets[0].problem == "sprung-mass-minimum-jerk"), None)
    if smooth:
        by_name = {each.method: each for each in smooth}
        held, line_ = by_name["exact-zoh"], by_name["exact-foh"]
        held_run, line_run = at_fixed_period(held), at_fixed_period(line_)
        share = (held_run.error_rms or 0.0) / (line_run.error_rms or math.inf)
        low, times, high = line_.cost.ratio(held.cost)
        yield (
            f"At {rounded(1e3 * held_run.period_s)} ms the straight-line exact step (<code>exact-foh</code>) is "
            f"{rounded(share, 2)} times as accurate as the held one (<code>exact-zoh</code>) for a hand's motion, at "
            f"{times:.2f} times the cost (middle half of the repeats: {low:.2f} to {high:.2f}). The error came from "
            "the input hold, not from the integrator."
        )


# Section on the growth of the error along a run.

QUICK, FULL = 10**5, 10**7
"""Steps of each run."""
GROWTH_LOWEST, HIGHEST = 1e-16, 1e2
"""Ends of the frame, from the rounding of doubles to errors far larger than the force itself."""
APART = 0.075
"""Least distance of the names of two curves, as a share of the height."""

GROWTH_EXPLAINED = """The puck is held, and the virtual mass (200 N/m, 0.5 kg) oscillates behind it at 1 kHz for the
given
number of steps. Each step is a call of the step that the loop runs. The exact force is k·A·cos ωt. Left: the
largest error within the last half period. Right: the drift of the energy, which should be 0. Forward Euler grows at
<i>every</i> step size, backward Euler decays. Symplectic methods keep the energy within a band and lose only phase,
in proportion to time; the exact steps lose only rounding errors."""


def growth_section(context: html.Context) -> html.Section:
    """Measure all methods and return their section."""
    total = QUICK if context.quick else FULL
    told = f"{rounded(total)} steps of "
    methods = context.with_progress(METHODS, lambda method: f"{told}{method}")
    found = [loops.free_swing(method, total) for method in methods]
    document = drawing.svg(draw_growth(found))
    caption = (
        f"{rounded(total)} steps are {rounded(total * loops.PERIOD)} s of simulated time. Values outside the frame "
        "are drawn at its edge; × marks the first value that is not finite."
    )
    short = drawing.svg(draw_card(found))
    return html.Section(
        "growth",
        "Error along the run",
        html.paragraph(GROWTH_EXPLAINED) + html.picture("growth", document, caption) + growth_table(found),
        (_finding(found, total),),
        {"growth": document, "growth-force": short},
        [asdict(each) for each in found],
        html.Card("How does the error grow along a run?", html.picture("growth-force", short, caption)),
    )


def draw_growth(swings: Sequence[Growth]) -> Figure:
    """Return a figure of the force's error and of the energy's drift over the steps."""
    drawn = drawing.figure(4.9)
    left, right = drawn.subplots(1, 2)
    for swing in swings:
        _growth_curve(left, swing, swing.error)
        _growth_curve(right, swing, swing.energy)
    left.axhline(drawing.FELT, color=drawing.GREY, linewidth=1.0, linestyle=(0, (5, 4)))
    drawing.note(left, drawing.FELT, "noticeable above", right=False, size=8.5)
    drawing.dress(left, "error of the force", "steps [1]", "largest error over amplitude [1]")
    drawing.dress(right, "drift of the energy", "steps [1]", "|energy / energy at the start − 1| [1]")
    drawing.legend(drawn, {swing.method: swing.method for swing in swings}, ncols=5)
    return drawn


def draw_card(swings: Sequence[Growth]) -> Figure:
    """Return a small figure of the force's error, its curves named at their ends."""
    drawn = drawing.figure(*html.CARD)
    panel = drawn.subplots()
    for swing in swings:
        error = np.clip(swing.error, GROWTH_LOWEST, HIGHEST)
        panel.loglog(swing.steps, error, **drawing.line(swing.method, marked=False))
    panel.axhline(drawing.FELT, color=drawing.INK, linewidth=0.9, linestyle=(0, (5, 4)))
    drawing.note(panel, drawing.FELT, "noticeable above", right=False)
    panel.set(xlim=(swings[0].steps[0], swings[0].steps[-1]), ylim=(GROWTH_LOWEST, HIGHEST))
    drawing.card_panel(panel, "", "steps of the loop [1]", "largest error over amplitude [1]")
    _name_ends(panel, {swing.method: min(max(swing.error[-1], GROWTH_LOWEST), HIGHEST) for swing in swings})
    return drawn


def _name_ends(panel: Axes, ends: Mapping[str, float]) -> None:
    """Name curves at their ends, from the top down; names that would overlap are moved apart."""
    scale = math.log10(HIGHEST / GROWTH_LOWEST)
    lowest_free = 1.0 + APART
    for left, (name, end) in enumerate(sorted(ends.items(), key=lambda each: -each[1]), 1 - len(ends)):
        place = math.log10(end / GROWTH_LOWEST) / scale
        lowest_free = max(min(place, lowest_free - APART), -left * APART)
        colour = drawing.look_of(name).colour
        arrow = {"arrowstyle": "-", "relpos": (0.0, 0.5), "color": colour, "linewidth": 0.6}
        panel.annotate(name, (1.0, place), (1.06, lowest_free), xycoords="axes fraction", textcoords="axes fraction",
                       size=7.2, color=colour, va="center", annotation_clip=False, arrowprops=arrow)  # fmt: skip


def _growth_curve(panel: Axes, swing: Growth, values: Sequence[float]) -> None:
    """Draw one method; values outside the frame are drawn at its edge, × marks where numbers overflowed."""
    panel.loglog(swing.steps, np.clip(np.abs(values), GROWTH_LOWEST, HIGHEST), **drawing.line(swing.method))
    if swing.diverged_at is not None:
        panel.loglog([swing.diverged_at], [HIGHEST], linestyle="none", marker="x", markersize=9, markeredgewidth=2.0,
                     color=drawing.look_of(swing.method).colour, clip_on=False)  # fmt: skip
    panel.set_ylim(GROWTH_LOWEST, HIGHEST)


def growth_table(swings: Sequence[Growth]) -> str:
    """Return a table of the last errors and the energy drifts."""
    rows = [
        [
            swing.method,
            html.Cell(f"by step {swing.diverged_at}", "bad") if swing.diverged_at is not None else "no",
            *(swing.error[-1], swing.energy[-1], max(map(abs, swing.energy))),
        ]
        for swing in swings
    ]
    headings = ("method", "overflowed", "last error / amplitude", "last energy drift", "largest energy drift")
    return html.table(headings, rows)


def _finding(swings: Sequence[Growth], total: int) -> str:
    by_name = {swing.method: swing for swing in swings}
    best, leapfrog, euler = by_name["exact-foh"], by_name["semi-implicit"], by_name["forward-euler"]
    lost = "overflows" if euler.diverged_at is not None else f"is {rounded(euler.error[-1], 2)} times the force"
    return (
        f"After {rounded(total)} steps the force error of an oscillating mass is {rounded(best.error[-1], 2)} of its "
        f"force with <code>exact-foh</code> and {percent(leapfrog.error[-1])} with <code>semi-implicit</code> (phase "
        f"only); with <code>forward-euler</code> it {lost}."
    )

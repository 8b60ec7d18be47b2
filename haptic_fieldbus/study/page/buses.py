"""Section on one scene over both protocols: felt error against what a period costs."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.report.drawing import BLUE, FELT, GREEN, GREY, ORANGE, VERMILION
from haptic_fieldbus.study.measure.buses import BUSES, SETTINGS, BusPoint, bus_points
from haptic_fieldbus.study.page.context import Context
from haptic_fieldbus.study.page.html import Cell, Entry, Section, folded, paragraph, picture, table
from haptic_fieldbus.study.page.style import dress, figure, look_of, svg

COLOURS = dict(zip(BUSES, (BLUE, GREEN, ORANGE, VERMILION), strict=True))
CEILING = 1.0
"""Error at which a run that was refused is drawn, as a share of the force."""

TICKS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""[%]."""

EXPLAINED = f"""One wall of {exactly(SETTINGS["wall.stiffness"])} N/m and {exactly(SETTINGS["wall.damping"])} N·s/m,
tapped by the same hand, in virtual time: the drive, its servo, motor and encoder are the same, the line differs. Each
marker is one run: a colour for the bus, a marker for the velocity estimator, and along a curve the rate, from the
highest that the bus has by itself downwards. The error is the share of the force by which the moving hand feels
another one than that of the scene. On the left it stands over what a period costs: the time of all messages with the
silence between them, and of computing on this machine. On the right it stands over the computing time for one second.
<b>×</b> at the top marks a run that was refused. Below the dashed line a hand cannot tell the error."""


def buses_section(context: Context) -> Section:
    """Run the scene on all buses and return their section."""
    found: list[BusPoint] = []
    for name in context.with_progress(BUSES, lambda bus: bus):
        found += bus_points(context.tools, name, quick=context.quick)
    document = svg(draw(found))
    refused = sum(point.felt_error is None for point in found)
    caption = f"{len(found)} runs, {refused} of them refused. Lines join the rates of one estimator on one bus."
    body = [
        paragraph(EXPLAINED),
        picture("buses", document, caption),
        buses_table(best_of_each(found)),
        folded("Every run", buses_table(found)),
    ]
    return Section(
        "buses",
        "One scene over both protocols",
        "".join(body),
        tuple(_finding(best_of_each(found))),
        {"buses": document},
        [asdict(point) for point in found],
    )


def best_of_each(points: Sequence[BusPoint]) -> list[BusPoint]:
    """Return the run with the least error of each bus, in the order of the buses."""
    best: dict[str, BusPoint] = {}
    for point in sorted(points, key=_error):
        best.setdefault(point.bus, point)
    return [best[name] for name in BUSES if name in best]


def _error(point: BusPoint) -> float:
    return CEILING if point.felt_error is None else point.felt_error


def draw(points: Sequence[BusPoint]) -> Figure:
    """Return a figure of the felt error over the cost of a period, and over computing time."""
    drawn = figure(4.6)
    left, right = drawn.subplots(1, 2, sharey=True)
    _curves(left, points, [1e3 * point.period_cost for point in points])
    _curves(right, points, [1e6 * point.computing_share for point in points])
    for panel in (left, right):
        panel.axhline(100.0 * FELT, color=GREY, linewidth=1.0, linestyle=(0, (5, 4)), zorder=1)
        panel.set_ylim(top=130.0 * CEILING)
        panel.set_yticks(TICKS, map(exactly, TICKS))
        panel.minorticks_off()
    dress(left, "error over the cost of a period", "time on the bus and computing, a period [ms]", "felt error [%]")
    dress(right, "work–precision: error over computing", "computing time for one second [µs]", "")
    seen = dict.fromkeys(point.estimator for point in points)
    handles = [Line2D([], [], color=colour, linewidth=3.0, label=name) for name, colour in COLOURS.items()]
    handles += [Line2D([], [], color=GREY, linestyle="none", marker=look_of(name).marker, label=name) for name in seen]
    drawn.legend(handles=handles, loc="outside lower center", ncols=len(COLOURS), frameon=False, fontsize=9)
    return drawn


def _curves(panel: Axes, points: Sequence[BusPoint], places: Sequence[float]) -> None:
    """Draw a curve over the rates for each bus and estimator; runs that were refused stand at the top."""
    curves: dict[tuple[str, str], list[tuple[float, BusPoint]]] = {}
    for place, point in zip(places, points, strict=True):
        curves.setdefault((point.bus, point.estimator), []).append((place, point))
    panel.set_xscale("log")
    panel.set_yscale("log")
    for (bus, estimator), runs in curves.items():
        good = [(place, 100.0 * point.felt_error) for place, point in runs if point.felt_error is not None]
        refused = [place for place, point in runs if point.felt_error is None]
        look: dict[str, Any] = {"color": COLOURS[bus], "linewidth": 1.0}
        panel.plot([x for x, _ in good], [y for _, y in good], marker=look_of(estimator).marker, markersize=5.5, **look)
        panel.plot(refused, [100.0 * CEILING] * len(refused), linestyle="none", marker="x", **look)


def buses_table(points: Sequence[BusPoint]) -> str:
    """Return a table of runs: exchange, rate, times and error, or the reason why there is none."""

    def row(point: BusPoint) -> list[Entry]:
        error: Entry = Cell(point.reason, "bad")
        if point.felt_error is not None:
            error = Cell(percent(point.felt_error), "good" if point.felt_error < FELT else "bad")
        times = (1e3 * point.bus_s, 1e6 * point.computing_s, 1e6 * point.computing_share)
        return [point.bus, point.estimator, point.exchange, f"{rounded(point.rate_hz)} Hz", *times, error]

    headings = ("bus", "estimator", "exchange", "rate", "bus, a period [ms]", "computing, a period [µs]",
                "computing, a second [µs]", "felt error")  # fmt: skip
    return table(headings, map(row, points), text_columns=3)


def _finding(best: Sequence[BusPoint]) -> Iterator[str]:
    """Yield what the best run of each bus says: computing is nothing beside the line."""
    told = [point for point in best if point.felt_error is not None]
    errors = ", ".join(f"{percent(point.felt_error or 0.0)} on {point.bus}" for point in told)
    if told:
        share = max(point.computing_s / point.period_cost for point in told)
        yield (
            f"One wall over both protocols is off by {errors}. Computing is at most {percent(share)} of what a period "
            "costs; the rest is the line."
        )

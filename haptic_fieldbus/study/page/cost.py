"""Sections on the cost of each optional part, on missed periods, and on one scene over all buses."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from haptic_fieldbus import HapticFieldbusError, Plan
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.report import drawing
from haptic_fieldbus.study.measure import timing
from haptic_fieldbus.study.measure.bench import DEFAULT_ESTIMATOR, FEW_SCENES, Tools, library_scenes
from haptic_fieldbus.study.page import html

# What each scene leaves out: a line a scene on the first screen, and all of them with their reasons further down.

LEFT_OUT = """A part that a scene does not need is not imported, mapped, decoded, estimated or stepped. The time is
the computing time of a whole period: the median of 25 repeats in which the scenes take turns, and the middle half
of the repeats. The image is the data read and written in a period, for all axes together."""


def lines(plans: Mapping[str, Plan], costs: Mapping[str, timing.Cost]) -> str:
    """Return a table with a line for each scene; `costs` are those of a whole period, by scene."""
    rows = [[scene, ", ".join(names(plan)) or "nothing", _micros(costs[scene])] for scene, plan in plans.items()]
    return html.table(("scene", "omitted", "µs per period"), rows, text_columns=2)


def names(plan: Plan) -> list[str]:
    """Return the parts that the plan leaves out; the estimator is omitted with its velocity."""
    return list(dict.fromkeys(left.what for left in plan.left_out))


def reasons(plans: Mapping[str, Plan]) -> str:
    """Return a folded table of the parts that each scene leaves out, with reasons, and of its imported modules."""
    rows = [
        [scene, "; ".join(f"{left.what}: {left.why}" for left in plan.left_out) or "nothing",
         ", ".join(module.removeprefix("haptic_fieldbus.") for module in plan.modules),
         f"{sum(axis.inputs[1] + axis.outputs[1] for axis in plan.image.axes)}"]
        for scene, plan in plans.items()
    ]  # fmt: skip
    headings = ("scene", "leaves out, and why", "imports, of the optional modules", "octets of the image")
    return html.folded("Why, scene by scene", html.table(headings, rows, text_columns=3))


def scenes_finding(plans: Mapping[str, Plan], costs: Mapping[str, timing.Cost]) -> str:
    """Return a sentence on omitted parts, and the times of the cheapest and the most expensive scene."""
    least, most = (side(plans, key=lambda scene: costs[scene].ns) for side in (min, max))
    return (
        f"Unused parts are not imported, mapped, decoded or stepped: a period of <code>{least}</code> takes "
        f"{rounded(1e-3 * costs[least].ns, 2)} µs of computing, one of <code>{most}</code> ({len(plans[most].axes)} "
        f"axes) {rounded(1e-3 * costs[most].ns, 2)} µs."
    )


def _micros(cost: timing.Cost) -> str:
    """Return the median and the middle half of the passes [µs]."""
    low, _, high = (rounded(1e-3 * ns) for ns in cost.quartiles)
    return f"{rounded(1e-3 * cost.ns)} ({low} to {high})"


QUICK, FULL = 20_000, 1_000_000
"""Periods that are timed one by one."""
# By the text before the colon in the name of a part.
COLOURS = {
    "whole period": drawing.BLUE,
    "estimator": drawing.ORANGE,
    "integrator, two states": drawing.GREEN,
    "integrator, four states": drawing.GREEN,
}

CAPTION = """Nanoseconds per call: the bar is the median of 25 repeats in which all parts take turns; the line at
its end covers the middle half of the repeats."""
EXPLAINED = """Mean time of many calls in this Python process after a warm-up, and the median of 25 such repeats. A
scene pays only for the parts that it uses; the plan omits the rest. Single periods are timed too, with all
disturbances of the machine."""
MORE = '<div class="more"><a href="#cost">All {} scenes that were timed, and why</a></div>'
LATE = """Share of periods that this machine would have missed while the report was made: by computing alone, and
with the exchange on the bus (worst case, CAN at 1 Mbit/s) and computing in sequence, as in the loop. The bus, not
the computer, limits the rate."""


def cost_section(context: html.Context) -> html.Section:
    """Time all parts and the periods, and return their section."""
    plans = {scene: context.tools.plan(scene) for scene in (FEW_SCENES if context.quick else library_scenes())}
    found: list[timing.OptionalPart] = []
    for each in timing.parts(plans, context.bench):
        found.append(each)
        # The number of parts is not known before; about 60 fill most of the bar.
        context.progress(each.part, min(len(found) / 60, 0.9))
        row = {"part": each.part, "ns_per_step": each.ns_per_step, "ns_quartiles": each.ns_quartiles}
        context.add("optional_parts", row)
    context.costs.extend(each.cost for each in found if each.cost is not None)
    context.progress("deadlines", 0.9)
    late = timing.deadlines(context.tools, QUICK if context.quick else FULL)
    document = drawing.svg(draw(found))
    costs = {scene: each.cost for scene, each in zip(plans, found, strict=False) if each.cost is not None}
    few = {scene: plans[scene] for scene in FEW_SCENES}
    single = [[part.part, *(1e-3 * ns for ns in (part.ns_per_step, *astuple(part.spread)))]
              for part in found if part.spread is not None]  # fmt: skip
    body = [
        f"<h3>Omitted parts of each scene</h3>{html.paragraph(LEFT_OUT)}{lines(plans, costs)}{reasons(plans)}",
        f"<h3>Time of each part</h3>{html.paragraph(EXPLAINED)}{html.picture('cost', document, CAPTION)}",
        html.table(("single periods [µs]", "median of means", "median", "99.9 %", "largest"), single),
        f"<h3>Periods missed</h3>{html.paragraph(LATE)}{_late_table(late)}",
    ]
    return html.Section(
        "cost",
        "Omitted parts of each scene, and cost of each part",
        "".join(body),
        (scenes_finding(few, costs), _finding(found, late)),
        {"cost": document},
        asdict(late),
        html.Card("What does a scene omit?", lines(few, costs) + MORE.format(len(plans))),
    )


def _finding(found: Sequence[timing.OptionalPart], late: timing.RateDeadlines) -> str:
    whole = found[0]
    return (
        f"A whole period of the wall takes {rounded(1e-3 * whole.ns_per_step)} µs of computing (half of the repeats "
        f"{rounded(1e-3 * whole.ns_quartiles[0])} to {rounded(1e-3 * whole.ns_quartiles[2])}); its exchange on the bus "
        f"takes {1e6 * late.bus:.0f} µs."
    )


def draw(parts: Sequence[timing.OptionalPart]) -> Figure:
    """Return a figure with a bar for each part, on a logarithmic scale."""
    drawn = drawing.figure(1.2 + 0.24 * len(parts))
    panel = drawn.subplots()
    for row, part in enumerate(parts):
        # At least 1 ns: a part that is a difference of two times can come out negative, and the scale is logarithmic.
        ends = [max(ns, 1.0) for ns in (part.ns_quartiles[0], part.ns_quartiles[2])]
        panel.plot(ends, [row, row], color="#222222", linewidth=1.2, solid_capstyle="butt")
        colour = COLOURS.get(part.part.partition(":")[0], drawing.SKY)
        panel.barh(row, max(part.ns_per_step, 1.0), color=colour, height=0.68)
        panel.text(max(part.ns_per_step, ends[1]) * 1.06, row, f"{part.ns_per_step:.0f}", va="center",
                   size=8.5, color="#444444")  # fmt: skip
    panel.set_yticks(range(len(parts)), [part.part for part in parts], fontsize=9)
    panel.invert_yaxis()
    panel.set(xscale="log", xlim=(20.0, 2.2 * max(part.ns_per_step for part in parts)))
    panel.margins(y=0.01)
    drawing.dress(panel, "", "time per step [ns]", "")
    panel.grid(visible=False, axis="y")
    panel.tick_params(axis="y", color=drawing.GREY)
    return drawn


def _late_table(late: timing.RateDeadlines) -> str:
    """Return the times of a period in words, and a table of missed periods at each rate."""
    shown = [html.number_text(1e6 * each) for each in (late.compute_p50, late.compute_p999, late.compute_max, late.bus)]
    times = (
        f"{late.periods} periods of <code>{timing.SCENE}</code>: computing {shown[0]} µs (median), {shown[1]} µs "
        f"(99.9 %), {shown[2]} µs (largest); bus {shown[3]} µs."
    )
    rows: list[list[html.Entry]] = [
        [f"{exactly(each.rate)} Hz", _share(each.missed_computing), _share(each.missed)] for each in late.rates
    ]
    return html.paragraph(times) + html.table(("rate", "missed by computing alone", "missed with the bus"), rows)


def _share(value: float) -> html.Cell:
    """Return a share of missed periods; good only when none was missed."""
    if value in (0.0, 1.0):
        return html.Cell("every period", "bad") if value else html.Cell("0", "good")
    return html.Cell(percent(value), "bad")


# Section on one scene over both protocols: felt error against the cost of a period.

# Felt error of one scene on buses of both protocols: bus × velocity estimator × rate.
#
# The scene is a wall that damps, tapped by a hand, so that all contact moves. A point is one run in virtual time. Its
# error is what the hand feels of it; its cost is the time that a period takes on the bus and in this computer.

BUSES = {
    "CANopen, 1 Mbit/s": ("sim", "generic_cia402"),
    "Modbus TCP": ("sim-modbus-tcp", "generic_cia402_modbus"),
    "Modbus RTU, 1 Mbit/s": ("sim-modbus-rtu@1000000", "generic_cia402_modbus"),
    "Modbus RTU, 115200 bit/s": ("sim-modbus-rtu@115200", "generic_cia402_modbus"),
}
"""Name → bus and profile; both profiles are of the same drive."""
BUSES_SCENE, HAND, DURATION, FADE_IN = "damped_wall", "tap", 0.9, 0.1
"""Scene, hand, and times of a run [s]; the first tap crosses the wall's surface soon after the fade-in."""
SETTINGS = {"wall.stiffness": 60.0, "wall.damping": 1.0, "wall.position": 0.005}
"""A wall soft enough for all of the buses [N/m], [N·s/m], [m]."""
FEW_ESTIMATORS = (DEFAULT_ESTIMATOR,)
ESTIMATORS = (DEFAULT_ESTIMATOR, "least-squares", "kalman-velocity", "foaw-best-fit")
"""One of each family; the default is one of the differences."""
FEW_RATES, RATES = (1, 4), (1, 2, 4)
"""Divisors of the default rate of a bus."""
REPEATS = 10
"""Timed repeats; each is a swing of the handle."""


@dataclass(frozen=True)
class BusPoint:
    """One run of the scene; errors are shares of the force, None when the run was refused or had no contact."""

    bus: str
    estimator: str
    exchange: str
    """Messages of a period in words."""
    rate_hz: float
    bus_s: float
    """Time on the bus in a period [s]."""
    computing_s: float
    """Computing time in a period [s]."""
    felt_error: float | None
    reason: str = ""
    """Reason why there is no error; empty if there is one."""

    @property
    def period_cost(self) -> float:
        """Time of a period on the bus plus its computing time [s]."""
        return self.bus_s + self.computing_s

    @property
    def computing_share(self) -> float:
        """Computing time for a second of contact [s]."""
        return self.computing_s * self.rate_hz


def bus_points(tools: Tools, name: str, *, quick: bool) -> Iterator[BusPoint]:
    """Yield the points of one bus of `BUSES`: each estimator, the highest rate first."""
    bus, drive = BUSES[name]
    for estimator in FEW_ESTIMATORS if quick else ESTIMATORS:
        chosen: dict[str, object] = {"bus": bus, "drive": drive, "estimator": estimator, "settings": SETTINGS}
        fastest = tools.plan(BUSES_SCENE, **chosen)
        playback = timing.Playback(fastest)
        timed = timing.in_turn({BUSES_SCENE: timing.Timed(playback.running_cycle(), playback.swing)}, REPEATS)
        for divisor in FEW_RATES if quick else RATES:
            rate = fastest.rate / divisor
            traffic = tools.plan(BUSES_SCENE, rate=rate, **chosen).buses[0].traffic
            way, on_bus = traffic.exchange or "SYNC, TPDO, RPDO", traffic.load / rate
            computing = 1e-9 * timed[BUSES_SCENE].ns
            yield BusPoint(name, estimator, way, rate, on_bus, computing, *_felt(tools, rate=rate, **chosen))


def _felt(tools: Tools, **chosen: object) -> tuple[float | None, str]:
    """Return the error in moving contact as a share of the force, or None and the reason."""
    try:
        result = tools.run(BUSES_SCENE, hand=HAND, duration=DURATION, fade_in=FADE_IN, **chosen)
    except HapticFieldbusError as error:
        return None, str(error).splitlines()[0]
    found = None if result.torque_error is None else result.torque_error.contact
    return found, "" if found is not None else "the hand did not reach the wall"


BUSES_COLOURS = dict(zip(BUSES, (drawing.BLUE, drawing.GREEN, drawing.ORANGE, drawing.VERMILION), strict=True))
CEILING = 1.0
"""Error at which a run that was refused is drawn, as a share of the force."""

TICKS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""[%]."""

BUSES_EXPLAINED = f"""One wall of {exactly(SETTINGS["wall.stiffness"])} N/m and {exactly(SETTINGS["wall.damping"])}
N·s/m,
tapped by the same hand in virtual time. Drive, servo, motor and encoder are the same; the line differs. Each marker
is one run: the colour shows the bus, the marker the velocity estimator. Along a curve the rate falls from the
highest of the bus. The error is the share of the force that differs from the scene for a moving hand. Left: error
over the cost of a period (all messages with the silence between them, plus computing on this machine). Right: error
over the computing time for one second. <b>×</b> marks a refused run. A hand does not notice an error below the
dashed line."""


def buses_section(context: html.Context) -> html.Section:
    """Run the scene on all buses and return their section."""
    found: list[BusPoint] = []
    for name in context.with_progress(BUSES, lambda bus: bus):
        found += bus_points(context.tools, name, quick=context.quick)
    document = drawing.svg(draw_buses(found))
    refused = sum(point.felt_error is None for point in found)
    caption = f"{len(found)} runs, {refused} of them refused. Lines join the rates of one estimator on one bus."
    best = best_of_each(found)
    tables = buses_table(best) + html.folded("Every run", buses_table(found))
    return html.Section(
        "buses",
        "One scene over both protocols",
        html.paragraph(BUSES_EXPLAINED) + html.picture("buses", document, caption) + tables,
        tuple(_buses_finding(best)),
        {"buses": document},
        [asdict(point) for point in found],
    )


def best_of_each(points: Sequence[BusPoint]) -> list[BusPoint]:
    """Return the run with the least error of each bus, in the order of the buses."""
    best: dict[str, BusPoint] = {}
    for point in sorted(points, key=lambda each: CEILING if each.felt_error is None else each.felt_error):
        best.setdefault(point.bus, point)
    return [best[name] for name in BUSES if name in best]


def draw_buses(points: Sequence[BusPoint]) -> Figure:
    """Return a figure of the felt error over the cost of a period, and over computing time."""
    drawn = drawing.figure(4.6)
    left, right = drawn.subplots(1, 2, sharey=True)
    _curves(left, points, [1e3 * point.period_cost for point in points])
    _curves(right, points, [1e6 * point.computing_share for point in points])
    for panel in (left, right):
        panel.axhline(100.0 * drawing.FELT, color=drawing.GREY, linewidth=1.0, linestyle=(0, (5, 4)), zorder=1)
        panel.set_ylim(top=130.0 * CEILING)
        panel.set_yticks(TICKS, map(exactly, TICKS))
        panel.minorticks_off()
    drawing.dress(
        left, "error over the cost of a period", "time on the bus and computing in a period [ms]", "felt error [%]"
    )
    drawing.dress(right, "error over computing", "computing time for one second of simulated time [µs]", "")
    seen = dict.fromkeys(point.estimator for point in points)
    handles = [Line2D([], [], color=colour, linewidth=3.0, label=name) for name, colour in BUSES_COLOURS.items()]
    handles += [
        Line2D([], [], color=drawing.GREY, linestyle="none", marker=drawing.look_of(name).marker, label=name)
        for name in seen
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=len(BUSES_COLOURS), frameon=False, fontsize=9)
    return drawn


def _curves(panel: Axes, points: Sequence[BusPoint], places: Sequence[float]) -> None:
    """Draw a curve over the rates for each bus and estimator; refused runs are drawn at the top."""
    curves: dict[tuple[str, str], list[tuple[float, BusPoint]]] = {}
    for place, point in zip(places, points, strict=True):
        curves.setdefault((point.bus, point.estimator), []).append((place, point))
    panel.set(xscale="log", yscale="log")
    for (bus, estimator), runs in curves.items():
        good = [(place, 100.0 * point.felt_error) for place, point in runs if point.felt_error is not None]
        refused = [place for place, point in runs if point.felt_error is None]
        look: dict[str, Any] = {"color": BUSES_COLOURS[bus], "linewidth": 1.0}
        panel.plot(
            [x for x, _ in good], [y for _, y in good], marker=drawing.look_of(estimator).marker, markersize=5.5, **look
        )
        panel.plot(refused, [100.0 * CEILING] * len(refused), linestyle="none", marker="x", **look)


def buses_table(points: Sequence[BusPoint]) -> str:
    """Return a table of runs: exchange, rate, times and error, or the reason why there is none."""

    def row(point: BusPoint) -> list[html.Entry]:
        error: html.Entry = html.Cell(point.reason, "bad")
        if point.felt_error is not None:
            error = html.Cell(percent(point.felt_error), "good" if point.felt_error < drawing.FELT else "bad")
        times = (1e3 * point.bus_s, 1e6 * point.computing_s, 1e6 * point.computing_share)
        return [point.bus, point.estimator, point.exchange, f"{rounded(point.rate_hz)} Hz", *times, error]

    headings = ("bus", "estimator", "exchange", "rate", "bus, a period [ms]", "computing, a period [µs]",
                "computing, a second [µs]", "felt error")  # fmt: skip
    return html.table(headings, map(row, points), text_columns=3)


def _buses_finding(best: Sequence[BusPoint]) -> Iterator[str]:
    """Yield the finding from the best run of each bus: the computing time is small against the time on the bus."""
    told = [point for point in best if point.felt_error is not None]
    errors = ", ".join(f"{percent(point.felt_error or 0.0)} on {point.bus}" for point in told)
    if told:
        share = max(point.computing_s / point.period_cost for point in told)
        yield (
            f"One wall over both protocols: error {errors}. Computing takes at most {percent(share)} of a period; the "
            "line takes the rest."
        )

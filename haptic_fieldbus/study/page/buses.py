"""Section on one scene over both protocols: felt error against the cost of a period."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from haptic_fieldbus import HapticFieldbusError, Plan
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.report.drawing import BLUE, FELT, GREEN, GREY, ORANGE, VERMILION, dress, figure, look_of, svg
from haptic_fieldbus.study.measure.bench import DEFAULT_ESTIMATOR, Tools
from haptic_fieldbus.study.measure.timing import Playback, Timed, in_turn
from haptic_fieldbus.study.page.html import Cell, Context, Entry, Section, folded, paragraph, picture, table

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
SCENE, HAND, DURATION, FADE_IN = "damped_wall", "tap", 0.9, 0.1
"""Scene, hand, and times of a run [s]; the first tap crosses the wall's surface soon after the fade-in."""
SETTINGS = {"wall.stiffness": 60.0, "wall.damping": 1.0, "wall.position": 0.005}
"""A wall soft enough for all of the buses [N/m], [N·s/m], [m]."""
FEW_ESTIMATORS = (DEFAULT_ESTIMATOR,)
ESTIMATORS = tuple(
    dict.fromkeys((DEFAULT_ESTIMATOR, "backward-difference", "least-squares", "kalman-velocity", "foaw-best-fit"))
)
"""One of each family, and the default."""
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
        fastest = tools.plan(SCENE, **chosen)
        computing = computing_time(fastest)
        for divisor in FEW_RATES if quick else RATES:
            rate = fastest.rate / divisor
            traffic = tools.plan(SCENE, rate=rate, **chosen).buses[0].traffic
            way, on_bus = traffic.exchange or "SYNC, TPDO, RPDO", traffic.load / rate
            yield BusPoint(name, estimator, way, rate, on_bus, computing, *_felt(tools, rate=rate, **chosen))


def computing_time(plan: Plan) -> float:
    """Return the median time of a period's computing on this machine [s]."""
    playback = Playback(plan)
    return 1e-9 * in_turn({SCENE: Timed(playback.running_cycle(), playback.swing)}, REPEATS)[SCENE].ns


def _felt(tools: Tools, **chosen: object) -> tuple[float | None, str]:
    """Return the error in moving contact as a share of the force, or None and the reason."""
    try:
        result = tools.run(SCENE, hand=HAND, duration=DURATION, fade_in=FADE_IN, **chosen)
    except HapticFieldbusError as error:
        return None, str(error).splitlines()[0]
    found = None if result.torque_error is None else result.torque_error.contact
    return found, "" if found is not None else "the hand did not reach the wall"


COLOURS = dict(zip(BUSES, (BLUE, GREEN, ORANGE, VERMILION), strict=True))
CEILING = 1.0
"""Error at which a run that was refused is drawn, as a share of the force."""

TICKS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""[%]."""

EXPLAINED = f"""One wall of {exactly(SETTINGS["wall.stiffness"])} N/m and {exactly(SETTINGS["wall.damping"])} N·s/m,
tapped by the same hand in virtual time. Drive, servo, motor and encoder are the same; the line differs. Each marker
is one run: the colour shows the bus, the marker the velocity estimator. Along a curve the rate falls from the
highest of the bus. The error is the share of the force that differs from the scene for a moving hand. Left: error
over the cost of a period (all messages with the silence between them, plus computing on this machine). Right: error
over the computing time for one second. <b>×</b> marks a refused run. A hand does not notice an error below the
dashed line."""


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
    for point in sorted(points, key=lambda each: CEILING if each.felt_error is None else each.felt_error):
        best.setdefault(point.bus, point)
    return [best[name] for name in BUSES if name in best]


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
    dress(left, "error over the cost of a period", "time on the bus and computing in a period [ms]", "felt error [%]")
    dress(right, "error over computing", "computing time for one second of simulated time [µs]", "")
    seen = dict.fromkeys(point.estimator for point in points)
    handles = [Line2D([], [], color=colour, linewidth=3.0, label=name) for name, colour in COLOURS.items()]
    handles += [Line2D([], [], color=GREY, linestyle="none", marker=look_of(name).marker, label=name) for name in seen]
    drawn.legend(handles=handles, loc="outside lower center", ncols=len(COLOURS), frameon=False, fontsize=9)
    return drawn


def _curves(panel: Axes, points: Sequence[BusPoint], places: Sequence[float]) -> None:
    """Draw a curve over the rates for each bus and estimator; refused runs are drawn at the top."""
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
    """Yield the finding from the best run of each bus: the computing time is small against the time on the bus."""
    told = [point for point in best if point.felt_error is not None]
    errors = ", ".join(f"{percent(point.felt_error or 0.0)} on {point.bus}" for point in told)
    if told:
        share = max(point.computing_s / point.period_cost for point in told)
        yield (
            f"One wall over both protocols: error {errors}. Computing takes at most {percent(share)} of a period; the "
            "line takes the rest."
        )

"""Section on the cost of each optional part, and on missed periods."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple

from matplotlib.figure import Figure

from haptic_fieldbus import Plan
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, ORANGE, SKY, dress, figure, svg
from haptic_fieldbus.study.measure.bench import FEW_SCENES, library_scenes
from haptic_fieldbus.study.measure.timing import SCENE, Cost, OptionalPart, RateDeadlines, deadlines, parts
from haptic_fieldbus.study.page.html import (
    Card,
    Cell,
    Context,
    Entry,
    Section,
    folded,
    number_text,
    paragraph,
    picture,
    table,
)

# What each scene leaves out: a line a scene on the first screen, and all of them with their reasons further down.

LEFT_OUT = """A part that a scene does not need is not imported, mapped, decoded, estimated or stepped. The time is
the computing time of a whole period: the median of 25 repeats in which the scenes take turns, and the middle half
of the repeats. The image is the data read and written in a period, for all axes together."""


def lines(plans: Mapping[str, Plan], costs: Mapping[str, Cost]) -> str:
    """Return a table with a line for each scene; `costs` are those of a whole period, by scene."""
    rows = [[scene, ", ".join(names(plan)) or "nothing", _micros(costs[scene])] for scene, plan in plans.items()]
    return table(("scene", "omitted", "µs per period"), rows, text_columns=2)


def names(plan: Plan) -> list[str]:
    """Return the parts that the plan leaves out; the estimator is omitted with its velocity."""
    return list(dict.fromkeys(left.what for left in plan.left_out))


def reasons(plans: Mapping[str, Plan]) -> str:
    """Return a folded table of the parts that each scene leaves out, with reasons, and of its imported modules."""
    rows = [
        [scene, "; ".join(f"{left.what}: {left.why}" for left in plan.left_out) or "nothing",
         ", ".join(module.removeprefix("haptic_fieldbus.") for module in plan.modules), f"{_octets(plan)}"]
        for scene, plan in plans.items()
    ]  # fmt: skip
    headings = ("scene", "leaves out, and why", "imports, of the optional modules", "octets of the image")
    told = table(headings, rows, text_columns=3)
    return folded("Why, scene by scene", told)


def scenes_part(plans: Mapping[str, Plan], costs: Mapping[str, Cost]) -> str:
    """Return the part of a section on all scenes."""
    return f"<h3>Omitted parts of each scene</h3>{paragraph(LEFT_OUT)}{lines(plans, costs)}{reasons(plans)}"


def scenes_finding(plans: Mapping[str, Plan], costs: Mapping[str, Cost]) -> str:
    """Return a sentence on omitted parts, and the times of the cheapest and the most expensive scene."""
    least, most = (side(plans, key=lambda scene: costs[scene].ns) for side in (min, max))
    return (
        f"Unused parts are not imported, mapped, decoded or stepped: a period of <code>{least}</code> takes "
        f"{rounded(1e-3 * costs[least].ns, 2)} µs of computing, one of <code>{most}</code> ({len(plans[most].axes)} "
        f"axes) {rounded(1e-3 * costs[most].ns, 2)} µs."
    )


def _octets(plan: Plan) -> int:
    """Return the number of octets of the mapped signals of all axes, in and out."""
    return sum(axis.inputs[1] + axis.outputs[1] for axis in plan.image.axes)


def _micros(cost: Cost) -> str:
    """Return the median and the middle half of the passes [µs]."""
    low, _, high = (rounded(1e-3 * ns) for ns in cost.quartiles)
    return f"{rounded(1e-3 * cost.ns)} ({low} to {high})"


QUICK, FULL = 20_000, 1_000_000
"""Periods that are timed one by one."""
# By the text before the colon in the name of a part.
COLOURS = {"whole period": BLUE, "estimator": ORANGE, "integrator, two states": GREEN, "integrator, four states": GREEN}

CAPTION = """Nanoseconds per call: the bar is the median of 25 repeats in which all parts take turns; the line at
its end covers the middle half of the repeats."""
EXPLAINED = """Mean time of many calls in this Python process after a warm-up, and the median of 25 such repeats. A
scene pays only for the parts that it uses; the plan omits the rest. Single periods are timed too, with all
disturbances of the machine."""
MORE = '<div class="more"><a href="#cost">All {} scenes that were timed, and why</a></div>'
LATE = """Share of periods that this machine would have missed while the report was made: by computing alone, and
with the exchange on the bus (worst case, CAN at 1 Mbit/s) and computing in sequence, as in the loop. The bus, not
the computer, limits the rate."""


def cost_section(context: Context) -> Section:
    """Time all parts and the periods, and return their section."""
    plans = {scene: context.tools.plan(scene) for scene in (FEW_SCENES if context.quick else library_scenes())}
    found: list[OptionalPart] = []
    for each in parts(plans, context.bench):
        found.append(each)
        # The number of parts is not known before; about 60 fill most of the bar.
        context.progress(each.part, min(len(found) / 60, 0.9))
        row = {"part": each.part, "ns_per_step": each.ns_per_step, "ns_quartiles": each.ns_quartiles}
        context.add("optional_parts", row)
    context.costs.extend(each.cost for each in found if each.cost is not None)
    context.progress("deadlines", 0.9)
    late = deadlines(context.tools, QUICK if context.quick else FULL)
    document = svg(draw(found))
    costs = {scene: each.cost for scene, each in zip(plans, found, strict=False) if each.cost is not None}
    few = {scene: plans[scene] for scene in FEW_SCENES}
    single = [[part.part, *(1e-3 * ns for ns in (part.ns_per_step, *astuple(part.spread)))]
              for part in found if part.spread is not None]  # fmt: skip
    body = [
        scenes_part(plans, costs),
        "<h3>Time of each part</h3>",
        paragraph(EXPLAINED),
        picture("cost", document, CAPTION),
        table(("single periods [µs]", "median of means", "median", "99.9 %", "largest"), single),
        "<h3>Periods missed</h3>",
        paragraph(LATE),
        _late_table(late),
    ]
    return Section(
        "cost",
        "Omitted parts of each scene, and cost of each part",
        "".join(body),
        (scenes_finding(few, costs), _finding(found, late)),
        {"cost": document},
        asdict(late),
        Card("What does a scene omit?", lines(few, costs) + MORE.format(len(plans))),
    )


def _finding(found: Sequence[OptionalPart], late: RateDeadlines) -> str:
    whole = found[0]
    return (
        f"A whole period of the wall takes {rounded(1e-3 * whole.ns_per_step)} µs of computing (half of the repeats "
        f"{rounded(1e-3 * whole.ns_quartiles[0])} to {rounded(1e-3 * whole.ns_quartiles[2])}); its exchange on the bus "
        f"takes {1e6 * late.bus:.0f} µs."
    )


def draw(parts: Sequence[OptionalPart]) -> Figure:
    """Return a figure with a bar for each part, on a logarithmic scale."""
    drawn = figure(1.2 + 0.24 * len(parts))
    panel = drawn.subplots()
    for row, part in enumerate(parts):
        # At least 1 ns: a part that is a difference of two times can come out negative, and the scale is logarithmic.
        ends = [max(ns, 1.0) for ns in (part.ns_quartiles[0], part.ns_quartiles[2])]
        panel.plot(ends, [row, row], color="#222222", linewidth=1.2, solid_capstyle="butt")
        colour = COLOURS.get(part.part.partition(":")[0], SKY)
        panel.barh(row, max(part.ns_per_step, 1.0), color=colour, height=0.68)
        panel.text(max(part.ns_per_step, ends[1]) * 1.06, row, f"{part.ns_per_step:.0f}", va="center",
                   size=8.5, color="#444444")  # fmt: skip
    panel.set_yticks(range(len(parts)), [part.part for part in parts], fontsize=9)
    panel.invert_yaxis()
    panel.set_xscale("log")
    panel.set_xlim(20.0, 2.2 * max(part.ns_per_step for part in parts))
    panel.margins(y=0.01)
    dress(panel, "", "time per step [ns]", "")
    panel.grid(visible=False, axis="y")
    panel.tick_params(axis="y", color=GREY)
    return drawn


def _late_table(late: RateDeadlines) -> str:
    """Return the times of a period in words, and a table of missed periods at each rate."""
    shown = [number_text(1e6 * value) for value in (late.compute_p50, late.compute_p999, late.compute_max, late.bus)]
    times = (
        f"{late.periods} periods of <code>{SCENE}</code>: computing {shown[0]} µs (median), {shown[1]} µs (99.9 %), "
        f"{shown[2]} µs (largest); bus {shown[3]} µs."
    )
    rows: list[list[Entry]] = [
        [f"{exactly(each.rate)} Hz", _share(each.missed_computing), _share(each.missed)] for each in late.rates
    ]
    return paragraph(times) + table(("rate", "missed by computing alone", "missed with the bus"), rows)


def _share(value: float) -> Cell:
    """Return a share of missed periods; good only when none was missed."""
    if value in (0.0, 1.0):
        return Cell("every period", "bad") if value else Cell("0", "good")
    return Cell(percent(value), "bad")

"""What each scene leaves out: a line a scene on the first screen, and all of them with their reasons further down."""

from collections.abc import Mapping

from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.study.measure.timing import Cost
from haptic_fieldbus.study.page.html import folded, paragraph, table

EXPLAINED = """What a scene does not need is not imported, mapped, decoded, estimated or stepped. The time
is that of computing a whole period, the median of 25 repeats in which the scenes take turns, and the middle half of
the repeats. The image is what is read and written in a period, all axes together."""


def lines(plans: Mapping[str, Plan], costs: Mapping[str, Cost]) -> str:
    """Return a table with a line for each scene; `costs` are those of a whole period, by scene."""
    rows = [[scene, ", ".join(names(plan)) or "nothing", _micros(costs[scene])] for scene, plan in plans.items()]
    return table(("scene", "leaves out", "µs a period"), rows, text_columns=2)


def names(plan: Plan) -> list[str]:
    """Return the parts that the plan does without; an estimator goes with its velocity."""
    return list(dict.fromkeys(left.what for left in plan.left_out))


def reasons(plans: Mapping[str, Plan]) -> str:
    """Return a folded table of everything that each scene leaves out, with the reasons and the modules it imports."""
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
    return f"<h3>What each scene leaves out</h3>{paragraph(EXPLAINED)}{lines(plans, costs)}{reasons(plans)}"


def scenes_finding(plans: Mapping[str, Plan], costs: Mapping[str, Cost]) -> str:
    """Return what is done with parts that are left out, and the times of the cheapest and the dearest scene."""
    least, most = (side(plans, key=lambda scene: costs[scene].ns) for side in (min, max))
    return (
        f"What is not asked for is not imported, mapped, decoded or stepped: computing a period of "
        f"<code>{least}</code> takes {rounded(1e-3 * costs[least].ns, 2)} µs, of <code>{most}</code> "
        f"({len(plans[most].axes)} axes) {rounded(1e-3 * costs[most].ns, 2)} µs."
    )


def _octets(plan: Plan) -> int:
    """Return the number of octets of the mapped signals of all axes, in and out."""
    return sum(axis.inputs[1] + axis.outputs[1] for axis in plan.image.axes)


def _micros(cost: Cost) -> str:
    """Return the median and the middle half of the passes [µs]."""
    low, _, high = (rounded(1e-3 * ns) for ns in cost.quartiles)
    return f"{rounded(1e-3 * cost.ns)} ({low} to {high})"

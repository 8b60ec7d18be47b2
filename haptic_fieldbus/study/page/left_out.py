"""What each scene leaves out: a line a scene on the first screen, and all of them with their reasons further down."""

from collections.abc import Mapping

from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.study.page.html import Entry, folded, paragraph, table

EXPLAINED = """What a scene does not need is not imported, mapped, decoded, estimated or stepped. The octets are those
of the process image, in and out, all axes together; the time is that of computing a whole period, the shortest of 25
repeats in which the scenes take turns."""


def lines(plans: Mapping[str, Plan], costs: Mapping[str, float]) -> str:
    """Return a table with a line for each scene; `costs` are those of a whole period [ns], by scene."""
    rows = [[scene, ", ".join(names(plan)) or "nothing", _octets(plan), rounded(1e-3 * costs[scene])]
            for scene, plan in plans.items()]  # fmt: skip
    return table(("scene", "leaves out", "octets in, out", "µs"), rows, text_columns=2)


def names(plan: Plan) -> list[str]:
    """Return the parts that the plan does without; an estimator goes with its velocity."""
    return list(dict.fromkeys(left.what for left in plan.left_out))


def reasons(plans: Mapping[str, Plan]) -> str:
    """Return a folded table of everything that each scene leaves out, with the reasons and the modules it imports."""
    rows: list[list[Entry]] = [
        [scene, "; ".join(f"{left.what}: {left.why}" for left in plan.left_out) or "nothing",
         ", ".join(module.removeprefix("haptic_fieldbus.") for module in plan.modules)]
        for scene, plan in plans.items()
    ]  # fmt: skip
    told = table(("scene", "leaves out, and why", "imports, of the optional modules"), rows, text_columns=3)
    return folded("Why, scene by scene", told)


def part(plans: Mapping[str, Plan], costs: Mapping[str, float]) -> str:
    """Return the part of a section on all scenes."""
    return f"<h3>What each scene leaves out</h3>{paragraph(EXPLAINED)}{lines(plans, costs)}{reasons(plans)}"


def finding(plans: Mapping[str, Plan], costs: Mapping[str, float]) -> str:
    """Return what is done with parts that are left out, and the times of the cheapest and the dearest scene."""
    least, most = (side(costs, key=lambda scene: costs[scene]) for side in (min, max))
    return (
        f"What is not asked for is not imported, mapped, decoded or stepped: computing a period of "
        f"<code>{least}</code> takes {rounded(1e-3 * costs[least], 2)} µs, of <code>{most}</code> "
        f"({len(plans[most].axes)} axes) {rounded(1e-3 * costs[most], 2)} µs."
    )


def _octets(plan: Plan) -> str:
    """Return the octets of the mapped signals of all axes, in and out."""
    inward, outward = zip(*((axis.inputs[1], axis.outputs[1]) for axis in plan.image.axes), strict=True)
    return f"{sum(inward)}, {sum(outward)}"

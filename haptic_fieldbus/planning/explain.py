"""A plan in words: mapped objects, steps of a period, parts left out, load, delay, deadlines and stability.

Golden files keep this text for each scene, and for each profile.
"""

import math
from collections.abc import Iterator

from haptic_fieldbus.margins import Stability
from haptic_fieldbus.margins.cautious import Cautious, Obstacle
from haptic_fieldbus.margins.contact import stiffness_of
from haptic_fieldbus.numerals import in_unit, rounded, rounded_down, rounded_limit
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.deadlines import REMAINDER, unseen_text
from haptic_fieldbus.planning.enabling import enabling_lines
from haptic_fieldbus.planning.encoder_probe import encoder_lines
from haptic_fieldbus.planning.guards import guard_lines
from haptic_fieldbus.planning.limit_table import limit_lines, recommended_limits
from haptic_fieldbus.planning.plan import BusPlan, Plan
from haptic_fieldbus.planning.refusal import own_law_texts, softer
from haptic_fieldbus.planning.ways import way_limits
from haptic_fieldbus.signals import Workspace

KEY_WIDTH = 11


def explain(plan: Plan) -> str:
    """Return the plan in words: lines of a key and a text each, without a final newline."""
    return "\n".join(f"{key:{KEY_WIDTH}}{text}".rstrip() for key, text in _lines(plan))


def _lines(plan: Plan) -> Iterator[tuple[str, str]]:
    yield "scene", f"{plan.scene.name}: {plan.scene.description}"
    for axis in plan.axes:
        yield "axis", _axis(axis)
    for bus in plan.buses:
        yield "bus", _bus(plan, bus)
        for axis in plan.on(bus).axes:
            yield from axis.traffic.lines()
    yield from _listed("steps", [f"{number}  {step}" for number, step in enumerate(plan.steps, start=1)])
    yield from _listed("modules", list(plan.modules))
    yield from _listed("left out", [f"{left.what}: {left.why}" for left in plan.left_out])
    for axis in plan.axes:
        prefix = f"{axis.name}: " if len(plan.axes) > 1 else ""
        yield from _listed("limits", [prefix + line for line in limit_lines(axis, plan.period)])
    if plan.rig.source:  # the shipped bench is nobody's, and has no file to write them into
        yield from _listed("advice", [text for axis in plan.axes if (text := recommended_limits(axis))])
    for axis in plan.axes:
        prefix = f"{axis.name}: " if len(plan.axes) > 1 else ""
        yield from _listed("encoder", [prefix + line for line in encoder_lines(axis, plan.period)])
    yield from _listed("guard", list(guard_lines(plan.guards, simulated=plan.simulated)))
    yield from _listed("enabling", list(enabling_lines(plan.axes)))
    yield "delay", delay_text(plan)
    yield from _listed("ways", [way.text() for way in way_limits(plan)])
    yield from _listed("assumed", list(plan.assumed))
    yield from _listed("deadlines", list(deadline_texts(plan)))
    yield from _listed("unseen", [text for axis in plan.axes if (text := unseen_text(axis, plan.period))])
    yield from _listed("coupling", [str(ages) for ages in plan.coupling_ages])
    yield from _stability(plan)


def _axis(axis: AxisPlan) -> str:
    effort = f"at most {in_unit(axis.limits.effort, axis.workspace.effort_unit)}"
    return f"{axis.name}: {axis.profile.title}, node {axis.node}, {axis.workspace.value}, {effort}"


def _bus(plan: Plan, bus: BusPlan) -> str:
    """Return the line of a bus; its name and axes are given only when the plan has several buses."""
    name, axes = (f"{bus.name}: ", f", axes {', '.join(bus.axes)}") if len(plan.buses) > 1 else ("", "")
    return f"{name}{bus.traffic.line()}{axes}"


def _listed(key: str, texts: list[str]) -> Iterator[tuple[str, str]]:
    """Yield one line for each text, with the key on the first line only."""
    for position, text in enumerate(texts):
        yield (key if position == 0 else ""), text


def delay_text(plan: Plan) -> str:
    """Return the delay budget in one line [ms]."""
    delay = plan.delay
    parts = ", ".join(
        f"{name} {rounded(1e3 * part)}"
        for name, part in (
            ("bus", delay.bus),
            ("compute", delay.compute),
            ("drive", delay.drive),
            ("torque loop", delay.torque_loop),
        )
    )
    # 500·T is T/2 in ms.
    return f"{rounded(1e3 * delay.total)} ms: {parts}; the hold adds T/2 = {rounded(500 * plan.period)}"


def deadline_texts(plan: Plan) -> Iterator[str]:
    """Yield what zero torque means, then a line for each cause with its longest time [ms] and the way to zero."""
    yield f"longest time from the event to zero torque ({100 * REMAINDER:g} % of it left), a late host not counted:"
    for each in plan.deadlines:
        yield f"{each.cause.value}: {milliseconds(each.seconds)}, {each.how}"


def milliseconds(seconds: float) -> str:
    """Return a time in words [ms], rounded up to a tenth; inf is no time."""
    return f"{math.ceil(1e4 * seconds - 1e-6) / 10:g} ms" if math.isfinite(seconds) else "without end"


def _stability(plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield the verdict on the weakest axis, with its limits when a stiffness can be varied."""
    axis, stability = plan.weakest, plan.stability
    if axis is None or stability is None:
        yield "stability", "unknown: the rig does not give inertia and viscous_damping"
        return
    limit = stability.stiffness_limit
    if stability.stiffness is None or limit.stable is None or limit.passive is None:
        yield "stability", stability.verdict.value
        yield from (("", text) for text in place_texts(stability, axis.workspace))
        return
    per = f"{axis.workspace.effort_unit}/{axis.workspace.length_unit}"
    limits = f"stable {_up_to(limit.stable)}, passive {_up_to(limit.passive)}"
    yield "stability", f"{stability.verdict.value}: {rounded_limit(stability.stiffness)} {per} asked, {limits}"
    yield from (("", text) for text in place_texts(stability, axis.workspace))
    if stability.cautious is not None:
        yield "", f"cautious {_up_to(stability.cautious.stable)}: {cautious_text(stability.cautious, axis.workspace)}"
        if stability.cautious.obstacle is not None:
            yield "", obstacle_text(stability.cautious.obstacle, axis.workspace)
    if stability.recommended is not None:
        yield "", f"recommended up to {rounded_limit(stability.recommended)} {per}"


def place_texts(stability: Stability, workspace: Workspace) -> Iterator[str]:
    """Yield the worst of several resting places, the place where the ideal pushes on the most, and what was read."""
    length, per = workspace.length_unit, f"{workspace.effort_unit}/{workspace.length_unit}"
    place, crest = stability.place, stability.crest
    if place is not None and place.among > 1 and place.position is not None:
        damping = f" and {rounded(place.damping)} {workspace.effort_unit}·s/{length}" if place.damping else ""
        held = in_unit(stability.effort, workspace.effort_unit) if math.isfinite(stability.effort) else "the elements"
        yield (
            f"worst of the places that {held} can hold: "
            f"{in_unit(place.position, length)}, {rounded_limit(place.stiffness)} {per}{damping}, "
            f"a motion is multiplied by {rounded(place.growth, 6)} in a period"
        )
    if crest is not None and crest.position is not None and crest.ideal is not None:
        yield (
            f"at {in_unit(crest.position, length)} nothing can rest: the ideal itself is multiplied by "
            f"{rounded(crest.ideal, 6)} in a period, this loop by {rounded(crest.growth, 6)}"
        )
    yield from (text for _, text in own_law_texts(stability, workspace))


def cautious_text(least: Cautious, workspace: Workspace) -> str:
    """Return the values at which the cautious limit is judged, as long as nothing else is known."""
    effort, travel = workspace.effort_unit, workspace.length_unit
    mass = "kg" if workspace is Workspace.LINEAR else "kg·m²"
    at = [
        f"mass {rounded(each.plant.mass)} {mass}, damping {rounded(each.plant.damping)} {effort}·s/{travel}, "
        f"torque loop {rounded(1e3 * each.plant.torque_lag)} ms, delay {rounded(1e3 * each.delay)} ms"
        + (f", coupling {rounded(each.coupling)} times as stiff" if each.coupling != 1.0 else "")
        for each in least.judged_at
    ]
    return f"the worst of the ranges, {'; '.join(at)}"


def obstacle_text(obstacle: Obstacle, workspace: Workspace) -> str:
    """Return which other element leaves no stiffness to the one that varies, and what to set."""
    per, element = f"{workspace.effort_unit}/{workspace.length_unit}", obstacle.element
    return (
        f"none is left for {obstacle.beside}: without it, too, {element.name} is above its cautious limit, "
        f"{rounded_limit(stiffness_of(element))} of {rounded_limit(obstacle.limit)} {per}; inside would be "
        f"{softer(element, rounded_down(obstacle.limit))}"
    )


def _up_to(limit: float) -> str:
    if limit <= 0.0:
        return "at no stiffness"
    return f"to {rounded_limit(limit)}" if math.isfinite(limit) else "with no limit"

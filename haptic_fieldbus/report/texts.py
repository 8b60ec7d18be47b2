"""Plan and result in words, as lines of a key and a text, for the terminal and for the title of a picture."""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, cast

from haptic_fieldbus.assessing.result import (
    Result,
    change_text,
    error_sizes,
    length,
    load_text,
    periods_text,
    result_rows,
)
from haptic_fieldbus.drive.rig import LinearMechanism
from haptic_fieldbus.numerals import Line, OutputRow, exactly, lines_of
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.deadlines import enabling_lines
from haptic_fieldbus.planning.explain import delay_text, limit_text, milliseconds
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import way_limits
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.registry import quantities
from haptic_fieldbus.scenes.scene import axes_of
from haptic_fieldbus.signals import Workspace


def announcement(plan: Plan, changes: Iterable[tuple[float, Mapping[str, object]]] = ()) -> list[Line]:
    """Return lines on the run to come: scene, bench, plan, delay and stability, and the scheduled changes."""
    rows = [
        OutputRow("scene", [scene_text(plan)]),
        OutputRow("bench", (bench_text(plan, axis) for axis in plan.axes)),
        OutputRow("cap", (f"{axis.name}: {axis.cap}" for axis in plan.axes if axis.cap)),
        OutputRow("plan", (text for axis in plan.axes for text in axis.traffic.summary())),
        OutputRow("plan", [f"left out: {', '.join(left.what for left in plan.left_out) or 'nothing'}"]),
        OutputRow("enabling", enabling_lines(plan.axes)),
        OutputRow("delay", [delay_text(plan.delay, plan.period)]),
        OutputRow("ways", (way.text() for way in way_limits(plan))),
        OutputRow("assumed", plan.assumed),
        OutputRow("deadlines", [deadlines_text(plan)]),
        OutputRow("coupling", map(str, plan.coupling_ages)),
        OutputRow("limit", [limit_text(plan.stability)]),
        OutputRow("changes", (change_text(time, settings) for time, settings in changes)),
    ]
    return lines_of(rows, once=True)


def outcome(result: Result) -> list[Line]:
    """Return lines on a run as far as its figures are known; the reason of a trip stands in the error's own message."""
    return lines_of(result_rows(result), once=True)


def deadlines_text(plan: Plan) -> str:
    """Return the longest times to zero torque in one line, causes with the same time together."""
    causes: dict[str, list[str]] = {}
    for each in plan.deadlines:
        causes.setdefault(milliseconds(each.seconds), []).append(each.cause.value)
    return "zero torque within " + "; ".join(f"{time}: {', '.join(names)}" for time, names in causes.items())


def scene_text(plan: Plan) -> str:
    """Return the name of the scene and its elements, each named when there are several."""
    spaces = {axis.name: axis.workspace for axis in plan.axes}
    elements = plan.scene.elements
    parts = [_element_text(element, spaces[axes_of(element)[0]]) for element in elements]
    if len(parts) > 1:
        named = zip(elements, parts, strict=True)
        parts = [text if text == each.name else f"{each.name} {text}" for each, text in named]
    return f"{plan.scene.name}: {'; '.join(parts) or 'free, no element'}"


def _element_text(element: AnyElement, workspace: Workspace) -> str:
    """Return the numbers of an element in the order of its fields, without those that are 0 or at their default."""
    units = {name: measured.unit(workspace) for name, measured in quantities(type(element)).items()}
    kept = {field.name: field.default for field in fields(cast(Any, element))}
    values = {name: getattr(element, name) for name in units}
    parts = [
        f"{name.replace('_', ' ')} {exactly(value)} {units[name]}".rstrip()
        for name, value in values.items()
        if value and value != kept[name] and name != "position"
    ]
    where = f" at {length(values['position'], workspace)}" if "position" in values else ""
    return f"{', '.join(parts)}{where}" or element.name


def parameter_units(workspace: Workspace) -> dict[str, str]:
    """Return the units of stiffness, damping and mass in a workspace."""
    effort, travel = workspace.effort_unit, workspace.length_unit
    return {
        "stiffness": f"{effort}/{travel}",
        "damping": f"{effort}·s/{travel}",
        "mass": "kg" if workspace is Workspace.LINEAR else "kg·m²",
    }


def bench_text(plan: Plan, axis: AxisPlan) -> str:
    """Return drive, link, node, rate, encoder and mechanism of an axis in one line."""
    rig, bus = axis.rig, plan.rig.bus[axis.rig.bus]
    link = "simulated" if plan.simulated else f"{bus.interface} {bus.channel}"
    place = f"bus {rig.bus}, node {axis.node}" if len(plan.buses) > 1 else f"node {axis.node}"
    mechanism = rig.mechanism
    travel = (
        f"{exactly(mechanism.metres_per_revolution)} m/rev"
        if isinstance(mechanism, LinearMechanism)
        else f"gear {exactly(mechanism.gear_ratio)}"
    )
    known = (
        f"{exactly(rig.inertia)} kg·m², {exactly(rig.viscous_damping)} N·m·s/rad"
        if rig.inertia is not None and rig.viscous_damping is not None
        else "inertia and damping unknown"
    )
    speed = f"{next(each.traffic.speed for each in plan.buses if each.name == rig.bus)}, {exactly(plan.rate)} Hz"
    encoder = f"{rig.encoder_counts_per_revolution} counts/rev"
    return f"{axis.profile.title} ({link}), {place}, {speed} · {encoder}, {travel}, {known}"


def key_figures(result: Result) -> str:
    """Return the line below the title of a picture."""
    parts = [f"{result.scene} on {result.drive}, {result.bus}, {exactly(result.rate)} Hz", periods_text(result)]
    if result.torque_error is not None:
        parts.append(error_sizes(result.torque_error))
    return " · ".join(parts) + load_text(result)

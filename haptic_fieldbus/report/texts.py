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
from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.drive.profile import MappedSignal
from haptic_fieldbus.drive.rig import LinearMechanism
from haptic_fieldbus.numerals import Line, OutputRow, as_typed, exactly, lines_of
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.deadlines import enabling_lines
from haptic_fieldbus.planning.explain import deadline_texts, delay_text, limit_text, place_texts, verdict_texts
from haptic_fieldbus.planning.plan import Plan, assumed_texts
from haptic_fieldbus.planning.refusal import way_limits
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.registry import quantities
from haptic_fieldbus.scenes.scene import axes_of
from haptic_fieldbus.signals import Signal, Workspace


def announcement(
    plan: Plan, changes: Iterable[tuple[float, Mapping[str, object]]] = (), *, verbose: bool = False
) -> list[Line]:
    """Return lines on the run to come: scene, bench, signals, limit and the scheduled changes.

    Caps and warnings are always included. A `verbose` text has traffic, delay, deadlines and the stability limits too.
    """
    weakest, found = plan.weakest, plan.stability
    places = [] if weakest is None or found is None else place_texts(found, weakest.workspace)
    changing = "; ".join(change_text(time, settings) for time, settings in changes)
    rows = [
        OutputRow("scene", [scene_text(plan)], cut=True),
        OutputRow("bench", [bench_text(plan)], cut=True),
        OutputRow("bench", (axis_text(axis) for axis in plan.axes), detail=True),
        OutputRow("cap", (f"{axis.name}: {axis.cap}" for axis in plan.axes if axis.cap)),
        OutputRow("warning", enabling_lines(plan.axes)),
        OutputRow("sends", [signals_text(plan)], cut=True),
        OutputRow("sends", (text for axis in plan.axes for text in axis.traffic.summary()), detail=True),
        OutputRow("left out", [", ".join(left.what for left in plan.left_out) or "nothing"], detail=True),
        OutputRow("delay", [delay_text(plan.delay, plan.period)], detail=True),
        OutputRow("ways", (way.text() for way in way_limits(plan)), detail=True),
        OutputRow("assumed", assumed_texts(plan.assumed), detail=True),
        OutputRow("deadlines", deadline_texts(plan), detail=True),
        OutputRow("coupling", map(str, plan.coupling_ages), detail=True),
        OutputRow("limit", [limit_text(plan.stability)]),
        OutputRow("limit at", places, detail=True),
        OutputRow("stability", verdict_texts(plan), detail=True),
        OutputRow("changes", [changing] if changing else [], cut=True),
    ]
    return lines_of(rows, once=True, short=not verbose)


def outcome(result: Result, *, verbose: bool = False) -> list[Line]:
    """Return lines on the known figures of a run; the reason of a trip is in the error's own message."""
    return lines_of(result_rows(result), once=True, short=not verbose)


def scene_text(plan: Plan) -> str:
    """Return the name of the scene and its elements, with their names if there are several."""
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
        f"{name.replace('_', ' ')} {as_typed(value)} {units[name]}".rstrip()
        for name, value in values.items()
        if value and value != kept[name] and name != "position"
    ]
    where = f" at {length(values['position'], workspace)}" if "position" in values else ""
    return f"{', '.join(parts)}{where}" or element.name


def parameter_units(workspace: Workspace) -> dict[str, str]:
    """Return the units of stiffness, damping and mass in a workspace."""
    told = Quantity.STIFFNESS, Quantity.DAMPING, Quantity.MASS
    return {each.name.lower(): each.unit(workspace) for each in told}


def bench_text(plan: Plan) -> str:
    """Return drives, links, nodes and rate in one line; axes with the same drive on the same bus are grouped."""
    nodes: dict[tuple[str, str, str], list[int]] = {}
    for axis in plan.axes:
        bus = plan.rig.bus[axis.rig.bus]
        link = "simulated" if plan.simulated else f"{bus.interface} {bus.channel}"
        place = f"bus {axis.rig.bus}, " if len(plan.buses) > 1 else ""
        speed = next(each.traffic.speed for each in plan.buses if each.name == axis.rig.bus)
        nodes.setdefault((f"{axis.profile.title} ({link})", place, speed), []).append(axis.node)
    drives = [f"{drive}, {place}{_nodes(found)}, {speed}" for (drive, place, speed), found in nodes.items()]
    rate = f"{exactly(plan.rate)} Hz"
    return f"{drives[0]}, {rate}" if len(drives) == 1 else f"{rate}; {'; '.join(drives)}"


def _nodes(nodes: list[int]) -> str:
    """Return node-IDs in words: node 1, nodes 1 and 2, nodes 1 to 6."""
    if len(nodes) == 1:
        return f"node {nodes[0]}"
    if len(nodes) > 2 and nodes == list(range(nodes[0], nodes[-1] + 1)):
        return f"nodes {nodes[0]} to {nodes[-1]}"
    return f"nodes {' and '.join([', '.join(map(str, nodes[:-1])), str(nodes[-1])])}"


def axis_text(axis: AxisPlan) -> str:
    """Return encoder, mechanism and plant of an axis in one line."""
    rig, mechanism, bench = axis.rig, axis.rig.mechanism, axis.bench
    travel = (
        f"{as_typed(mechanism.metres_per_revolution)} m/rev"
        if isinstance(mechanism, LinearMechanism)
        else f"gear {as_typed(mechanism.gear_ratio)}"
    )
    known = (
        f"{as_typed(bench.inertia)} kg·m², {as_typed(bench.viscous_damping)} N·m·s/rad"
        if bench.inertia is not None and bench.viscous_damping is not None
        else "inertia or damping unknown"
    )
    return f"{axis.name}: {rig.encoder_counts_per_revolution} counts/rev, {travel}, {known}"


def signals_text(plan: Plan) -> str:
    """Return the signals sent to the drives and read from them; axes with the same signals are grouped."""
    axes: dict[str, list[str]] = {}
    for axis in plan.axes:
        sent, read = (_signals(mapped) for mapped in (axis.outgoing, axis.incoming))
        axes.setdefault(f"{sent}; reads {read}", []).append(axis.name)
    return "; ".join(text if len(axes) == 1 else f"{', '.join(names)}: {text}" for text, names in axes.items())


def _signals(mapped: Iterable[MappedSignal]) -> str:
    # The age of an answer is counted by the bus, and is on no wire.
    return ", ".join(each.signal.value for each in mapped if each.signal is not Signal.ASKED_PERIODS)


def key_figures(result: Result) -> str:
    """Return the line below the title of a picture."""
    place = ", ".join(filter(None, [result.drive, result.bus, f"{exactly(result.rate)} Hz"]))
    parts = [f"{result.scene} on {place}", periods_text(result)]
    if result.torque_error is not None:
        parts.append(error_sizes(result.torque_error))
    return " · ".join(filter(None, [*parts, load_text(result)]))

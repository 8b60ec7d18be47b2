"""Plan and result in words, as lines of a key and a text, for the terminal and for the title of a picture."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from itertools import chain
from typing import Any, cast

from haptic_fieldbus.assessing.passivity import cost_text, forgiven_text
from haptic_fieldbus.assessing.result import Percentiles, Result, TorqueError, rights_texts
from haptic_fieldbus.assessing.travel import Travel
from haptic_fieldbus.drive.rig import LinearMechanism
from haptic_fieldbus.margins import Stability, Verdict
from haptic_fieldbus.numerals import DIGITS, exactly, in_unit, percent, rounded, rounded_down, rounded_limit
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.deadlines import enabling_lines
from haptic_fieldbus.planning.explain import delay_text, milliseconds, obstacle_text
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import way_limits
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.registry import quantities
from haptic_fieldbus.scenes.scene import axes_of
from haptic_fieldbus.signals import Workspace

Line = tuple[str, str]
"""A key and a text; an empty key continues the line before."""

WORTH_NAMING = 0.01
"""Smallest share with which a source of error, or of load, is named."""


def announcement(plan: Plan, changes: Iterable[tuple[float, Mapping[str, object]]] = ()) -> list[Line]:
    """Return lines on the run to come: scene, bench, plan, delay and stability, and the scheduled changes."""
    lines = [("changes", change_text(time, settings)) for time, settings in changes]
    return _keys_once(chain(_announcement(plan), lines))


def outcome(result: Result) -> list[Line]:
    """Return lines on a run as far as its figures are known; the reason of a trip stands in the error's own message."""
    return _keys_once(_outcome(result))


def _keys_once(lines: Iterable[Line]) -> list[Line]:
    """Return the lines with an empty key in place of a repeated one."""
    once: list[Line] = []
    before = ""
    for key, text in lines:
        once.append(("" if key == before else key, text))
        before = key
    return once


def _announcement(plan: Plan) -> Iterator[Line]:
    yield "scene", scene_text(plan)
    yield from (("bench", bench_text(plan, axis)) for axis in plan.axes)
    yield from (("limit", f"{axis.name}: {axis.cap}") for axis in plan.axes if axis.cap)
    for axis in plan.axes:
        for text in axis.traffic.summary():
            yield "plan", text
    yield "plan", f"left out: {', '.join(left.what for left in plan.left_out) or 'nothing'}"
    for text in enabling_lines(plan.axes):
        yield "enabling", text
    yield "delay", delay_text(plan)
    for way in way_limits(plan):
        yield "ways", way.text()
    for text in plan.assumed:
        yield "assumed", text
    yield "deadlines", deadlines_text(plan)
    for ages in plan.coupling_ages:
        yield "coupling", str(ages)
    yield "stability", stability_text(plan)


def _outcome(result: Result) -> Iterator[Line]:
    for proof in result.proofs:
        yield "guard", str(proof)
    if result.cycles:
        yield "result", f"{periods_text(result)}{_load_text(result)}{_speed_text(result)}"
        yield from (("result", text) for text in times_texts(result))
    for each in result.travel:
        yield "result", travel_text(each)
    if result.torque_error is not None:
        yield "result", f"{error_sizes(result.torque_error)}{_sources_text(result.torque_error)}"
    if result.verdict is not None:  # only a run that went to its end has a verdict, so nothing tripped
        yield "result", f"{energy_text(result.energy_generated)}no trip"
        yield "verdict", result.verdict
    for told in (forgiven_text, cost_text):
        yield from (("passivity", text) for text in filter(None, map(told, result.passivity)))
    for change in result.changes:
        yield "changed", change_text(change.time, change.settings)
    for text in rights_texts(result.host):
        yield "host", text
    for warning in result.warnings:
        yield "warning", warning


def travel_text(travel: Travel) -> str:
    """Return how far a handle went, in steps that a hand could tell from the whole, and how deep into what."""
    most = max(abs(travel.lowest), abs(travel.highest))
    decimals = DIGITS - 1 - math.floor(math.log10(most)) if most else 0
    lowest, highest = (length(round(end, decimals), travel.workspace) for end in (travel.lowest, travel.highest))
    deep = [
        f"{length(float(rounded(depth)), travel.workspace)} deep in {name}"
        for name, depth in travel.depth.items()
        if depth
    ]
    way = f"stayed at {highest}" if lowest == highest else f"from {lowest.partition(' ')[0]} to {highest}"
    return ", ".join([f"{travel.axis} {way}", *deep])


def change_text(time: float, settings: Mapping[str, object]) -> str:
    """Return the time of a change [s from operation enabled] and its new values."""
    texts = {key: exactly(value) if isinstance(value, float) else value for key, value in settings.items()}
    values = [f"{key}={text}" for key, text in texts.items()]
    return f"at {exactly(time)} s {', '.join(values)}"


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


def stability_text(plan: Plan) -> str:
    """Return the verdict on the axis with the smallest margin, with limits and margin as far as they are known."""
    axis, stability = plan.weakest, plan.stability
    if axis is None or stability is None:
        return "unknown: the rig does not give inertia and viscous_damping"
    stable, verdict = stability.stiffness_limit.stable, stability.verdict.value
    if stability.verdict is Verdict.STABLE and math.isfinite(stability.effort):
        verdict = f"stable at every resting place up to {in_unit(stability.effort, axis.workspace.effort_unit)}"
    if stable is None or stability.stiffness is None:
        return verdict
    asked = f"you ask {rounded_limit(stability.stiffness)}: {verdict}"
    if math.isinf(stable):
        return f"stable with no limit on this bench; {asked}"
    unit = f"{axis.workspace.effort_unit}/{axis.workspace.length_unit}"
    limits = f"stable to {rounded_limit(stable)} {unit} on this bench{_passive_text(stability)}"
    return f"{limits}; {asked}{_margin_text(stability)}{_cautious_text(stability, axis.workspace)}"


def _cautious_text(stability: Stability, workspace: Workspace) -> str:
    """Return the cautious limit, and whether more is asked; empty when there is none."""
    least = stability.cautious
    if least is None or math.isinf(least.stable) or stability.stiffness is None:
        return ""
    if not least.stable:
        found = "no stiffness would be inside" if least.obstacle is None else obstacle_text(least.obstacle, workspace)
        return f"; above the cautious limit: {found}"
    limit = f"cautious limit {rounded_limit(least.stable)}"
    if stability.stiffness <= least.stable:
        return f"; {limit}"
    return f"; above the {limit}, {exactly(rounded_down(least.stable))} would be inside"


def _passive_text(stability: Stability) -> str:
    """Return the limit of passivity in brackets; empty when it is unknown."""
    passive = stability.stiffness_limit.passive
    if passive is None:
        return ""
    return f" (passive to {rounded_limit(passive)})" if passive else " (passive at none)"


def _margin_text(stability: Stability) -> str:
    return f", margin {rounded(stability.margin)}" if stability.margin is not None else ""


def periods_text(result: Result) -> str:
    """Return the number of periods, and how many were missed or began late."""
    missed, timing = result.missed_cycles or 0, result.timing
    words = f"{result.cycles or 0} periods, {missed or 'none'} missed"
    if timing is None or timing.lateness_us is None or not timing.late:
        return words
    lateness = timing.lateness_us
    most, longest = milliseconds(1e-6 * lateness.p999), milliseconds(1e-6 * lateness.max)
    return f"{words}, {timing.late} late (99.9 % by at most {most}, the latest by {longest})"


def times_texts(result: Result) -> Iterator[str]:
    """Yield how late the periods of a run in real time began, and how old its feedback was; nothing in virtual time."""
    if result.clock == "virtual" or result.periods is None or result.timing is None:
        return
    named = (("began late by", result.timing.lateness_us), ("age of the feedback", result.timing.age_us))
    texts = [f"{name} {_percentiles_text(times)}" for name, times in named if times is not None]
    if texts:
        yield "; ".join(texts)


def _percentiles_text(times: Percentiles) -> str:
    """Return the median, two percentiles and the maximum of a time."""
    shares = ((times.p50, "median"), (times.p99, "99 %"), (times.p999, "99.9 %"), (times.max, "at most"))
    return ", ".join(f"{milliseconds(1e-6 * value)} ({share})" for value, share in shares)


def _load_text(result: Result) -> str:
    if result.bus_load is None:
        return ""
    others = result.bus_load - (result.plan.bus_load if result.plan is not None else result.bus_load)
    of_it = f", {percent(others)} of it by other devices" if others >= WORTH_NAMING else ""
    return f" · bus load {percent(result.bus_load)}{of_it}"


def _speed_text(result: Result) -> str:
    """Return simulated time and wall-clock time; empty for a run that was not in virtual time."""
    if result.clock != "virtual" or not result.elapsed or not result.duration:
        return ""
    return f" · {rounded(result.duration)} s in {rounded(result.elapsed)} s"


def error_sizes(error: TorqueError) -> str:
    """Return rms and largest error with their unit."""
    name = "force" if error.unit == "N" else "torque"
    return f"{name} error {in_unit(error.rms, error.unit)} rms, {in_unit(error.max, error.unit)} max"


def _sources_text(error: TorqueError) -> str:
    """Return the sources with a considerable share in brackets, the largest first; empty when there is none."""
    by_size = sorted(error.by_source.items(), key=lambda item: -abs(item[1]))
    named = [f"{name} {percent(share)}" for name, share in by_size if abs(share) >= WORTH_NAMING]
    return f" ({', '.join(named)})" if named else ""


def energy_text(energy: float | None) -> str:
    """Return the work that the error did on the hand [J]: more or less than the ideal; empty when unknown or 0."""
    if not energy:
        return ""
    way = "gives the hand" if energy > 0.0 else "takes from the hand"
    return f"{way} {in_unit(abs(energy), 'J')} more than the ideal · "


def key_figures(result: Result) -> str:
    """Return the line below the title of a picture."""
    parts = [f"{result.scene} on {result.drive}, {result.bus}, {exactly(result.rate)} Hz", periods_text(result)]
    if result.torque_error is not None:
        parts.append(error_sizes(result.torque_error))
    return " · ".join(parts) + _load_text(result)


def length(value: float, workspace: Workspace) -> str:
    """Return a position in the workspace [m or rad], metres shown in millimetres."""
    return f"{exactly(1e3 * value)} mm" if workspace is Workspace.LINEAR else f"{exactly(value)} rad"

"""A plan in words: mapped objects, steps of a period, parts left out, load, delay, deadlines and stability.

Golden files keep this text for each scene, and for each profile.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import cast

from haptic_fieldbus.margins import Stability, Verdict
from haptic_fieldbus.margins.closed_loop import stiffness_of
from haptic_fieldbus.margins.group import Group
from haptic_fieldbus.margins.limit import Obstacle
from haptic_fieldbus.numerals import (
    KEY_WIDTH,
    TYPED_DIGITS,
    OutputRow,
    exactly,
    in_unit,
    lines_of,
    object_of,
    rounded,
    rounded_down,
    rounded_limit,
)
from haptic_fieldbus.planning import refusal
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.deadlines import REMAINDER, enabling_lines, unseen_text
from haptic_fieldbus.planning.encoder_probe import encoder_lines, encoder_probe
from haptic_fieldbus.planning.guards import guard_lines
from haptic_fieldbus.planning.known_bench import measured_texts
from haptic_fieldbus.planning.limits import (
    FIRST_SHARE,
    FIRST_SPEED,
    HELD_ENERGY,
    HELD_POWER,
    LARGEST_MISSING_SHARE,
    START_SHARE,
)
from haptic_fieldbus.planning.plan import Plan, assumed_texts
from haptic_fieldbus.planning.sign_probe import is_checked, sign_probe
from haptic_fieldbus.protocols.registry import TRAFFIC_KEYS
from haptic_fieldbus.protocols.traffic import Delay, Json
from haptic_fieldbus.signals import Workspace

# The limits of an axis as people and scripts read them: value, reaction, and how long it takes.
#
# A clamping limit acts on the set-point of the same period. A tripping limit trips in the period that shows the excess.
# The time from there to zero torque is not in this table, but in `deadlines`.


class Reaction(Enum):
    """Reaction at a limit; the value is the name that users and scripts see."""

    CLAMP = "clamp"
    FADE = "fade"
    REFUSE = "refuse"
    DISABLE = "disable"


@dataclass(frozen=True)
class LimitRow:
    """One limit of an axis; `time` [s] is the time for which it must be exceeded, 0 for one period."""

    name: str
    value: float
    unit: str
    reaction: Reaction
    time: float = 0.0

    def to_json(self, axis: AxisPlan) -> Json:
        """Return the object of `plan --json`."""
        told: dict[str, Json] = {"axis": axis.name, "limit": self.name, "value": self.value, "unit": self.unit}
        return {**told, "reaction": self.reaction.value, "after_s": self.time}


def limit_rows(axis: AxisPlan, period: float) -> Iterator[LimitRow]:
    """Yield the finite limits of this axis, in the order in which they act on a force."""
    limits, force, length = axis.limits, axis.workspace.effort_unit, axis.workspace.length_unit
    judged = 1.0 if math.isfinite(limits.energy) else math.inf
    jump = math.inf if axis.integrates else limits.jump(period, axis.resolution)
    sign, encoder = sign_probe(axis, period), encoder_probe(axis, period)
    largest, holding = (sign.largest, sign.holding) if sign else (math.inf, math.inf)
    asking, asked, asked_time = (encoder.effort, encoder.least, encoder.time) if encoder else (math.inf,) * 3
    # Largest cost if a fifth of the samples is missing, in gaps as long as the largest age of feedback.
    most = 1.0 + LARGEST_MISSING_SHARE * limits.age / (0.5 * period + axis.delay.total)
    stretch = axis.largest_stretch if axis.largest_stretch < most else math.inf
    lowest, highest = limits.position or (-math.inf, math.inf)
    rows = (
        LimitRow("force at the start", START_SHARE * limits.effort, force, Reaction.REFUSE),
        LimitRow("pulses that show the sign", largest, force, Reaction.CLAMP),
        LimitRow("force until the sign is seen", holding, force, Reaction.CLAMP),
        LimitRow("fade-in of the limit", limits.fade_in, "s", Reaction.CLAMP),
        LimitRow("force", limits.effort, force, Reaction.CLAMP),
        LimitRow("slew", limits.slew, f"{force}/s", Reaction.CLAMP),
        LimitRow("force at standstill", limits.holding, force, Reaction.CLAMP, limits.stall),
        LimitRow("pulses that ask the encoder", asking, force, Reaction.CLAMP),
        LimitRow("force on an encoder that stands still", asked, force, Reaction.DISABLE, asked_time),
        LimitRow("feedback missing", 2.0 * period, "s", Reaction.FADE),
        LimitRow("scene beside its place after gaps", limits.shift, length, Reaction.CLAMP),
        LimitRow("age of feedback", limits.age, "s", Reaction.DISABLE),
        LimitRow("gaps that divide the stiffness limit by", stretch, "", Reaction.DISABLE),
        LimitRow("speed", limits.speed, f"{length}/s", Reaction.DISABLE),
        LimitRow("acceleration", limits.acceleration, f"{length}/s²", Reaction.DISABLE),
        LimitRow("jump in a period", jump, length, Reaction.DISABLE),
        LimitRow("power", limits.power, "W", Reaction.DISABLE),
        LimitRow("energy of its own", limits.energy, "J", Reaction.DISABLE),
        LimitRow("energy forgiven in a second", limits.forgiven, "J", Reaction.DISABLE),
        LimitRow("energy of torque held in gaps", judged * HELD_ENERGY, "J", Reaction.DISABLE),
        LimitRow("power of torque held in gaps", judged * HELD_POWER, "W", Reaction.DISABLE),
        LimitRow("lowest position", lowest, length, Reaction.DISABLE),
        LimitRow("highest position", highest, length, Reaction.DISABLE),
        LimitRow("drift", limits.drift if axis.integrates else math.inf, length, Reaction.DISABLE),
    )
    return (row for row in rows if math.isfinite(row.value) and math.isfinite(row.time))


def limit_lines(axis: AxisPlan, period: float) -> Iterator[str]:
    """Yield one line for each reaction: its name and its limits."""
    rows = tuple(limit_rows(axis, period))
    for reaction in Reaction:
        yield f"{reaction.value}: {', '.join(_text(row) for row in rows if row.reaction is reaction)}"


def recommended_limits(axis: AxisPlan) -> str:
    """Return limits for the first runs that the rig lacks, as lines of its file; empty if it lacks none.

    Only the user knows the travel of the handle, so positions are names and not numbers.
    """
    given, length = axis.rig.limits, axis.workspace.length_unit
    told = (
        ("effort", given.effort, rounded(FIRST_SHARE * axis.rated_effort, 2)),
        ("speed", given.speed, exactly(FIRST_SPEED[axis.workspace.value])),
        ("position", given.position, f"[lowest, highest], the travel of the handle in {length}"),
    )
    missing = ", ".join(f"{name} = {value}" for name, known, value in told if known is None)
    return f"for the first runs write [axis.{axis.name}.limits] {missing}" if missing else ""


WORDS = {
    "pulses that show the sign": "pulses of the motor direction check",
    "force until the sign is seen": "force until the motor direction is confirmed",
    "pulses that ask the encoder": "pulses that test the encoder",
    "scene beside its place after gaps": "largest displacement of the scene after feedback gaps",
}
"""Limits whose words for people are others than the name for scripts."""


def _text(row: LimitRow) -> str:
    time = f" after {exactly(row.time)} s" if row.time else ""
    return f"{WORDS.get(row.name, row.name)} {in_unit(row.value, row.unit).rstrip()}{time}"


# A plan in rows, for the text and the JSON object; the keys of the object are a contract.

ORDER = (
    "mapped", "left_out", "assumed", *TRAFFIC_KEYS.values(), "bus_load", "delay_s", "ways", "couplings", "limits",
    "guards", "sign", "stability", "modules", "deadlines", "limit",
)  # fmt: skip
"""Order of the keys in the object; the text has another order. New keys follow at the end."""


def explain(plan: Plan, *, verbose: bool = False) -> str:
    """Return the plan in words: lines of a key and a text each, without a final newline.

    `verbose` adds the verdict with its nominal limits and the worst case of the open values.
    """
    return "\n".join(f"{key:{KEY_WIDTH}}{text}".rstrip() for key, text in lines_of(plan_rows(plan, verbose=verbose)))


def plan_json(plan: Plan) -> dict[str, Json]:
    """Return the object that `plan --json` prints; delays and ages in s."""
    return cast(dict[str, Json], object_of(plan_rows(plan), ORDER))


def summary_json(plan: Plan) -> dict[str, Json]:
    """Return the summary of a plan for `run --json`."""
    left_out: list[Json] = [{"what": left_out.what, "why": left_out.why} for left_out in plan.left_out]
    return {"mapped": list(plan.mapped), "left_out": left_out, "assumed": list(plan.assumed)}


def plan_rows(plan: Plan, *, verbose: bool = False) -> Iterator[OutputRow]:
    """Yield the rows of a plan, in the order of its text."""
    summary, ways, ages, axes = summary_json(plan), refusal.way_limits(plan), plan.coupling_ages, plan.axes
    yield OutputRow("scene", [f"{plan.scene.name}: {plan.scene.description}"])
    for axis in axes:
        drive = f"{axis.name}: {axis.profile.title}, node {axis.node}"
        effort = f"at most {in_unit(axis.limits.effort, axis.workspace.effort_unit)}"
        yield OutputRow("axis", [f"{drive}, {axis.workspace.value}, {effort}"])
    for bus in plan.buses:
        # Its name and axes are given only when the plan has several buses.
        name, on_it = (f"{bus.name}: ", f", axes {', '.join(bus.axes)}") if len(plan.buses) > 1 else ("", "")
        yield OutputRow("bus", [f"{name}{bus.traffic.line()}{on_it}"])
        yield from (OutputRow(key, [text]) for axis in plan.on(bus).axes for key, text in axis.traffic.lines())
    yield from (OutputRow(key=key, value=value) for key, value in _traffic_json(plan).items())
    yield OutputRow(key="mapped", value=summary["mapped"])
    yield OutputRow(key="bus_load", value=plan.bus_load)
    yield OutputRow("steps", [f"{number}  {step}" for number, step in enumerate(plan.steps, start=1)])
    yield OutputRow("modules", plan.modules, "modules", list(plan.modules))
    yield OutputRow("left out", [f"{left.what}: {left.why}" for left in plan.left_out], "left_out", summary["left_out"])
    prefixes = [f"{axis.name}: " if len(axes) > 1 else "" for axis in axes]
    for prefix, axis in zip(prefixes, axes, strict=True):
        yield OutputRow("limits", [prefix + line for line in limit_lines(axis, plan.period)])
    yield OutputRow(key="limits", value=[row.to_json(axis) for axis in axes for row in limit_rows(axis, plan.period)])
    yield OutputRow(key="sign", value=[_sign_json(axis, plan.period) for axis in axes])
    if plan.rig.source:  # the shipped bench has no file for them
        yield OutputRow("advice", filter(None, map(recommended_limits, axes)))
    for prefix, axis in zip(prefixes, axes, strict=True):
        yield OutputRow("encoder", [prefix + line for line in encoder_lines(axis, plan.period)])
    guards = plan.guards
    watchdogs = [guard.to_json() for guard in guards]
    yield OutputRow("watchdog", guard_lines(guards, simulated=plan.simulated), "guards", watchdogs)
    yield OutputRow("enabling", enabling_lines(axes))
    parts = {name: getattr(plan.delay, name) for name in ("bus", "compute", "drive", "torque_loop", "total")}
    yield OutputRow("delay", [delay_text(plan.delay, plan.period)], "delay_s", parts)
    for prefix, axis in zip(prefixes, axes, strict=True):
        yield OutputRow("measured", [prefix + text for text in measured_texts(axis.bench)])
    yield OutputRow("ways", (way.text() for way in ways), "ways", [way.to_json() for way in ways])
    yield OutputRow("assumed", assumed_texts(plan.assumed), "assumed", summary["assumed"])
    yield OutputRow("deadlines", deadline_texts(plan), "deadlines", [each.to_json() for each in plan.deadlines])
    yield OutputRow("unseen", filter(None, (unseen_text(axis, plan.period) for axis in axes)))
    coupled = [{"name": each.name, "age_s": {on: dict(told) for on, told in each.ages.items()}} for each in ages]
    yield OutputRow("coupling", map(str, ages), "couplings", coupled)
    found = plan.stability
    judged = None if found is None else found.to_json()
    yield OutputRow("limit", [limit_text(found)], "limit", None if judged is None else judged["limit"])
    if plan.weakest is not None and found is not None:
        yield OutputRow("limit at", place_texts(found, plan.weakest.workspace))
    yield OutputRow("stability", verdict_texts(plan) if verbose else (), "stability", judged)


def _traffic_json(plan: Plan) -> Mapping[str, Json]:
    """Return the process data exchanged, by the key of each protocol; None for a protocol that no axis uses."""
    # All keys are always present: they do not depend on the bench.
    found: dict[str, list[Json] | None] = dict.fromkeys(TRAFFIC_KEYS.values())
    for axis in plan.axes:
        for key, rows in axis.traffic.to_json(axis.rig.bus).items():
            found[key] = [*(found.get(key) or ()), *rows]
    return found


def _sign_json(axis: AxisPlan, period: float) -> dict[str, Json]:
    """Return the test of the motor direction of an axis; None for an unknown value, or without a test."""
    probe = sign_probe(axis, period)
    return {
        "axis": axis.name,
        "pulses": [] if probe is None else [[stage.effort, stage.periods * period] for stage in probe.stages],
        "bound": None if probe is None else axis.limits.unseen,
        "checked": None if probe is None else is_checked(axis),
        "travel": None if probe is None else probe.travel,
        "farthest": None if probe is None else probe.farthest,
        "least_s": None if probe is None else probe.time,
        "permitted_until_then": None if probe is None else probe.holding,
    }


def delay_text(delay: Delay, period: float) -> str:
    """Return a delay budget in one line [ms]; parts of 0 are left out."""
    named = {"bus": delay.bus, "compute": delay.compute, "drive": delay.drive, "torque loop": delay.torque_loop}
    parts = [f"{name} {rounded(1e3 * part)}" for name, part in named.items() if part]
    told = f": {', '.join(parts)}" if len(parts) > 1 else ""
    # 500·T is T/2 in ms.
    return f"{rounded(1e3 * delay.total)} ms{told}; the hold adds T/2 = {rounded(500 * period)}"


def deadline_texts(plan: Plan) -> Iterator[str]:
    """Yield the definition of zero torque, then a table of causes: the longest time [ms] and the way to zero torque."""
    yield f"longest time from the event to zero torque ({100 * REMAINDER:g} % left), without lateness of the host"
    rows = [("cause", "ms", "by")]
    rows += [(each.cause.value, milliseconds(each.seconds).removesuffix(" ms"), each.how) for each in plan.deadlines]
    first, second = (max(len(row[column]) for row in rows) for column in range(2))
    yield from (f"{cause:{first}}  {time:>{second}}  {how}" for cause, time, how in rows)


def milliseconds(seconds: float) -> str:
    """Return a time in words [ms], rounded up to a tenth; inf is no time."""
    return f"{math.ceil(1e4 * seconds - 1e-6) / 10:g} ms" if math.isfinite(seconds) else "without end"


def limit_text(stability: Stability | None) -> str:
    """Return the limit in one line, with "inside" or "above" for the stiffness; `run`, `plan` and `stability` print it.

    None: the bench is unknown.
    """
    if stability is None:
        return "unknown: the rig has no valid inertia, damping or friction; identify measures them"
    if stability.stiffness is None:
        known = refusal.caveat_text(stability)
        return f"none: no stiffness to vary{'' if stability.is_inside else '; unstable for some open values'}{known}"
    asked, limit = rounded_limit(stability.stiffness), stability.limit
    if math.isinf(limit.value):
        return f"none: stable at any stiffness{refusal.caveat_text(stability)}; {asked} {stability.unit} asked"
    if not limit.value:
        found = "no stiffness is stable" if limit.obstacle is None else obstacle_text(limit.obstacle, stability.unit)
        return f"{refusal.limit_value(stability)}; {found}"
    where = "inside" if stability.is_inside else "above it"
    cycle = "; vibrates by one encoder count" if stability.verdict is Verdict.LIMIT_CYCLE else ""
    return f"{refusal.limit_value(stability)}; {asked} is {where}, margin {margin_text(stability)}{cycle}"


def margin_text(stability: Stability) -> str:
    """Return limit over stiffness; empty without a stiffness, or without a limit."""
    if not stability.stiffness or math.isinf(stability.limit.value):
        return ""
    # A margin just below 1 is not rounded to 1.
    return exactly(rounded_down(stability.limit.value / stability.stiffness, TYPED_DIGITS))


def nominal_texts(stability: Stability) -> Iterator[str]:
    """Yield the nominal limits of stability, of passivity and of quantisation."""
    nominal, unit = stability.stiffness_limit, stability.unit
    if nominal.stable is None or nominal.passive is None:
        return
    yield f"stable {up_to(nominal.stable, unit)}"
    # Above the limit the loop may not be passive for some open values.
    hand = ", stable with every passive hand" if nominal.passive and stability.is_inside else ""
    condition = refusal.passivity_condition(stability) if nominal.passive else ""
    yield f"{passive_to(nominal.passive, unit)}{condition}{hand}"
    if nominal.quantisation is not None:
        between = "steps" if stability.plant.tachometer else "counts"
        yield f"at rest between two {between} {up_to(nominal.quantisation, unit)} (2·fc/D)"


def verdict_texts(plan: Plan) -> Iterator[str]:
    """Yield the verdict on the weakest axis, its nominal limits, and the values at which the limit was found."""
    axis, stability = plan.weakest, plan.stability
    if axis is not None and stability is not None:
        yield refusal.verdict_text(stability)
        yield from (f"nominal: {text}" for text in nominal_texts(stability))
        yield from worst_texts(stability, axis.workspace, axis.group)


def place_texts(stability: Stability, workspace: Workspace) -> Iterator[str]:
    """Yield the worst of several equilibria, the largest growth of the ideal scene, and the sampled laws."""
    length, per = workspace.length_unit, f"{workspace.effort_unit}/{workspace.length_unit}"
    place, crest = stability.place, stability.crest
    if place is not None and place.among > 1 and place.position is not None:
        damping = f" and {rounded(place.damping)} {workspace.effort_unit}·s/{length}" if place.damping else ""
        held = in_unit(stability.effort, workspace.effort_unit) if math.isfinite(stability.effort) else "the elements"
        yield (
            f"worst equilibrium that {held} can hold: {in_unit(place.position, length)}, "
            f"{rounded_limit(place.stiffness)} {per}{damping}, spectral radius {rounded(place.growth, 6)}"
        )
    if crest is not None and crest.position is not None and crest.ideal is not None:
        yield (
            f"unstable equilibrium at {in_unit(crest.position, length)}: spectral radius of the ideal "
            f"{rounded(crest.ideal, 6)}, of this loop {rounded(crest.growth, 6)}"
        )
    yield from (text for _, text in refusal.own_law_texts(stability, workspace))


def worst_texts(stability: Stability, workspace: Workspace, group: Group | None) -> Iterator[str]:
    """Yield the worst case of the open values, at which the limit was found; nothing if there is none."""
    effort, travel = workspace.effort_unit, workspace.length_unit
    mass = "kg" if workspace is Workspace.LINEAR else "kg·m²"
    names = [f"{each.name}: " for each in group.members] if group and len(group.members) > 1 else [""]
    at = [
        f"{name}mass {rounded(each.plant.mass)} {mass}, damping {rounded(each.plant.damping)} {effort}·s/{travel}, "
        f"torque loop {rounded(1e3 * each.plant.torque_lag)} ms, "
        f"delay without torque loop {rounded(1e3 * each.delay)} ms"
        + (f", coupling {rounded(each.coupling)} times as stiff" if each.coupling != 1.0 else "")
        for name, each in zip(names, stability.limit.judged_at, strict=False)
    ]
    if at and math.isfinite(stability.limit.value):
        yield f"worst case: {'; '.join(at)}"


def obstacle_text(obstacle: Obstacle, unit: str) -> str:
    """Return the other element that leaves no stiffness to the varied element, with a setting that helps, in words."""
    element = obstacle.element
    return (
        f"{element.name} alone is above its limit, {rounded_limit(stiffness_of(element))} of "
        f"{exactly(rounded_down(obstacle.limit, TYPED_DIGITS))} {unit}, which leaves none for {obstacle.beside}; "
        f"inside: {refusal.softer(element, rounded_down(obstacle.limit))}"
    )


def passive_to(limit: float, unit: str) -> str:
    """Return the nominal limit of passivity in words."""
    return f"passive {up_to(limit, unit)}" if limit > 0.0 else "not passive"


def up_to(limit: float, unit: str) -> str:
    """Return a nominal limit in words."""
    if limit <= 0.0:
        return "at no stiffness"
    return f"to {rounded_limit(limit)} {unit}" if math.isfinite(limit) else "with no limit"

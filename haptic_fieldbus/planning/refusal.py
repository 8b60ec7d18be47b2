"""Refusal of a scene above its limit before anything moves, with the limit and with settings inside it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from haptic_fieldbus.errors import UnstableSceneError
from haptic_fieldbus.margins import Basis, Stability, Verdict
from haptic_fieldbus.margins.group import Group
from haptic_fieldbus.margins.stiffness_map import OwnLaw
from haptic_fieldbus.numerals import (
    LIMIT_DIGITS,
    TYPED_DIGITS,
    exactly,
    in_unit,
    percent,
    rounded,
    rounded_down,
    rounded_limit,
)
from haptic_fieldbus.planning.compile import on_bus, with_verdicts
from haptic_fieldbus.planning.limits import HOLDING_SHARE
from haptic_fieldbus.planning.plan import BusPlan, Plan
from haptic_fieldbus.protocols.traffic import BusTraffic, Json
from haptic_fieldbus.scenes.element import AnyElement, abilities
from haptic_fieldbus.scenes.registry import parameters
from haptic_fieldbus.signals import Signal, Workspace

# Limits with each way in which a bus could exchange feedback and set-points: the way of the plan, and others.


@dataclass(frozen=True)
class ExchangeLimit:
    """The limit of the weakest axis of a plan with one way of exchange."""

    bus: str
    exchange: str
    """The way in words."""
    rate: float
    """Rate of the plan, or the highest rate of this way [Hz]."""
    delay: float
    """Longest time from sampling to acting of an axis on the bus, with the lag of the torque loop [s]."""
    limit: float | None
    """Limit [N/m or N·m/rad]; None without a stiffness to vary, or with an unknown bench."""
    unit: str
    chosen: bool

    def text(self) -> str:
        """Return the way with its limit in words."""
        limit = "" if self.limit is None else f": limit {exactly(self.limit)} {self.unit}"
        chosen = ", chosen" if self.chosen else ""
        return f"{self.exchange} at {exactly(self.rate)} Hz, delay {rounded(1e3 * self.delay)} ms{limit}{chosen}"

    def to_json(self) -> dict[str, Json]:
        """Return the object of `plan --json` and `stability --json`."""
        told: dict[str, Json] = {"bus": self.bus, "exchange": self.exchange, "rate_hz": self.rate}
        return {**told, "delay_s": self.delay, "stiffness_limit": self.limit, "chosen": self.chosen}


def way_limits(plan: Plan) -> tuple[ExchangeLimit, ...]:
    """Return the limits of each bus with several ways, the chosen way first; empty where each bus has one way."""
    found = []
    for bus in plan.buses:
        others = bus.traffic.others()
        found += [_limit(plan, bus, bus.traffic)] if others else []
        for traffic in others:  # of a plan with another exchange only delays, period and verdicts are updated
            period = round(1e9 / traffic.rate) * 1e-9
            axes = [on_bus(axis, traffic, period) if axis.name in bus.axes else axis for axis in plan.axes]
            found.append(_limit(replace(plan, rate=traffic.rate, axes=with_verdicts(axes, period)), bus, traffic))
    return tuple(found)


def _limit(plan: Plan, bus: BusPlan, traffic: BusTraffic) -> ExchangeLimit:
    weakest, found = plan.weakest, plan.stability
    limit = None if found is None or found.stiffness is None else found.limit.value
    unit = "" if weakest is None else weakest.workspace.stiffness_unit
    delay = max(axis.delay.total for axis in plan.axes if axis.name in bus.axes)
    return ExchangeLimit(bus.name, traffic.exchange, traffic.rate, delay, limit, unit, traffic is bus.traffic)


def check_stable(plan: Plan, *, running: bool = False) -> None:
    """Raise UnstableSceneError for the first axis above its limit; an axis with an unknown bench has no limit.

    On simulated buses a scene above the limit is permitted while the loop with the values of rig and profile is stable.
    With `running` the message proposes no damping to a loop that has no velocity, because it could not render it.
    """
    for axis in plan.axes:
        found = axis.stability
        if axis.group is None or found is None:
            continue
        if found.verdict is Verdict.UNSTABLE if plan.simulated else not found.is_inside:
            limit = None if found.stiffness is None else found.limit.value
            raise UnstableSceneError(_refusal(plan, axis.group, found, running), limit=limit)


def above_limit(plan: Plan, *, caveat: bool = True) -> Iterator[str]:
    """Yield a sentence for each group of axes above its limit, with the `caveat` if it is told nowhere else."""
    for axis in plan.axes:
        found, group = axis.stability, axis.group
        if found is not None and group is not None and group.reference_axis == axis.name and not found.is_inside:
            yield f"{_exceeded(plan, group, found, caveat=caveat)}; the loop may vibrate"


def _refusal(plan: Plan, group: Group, stability: Stability, running: bool) -> str:
    """Return the message: the stiffness, the limit that it exceeds, and settings inside the limit."""
    axis = plan.axis(group.reference_axis)
    hints = _hints(group)
    if running and Signal.VELOCITY not in axis.needs:
        hints = [hint for hint in hints if ".damping=" not in hint]
    at = f"at {exactly(plan.rate)} Hz with {rounded(1e3 * axis.delay.total)} ms of delay"
    lines = [f"{_exceeded(plan, group, stability)}, {at}{_uncoupled(plan, group)}."]
    lines += [text for law, text in own_law_texts(stability, axis.workspace) if law.is_steeper or law.runs_off]
    lines += [axis.bench.evidence, f"Inside the limit: {' · or '.join(hints)}." if hints else ""]
    lines += [] if plan.simulated else [f"--force continues with at most {percent(HOLDING_SHARE)} of rated torque."]
    return "\n".join(filter(None, lines))


def _exceeded(plan: Plan, group: Group, stability: Stability, *, caveat: bool = True) -> str:
    """Return the stiffness, and the limit that it exceeds."""
    known = caveat_text(stability) if caveat else ""
    if stability.stiffness is None:
        always = stability.verdict is Verdict.UNSTABLE
        return f"this scene is unstable on this bench{'' if always else ' for some of the values that are open'}{known}"
    asked = f"{rounded_limit(stability.stiffness)} {plan.axis(group.reference_axis).workspace.stiffness_unit}"
    if group.stiffest is not None and len(plan.scene.elements) > 1:
        asked += f" of {group.stiffest.name}"
    if not stability.limit.value:
        return f"{asked} exceeds the limit of this bench: no stiffness is stable{known}"
    return f"{asked} exceeds the limit of {limit_value(stability, caveat=caveat)} on this bench"


STATED = "damping stated, not measured"
"""Caveat of every limit that rests on values which a person has stated; each text tells it once."""
IF_STATED = " if the stated damping holds"
"""Condition of passivity on such values."""


def limit_value(stability: Stability, *, caveat: bool = True) -> str:
    """Return a limit with its unit, and with `caveat` how certain the values of the bench are."""
    return f"{exactly(stability.limit.value)} {stability.unit}{caveat_text(stability) if caveat else ''}"


CAVEATS = {Basis.STATED: STATED, Basis.IDENTIFIED: "damping measured"}
"""How certain the values are on which a limit rests; exact ones have no caveat."""


def caveat_text(stability: Stability) -> str:
    """Return the caveat of a limit in brackets; empty without one."""
    known = CAVEATS.get(stability.limit.basis)
    return f" ({known})" if known else ""


def passivity_condition(stability: Stability) -> str:
    """Return the condition under which a loop is passive; empty if its values are exact."""
    return {Basis.STATED: IF_STATED, Basis.IDENTIFIED: " at the measured values"}.get(stability.limit.basis, "")


def verdict_text(stability: Stability) -> str:
    """Return the verdict, and the condition of one that is passive."""
    condition = passivity_condition(stability) if stability.verdict is Verdict.PASSIVE else ""
    return f"{stability.verdict.value}{condition}"


RUNS_OFF = "; its force away from rest grows without bound; limits.position of the rig stops the handle"


def own_law_texts(stability: Stability, workspace: Workspace) -> Iterator[tuple[OwnLaw, str]]:
    """Yield each element that states no bounds, with its stability check."""
    length, per = workspace.length_unit, f"{workspace.effort_unit}/{workspace.length_unit}"
    for law in stability.own_laws:
        beyond = " and ".join(law.beyond)
        stated = f"{rounded_limit(max(law.stated, 0.0))} {per}"
        if not law.places:
            yield law, f"{law.element}: checked by linearised() alone ({stated}), because its force depends on {beyond}"
            continue
        lower, upper = (in_unit(end, length) for end in law.travel)
        text = f"{law.element}: force read at {law.places} places from {lower} to {upper}; "
        text += f"steepest {rounded_limit(max(law.steepest, 0.0))} {per} at {in_unit(law.position, length)}"
        text += f", more than linearised() states ({stated})" if law.is_steeper else ""
        text += f"; read at rest, because it also depends on {beyond}" if law.beyond else ""
        text += RUNS_OFF if law.runs_off else ""
        yield law, text


def _uncoupled(plan: Plan, group: Group) -> str:
    """Return the coupled axes that are unstable by themselves, in words; their coupling cannot be stable either."""
    text = ""
    for each in group.uncoupled():
        found, element, unit = each.stability, each.stiffest, plan.axis(each.reference_axis).workspace.stiffness_unit
        if element is not None and not found.is_inside:
            text += f"; {element.name} on {each.reference_axis} exceeds its limit without its coupling too, "
            text += f"{exactly(found.limit.value)} {unit}"
    return text


def softer(element: AnyElement, stiffness: float) -> str:
    """Return the `--set` options that give an element this stiffness, through the parameters that determine it."""
    graded = abilities(element).with_stiffness
    if graded is None:
        return f"--set {element.name}.stiffness={exactly(stiffness)}"
    softer = graded(stiffness)
    changed = {name: getattr(softer, name) for name in parameters(type(element)) if name != "stiffness"}
    changed = {name: value for name, value in changed.items() if value != getattr(element, name)}
    # A list of stiffnesses cannot be written as one setting.
    if not all(isinstance(value, float) for value in changed.values()):
        return f"{element.name} with all stiffnesses multiplied by {rounded(stiffness / abilities(element).stiffness)}"
    # Several values are rounded to more digits, so that their ratio stays.
    digits = 2 if len(changed) == 1 else LIMIT_DIGITS
    smaller = {name: rounded_down(value, digits) if value > 0.0 else value for name, value in changed.items()}
    settings = [f"{name}={exactly(value)}" for name, value in smaller.items()]
    return " ".join(f"--set {element.name}.{setting}" for setting in settings)


def _hints(group: Group) -> list[str]:
    """Return settings each of which brings the group inside its limit; empty when nothing can be varied."""
    element, found = group.stiffest, group.suggested()
    if element is None:
        return []
    hints = list(_eased(group)) if found.stiffness is None else [softer(element, found.stiffness)]
    if found.damping is not None and found.damping_limit is not None:
        limit = exactly(rounded_down(found.damping_limit, TYPED_DIGITS))
        hints.append(f"--set {element.name}.damping={exactly(found.damping)} (limit {limit})")
    return hints


def _eased(group: Group) -> Iterator[str]:
    """Yield settings that soften an element beside which another one has no stiffness, and the other one if
    necessary."""
    if (obstacle := group.limit_over_ranges().obstacle) is not None:
        element, stiffness = obstacle.element, rounded_down(obstacle.limit)
        eased = group.with_stiffness(element, stiffness)
        yield " ".join([softer(element, stiffness), *([] if eased.stability.is_inside else _hints(eased)[:1])])

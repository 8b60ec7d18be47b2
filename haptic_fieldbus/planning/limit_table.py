"""The limits of an axis as people and scripts read them: value, reaction, and how long it takes.

A limit that clamps acts on the set-point of the same period. One that trips does so in the period that shows it; how
long the way from there to zero torque is, the plan says apart from this table (`deadlines`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

from haptic_fieldbus.numerals import exactly, in_unit, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.encoder_probe import encoder_probe
from haptic_fieldbus.planning.limits import (
    FIRST_SHARE,
    FIRST_SPEED,
    HELD_ENERGY,
    HELD_POWER,
    LARGEST_MISSING_SHARE,
    START_SHARE,
)
from haptic_fieldbus.planning.sign_probe import sign_probe


class Reaction(Enum):
    """What happens at a limit; the value is the name that users and scripts see."""

    CLAMP = "clamp"
    FADE = "fade"
    REFUSE = "refuse"
    DISABLE = "disable"


@dataclass(frozen=True)
class LimitRow:
    """One limit of an axis; `time` [s] is how long it must be exceeded, 0 for one period."""

    name: str
    value: float
    unit: str
    reaction: Reaction
    time: float = 0.0


def limit_rows(axis: AxisPlan, period: float) -> Iterator[LimitRow]:
    """Yield the limits that this axis has, in the order in which a force meets them; none that is infinite."""
    limits, force, length = axis.limits, axis.workspace.effort_unit, axis.workspace.length_unit
    judged = 1.0 if math.isfinite(limits.energy) else math.inf
    rows = (
        LimitRow("force at the start", START_SHARE * limits.effort, force, Reaction.REFUSE),
        *_unproved(axis, period),
        LimitRow("fade-in of the limit", limits.fade_in, "s", Reaction.CLAMP),
        LimitRow("force", limits.effort, force, Reaction.CLAMP),
        LimitRow("slew", limits.slew, f"{force}/s", Reaction.CLAMP),
        LimitRow("force at standstill", limits.holding, force, Reaction.CLAMP, limits.stall),
        *_asked(axis, period),
        LimitRow("feedback missing", 2.0 * period, "s", Reaction.FADE),
        LimitRow("scene beside its place after gaps", limits.shift, length, Reaction.CLAMP),
        LimitRow("age of feedback", limits.age, "s", Reaction.DISABLE),
        *_gaps(axis, period),
        LimitRow("speed", limits.speed, f"{length}/s", Reaction.DISABLE),
        LimitRow("acceleration", limits.acceleration, f"{length}/s²", Reaction.DISABLE),
        LimitRow("jump in a period", limits.jump(period, axis.resolution), length, Reaction.DISABLE),
        LimitRow("power", limits.power, "W", Reaction.DISABLE),
        LimitRow("energy of its own", limits.energy, "J", Reaction.DISABLE),
        LimitRow("energy forgiven in a second", limits.forgiven, "J", Reaction.DISABLE),
        LimitRow("energy of torque held in gaps", judged * HELD_ENERGY, "J", Reaction.DISABLE),
        LimitRow("power of torque held in gaps", judged * HELD_POWER, "W", Reaction.DISABLE),
        *_range(axis),
        LimitRow("drift", limits.drift if axis.integrates else math.inf, length, Reaction.DISABLE),
    )
    return (row for row in rows if math.isfinite(row.value) and math.isfinite(row.time))


def _unproved(axis: AxisPlan, period: float) -> Iterator[LimitRow]:
    probe = sign_probe(axis, period)
    if probe is not None:
        force = axis.workspace.effort_unit
        yield LimitRow("pulses that show the sign", probe.largest, force, Reaction.CLAMP)
        yield LimitRow("force until the sign is seen", probe.holding, force, Reaction.CLAMP)


def _asked(axis: AxisPlan, period: float) -> Iterator[LimitRow]:
    probe = encoder_probe(axis, period)
    if probe is not None:
        force = axis.workspace.effort_unit
        yield LimitRow("pulses that ask the encoder", probe.effort, force, Reaction.CLAMP)
        yield LimitRow("force on an encoder that stands still", probe.least, force, Reaction.DISABLE, probe.time)


def _gaps(axis: AxisPlan, period: float) -> Iterator[LimitRow]:
    # With a fifth of the samples missing, gaps that are as long as feedback may be old cost this at most.
    most = 1.0 + LARGEST_MISSING_SHARE * axis.limits.age / (0.5 * period + axis.delay.total)
    if axis.largest_stretch < most:
        yield LimitRow("gaps that divide the stiffness limit by", axis.largest_stretch, "", Reaction.DISABLE)


def _range(axis: AxisPlan) -> Iterator[LimitRow]:
    for name, place in zip(("lowest position", "highest position"), axis.limits.position or (), strict=False):
        yield LimitRow(name, place, axis.workspace.length_unit, Reaction.DISABLE)


def limit_lines(axis: AxisPlan, period: float) -> Iterator[str]:
    """Yield one line for each reaction: its name, and the limits that it keeps."""
    rows = tuple(limit_rows(axis, period))
    for reaction in Reaction:
        yield f"{reaction.value}: {', '.join(_text(row) for row in rows if row.reaction is reaction)}"


def recommended_limits(axis: AxisPlan) -> str:
    """Return the limits that the rig leaves out as its file would state them for the first runs; empty for none.

    Where the handle may go is known to the person alone, so places are named and not numbered.
    """
    given, length = axis.rig.limits, axis.workspace.length_unit
    told = (
        ("effort", given.effort, rounded(FIRST_SHARE * axis.rated_effort, 2)),
        ("speed", given.speed, exactly(FIRST_SPEED[axis.workspace.value])),
        ("position", given.position, f"[lowest, highest], the free way of the handle in {length}"),
    )
    missing = ", ".join(f"{name} = {value}" for name, known, value in told if known is None)
    return f"for the first runs [axis.{axis.name}.limits] {missing}" if missing else ""


def _text(row: LimitRow) -> str:
    time = f" after {exactly(row.time)} s" if row.time else ""
    return f"{row.name} {in_unit(row.value, row.unit).rstrip()}{time}"

"""The twin of a bench: a rig whose simulation behaves as the bench did in a recorded run, and what changed since.

The run is an ordinary one. In a simulated run the provenance names the hand; on a real bench it is unknown, so the
caller states a hand, or the times in which nobody held the handle. A value that the recording does not tell is left
out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from haptic_fieldbus.api.arguments import check_values
from haptic_fieldbus.api.identification import told_by
from haptic_fieldbus.api.provenance import repeated
from haptic_fieldbus.assessing.looking_back import shaft_record_of
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.drive.rig import MECHANICAL, BusSection, Identified, Mechanics, Rig, RigAxis, default_axis
from haptic_fieldbus.drive.rig_units import rig_text
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.identification.estimates import UNITS
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.identification.twin import COUNT_SCALES, NOBODY, HoldingHand, RunFit, RunRecord, fit_run
from haptic_fieldbus.numerals import exactly, in_unit, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.known_bench import SCALES
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_profile, load_rig, own_profile
from haptic_fieldbus.recordings.reading import RecordedRun, read_recording
from haptic_fieldbus.sim.hand import grip, hand_named

KEPT = (*MECHANICAL, "delay_and_lag")
"""Values of a twin that a rig keeps."""
EXPLAINED = 1.2
"""Largest error that needs no warning [counts]."""
WORTH = {"inertia": 0.03, "viscous_damping": 0.1, "coulomb_friction": 0.05}
"""Least share of a value that is called a change."""
WORTH_TIME, WORTH_SCALE = 8e-5, 0.05
"""The same of the delay with the lag [s], and of a scale."""
ROUND_SHARE = 0.1
"""Largest distance of inertia and friction from those of an encoder with other counts, where no hand tells scales."""
FASTEST_LAG = 1e-5
"""Shortest lag of a simulated torque loop [s]."""
HEADING = """Twin of a bench: `run --bus sim`, `simulate` and the pytest plugin simulate it.
Fitted to {recording}{missing}."""


@dataclass(frozen=True)
class ChangedValue:
    """A value that is another one than the twin has."""

    name: str
    before: float
    after: float
    text: str


@dataclass(frozen=True)
class BenchTwin:
    """The bench of one axis, fitted to a recorded run."""

    recording: str
    axis: str
    hand: str
    fit: RunFit
    rig: Rig
    """The twin: the rig with `identified` and `simulation` of the axis."""
    compared: bool
    """Whether the given rig is a twin, so that it was compared."""
    changed: tuple[ChangedValue, ...]
    unknown: tuple[str, ...]
    """Values that cannot be compared, because one of both recordings does not tell them."""
    warnings: tuple[str, ...]

    @property
    def text(self) -> str:
        """Return the twin as a rig file."""
        untold = ", ".join(name for name in (*KEPT, "torque_scale") if self.fit.values[name].reason)
        missing = f"; it does not tell {untold}, which are as in the rig" if untold else ""
        return rig_text(self.rig, HEADING.format(recording=Path(self.recording).name, missing=missing))

    def to_json(self) -> dict[str, object]:
        """Return the object of `twin --json`."""
        fit = self.fit
        return {
            "recording": self.recording, "axis": self.axis, "hand": self.hand,
            "values": {name: each.to_json() for name, each in fit.values.items()},
            "predicted": {"fit": fit.residual, "check": fit.predicted, "unit": "counts", "seconds": fit.seconds},
            "changed": [vars(each) for each in self.changed], "unknown": self.unknown, "warnings": self.warnings,
        }  # fmt: skip


def twin(
    recording: str | Path | RecordedRun,
    rig: str | Path | Rig,
    *,
    axis: str | None = None,
    hand: str | None = None,
    free: Sequence[tuple[float, float]] = (),
    profiles: str | Path | None = None,
) -> BenchTwin:
    """Return the twin of the bench of a recorded run, and what differs from the twin that `rig` is, if it is one.

    `hand` is the hand that held the handle, "none" for no hand; `free` are times in which nobody held it, from the
    first row [s]. One of them is needed for a run on a real bench. Raises UsageError for a recording from which no
    bench can be fitted, TypeError for an argument of the wrong kind, and the errors of a plan.
    """
    asked = {"rig": rig, "axis": axis, "hand": hand, "free": free, "profiles": profiles}
    check_values("twin", ((name, value) for name, value in asked.items() if value is not None))
    found = recording if isinstance(recording, RecordedRun) else read_recording(recording)
    base = rig if isinstance(rig, Rig) else load_rig(rig, profiles)
    origin = found.provenance
    if origin is None:
        raise UsageError(f"{found.path}: no provenance, so the plan of the run is not known")
    with repeated(origin, simulated=False) as (task, conditions):
        plan = load(task).plan
    known = origin.simulated and origin.faults is None and origin.conditions.led == ()
    if hand is None and not free and not known:
        raise UsageError(
            f"{found.path}: the hand is unknown, since the run was on a real bench, had faults, or its hand was led on "
            "a page. State --free FROM:TO for each time in which nobody held the handle, or --hand"
        )
    held = origin.conditions.hand if hand is None and not free else hand or "none"
    recorded = _axis_of(found, plan, base, axis, profiles)
    name, own = recorded.name, base.axis[recorded.name]
    shipped = default_axis(own.mechanism.workspace, bus=own.bus, node=own.node, profile=own.profile)
    inertia, damping, friction = (getattr(own, key) or getattr(shipped, key) for key in MECHANICAL)
    delay, lag = recorded.delay.transport, recorded.delay.torque_loop
    record = _record(found, plan, recorded, held, free, conditions["fade_in"])
    try:
        fit = fit_run(record, ShaftModel(inertia, damping, friction, delay, lag))
    except ValueError as error:
        raise UsageError(f"{found.path}: no bench can be fitted: {error}") from error
    serial: Any = None if plan.simulated else origin.drives.get(name, {}).get("serial")
    # Values as counts and torque of the rig show them; without a digest they are judged as stated ones.
    scales = _scales(fit.values["torque_scale"].value, fit.values["count_scale"].value)
    kept = told_by(
        fit, {key: scale for key, scale in scales.items() if not fit.values[key].reason}, rate=1.0 / plan.period,
        profile=recorded.profile.name, planned_delay=float(f"{delay + lag:.6g}"), date=origin.date, serial=serial,
        simulated=origin.simulated,
    )  # fmt: skip
    fitted = replace(own, proved=None, identified=kept, simulation=_simulation(fit, own, recorded))
    is_twin = own.identified != Identified()
    changed, unknown = _compared(own, kept, fit) if is_twin else ([], [])
    left = f"the model leaves {rounded(fit.residual)} counts unexplained: cogging, play, a weight on a lever, Stribeck "
    more = [f"{left}friction, an elastic coupling or another hand are not in it"] * (fit.residual > EXPLAINED)
    bench = replace(base, bus=_buses(base, plan), axis={**base.axis, name: fitted}, source="")
    return BenchTwin(str(found.path), name, held, fit, bench, is_twin, tuple(changed), tuple(unknown), tuple(more))


# The record at the motor shaft.


def _axis_of(found: RecordedRun, plan: Plan, base: Rig, axis: str | None, profiles: str | Path | None) -> AxisPlan:
    """Return the axis that is fitted; raises UsageError unless recording and rig have it, with the same scales."""
    shared = {each.name: each for each in plan.axes if each.name in base.axis}
    name = axis or (next(iter(shared)) if len(shared) == 1 else "")
    if name not in shared:
        raise UsageError(f'--axis "{name}": expected an axis of recording and rig: {", ".join(shared) or "none"}')
    own, recorded = base.axis[name], shared[name]
    stated, before = load_profile(own_profile(own.profile, profiles)).name, recorded.profile.name
    if stated != before:
        other = f"is {stated}, that of the recorded run {before}"
        raise UsageError(f"axis.{name}.profile of the rig {other}; expected the same bench")
    for key in ("mechanism", *SCALES):
        if getattr(own, key) != getattr(recorded.rig, key):
            raise UsageError(f"axis.{name}.{key} of the rig is not that of the recorded run; expected the same bench")
    *needed, last = "position", "target torque", "statusword", "flags"
    if recorded.integrates or any(f"{name}.{each}" not in found.columns for each in (*needed, last)):
        raise UsageError(f"{found.path}: expected rows of {name} with {', '.join(needed)} and {last}")
    for each in (*needed, last):
        if not np.all(np.isfinite(found[f"{name}.{each}"])):
            raise UsageError(f"{found.path}: {name}.{each} is missing in some rows; expected a number in each")
    return recorded


def _record(
    found: RecordedRun, plan: Plan, axis: AxisPlan, hand: str, free: Sequence[tuple[float, float]], fade_in: float
) -> RunRecord:
    """Return the recorded run at the motor shaft, on a grid of whole periods."""
    name, times = axis.name, found.time
    words = found[f"{name}.statusword"].astype(int)
    enabled = np.array([axis.power.state(word) is PowerState.OPERATION_ENABLED for word in words.tolist()])
    if not enabled.any():
        raise UsageError(f"{found.path}: the drive of {name} was never enabled")
    efforts, first = found[f"{name}.target torque"] * (axis.rig.mechanism.sign * axis.effort_unit), np.argmax(enabled)
    shaft, held = shaft_record_of(
        1e9 * times, found[f"{name}.position"], efforts, period=plan.period, resolution=axis.resolution,
        ratio=axis.rig.mechanism.ratio,
    )  # fmt: skip
    inside = np.any([(begin <= times) & (times <= end) for begin, end in free], axis=0) if free else enabled
    holding, release = _holding(hand if plan.scene.holds(name) else "none", axis, fade_in)
    usable = enabled & inside & (found[f"{name}.flags"] == 0) & (times < times[first] + release)
    positions, begin = np.array(shaft.positions), int(np.searchsorted(held, first))
    return RunRecord(plan.period, positions - positions[begin], np.array(shaft.torques), shaft.resolution,
                     usable[held] & (np.diff(held, prepend=-1) > 0), holding, max(begin - 1, 0))  # fmt: skip


def _holding(name: str, axis: AxisPlan, fade_in: float) -> tuple[HoldingHand, float]:
    """Return a hand at the motor shaft, which waits as in a run until force has faded in, and when it lets go [s]."""
    hand = hand_named(name)
    if hand is None:
        return NOBODY, math.inf
    held = grip(hand.after(fade_in), replace(axis.rig.mechanism, sign=1))
    pieces = tuple((each.start, each.force, each.slope) for each in held.pieces)
    holding = HoldingHand(held.inertia, held.damping, held.stiffness, pieces, held.angular_frequency)
    return holding, math.inf if held.release is None else held.release


# The twin.


def _scales(torque: float, counts: float) -> dict[str, float]:
    """Return true values over those that counts and torque of the rig show."""
    return dict(zip(KEPT, (torque * counts, torque * counts, torque, 1.0), strict=True))


def _buses(base: Rig, plan: Plan) -> dict[str, BusSection]:
    """Return the buses of the twin: those of the rig, and after a simulated run those that were simulated.

    Values of a simulated run never count on a real bus, so the twin has none on which it could run by mistake.
    """
    buses = dict(base.bus)
    for name, run in plan.rig.bus.items() if plan.simulated else ():
        own = buses.get(name)
        if own is not None and own.protocol == run.protocol:
            buses[name] = type(own)(**vars(run))  # of the class that a file gives: it stands for no real bus
    return buses


def _simulation(fit: RunFit, own: RigAxis, axis: AxisPlan) -> Mechanics:
    """Return the bench that is simulated; a value that the recording does not tell stays as it is in the rig."""
    values, counts = fit.values, fit.values["count_scale"].value
    given: dict[str, Any] = {name: float(f"{values[name].value:.6g}") for name in MECHANICAL if not values[name].reason}
    if not values["delay_and_lag"].reason:
        # The simulated bus and drive have their own delay; the lag is what is left of the sum.
        lag = max(values["delay_and_lag"].value - axis.delay.transport, FASTEST_LAG)
        given["torque_bandwidth"] = float(f"{1.0 / (2.0 * math.pi * lag):.6g}")
    if counts != 1.0:
        given["encoder_counts_per_revolution"] = max(1, round(counts * own.encoder_counts_per_revolution))
    return replace(own.simulation, torque_scale=float(f"{values['torque_scale'].value:.6g}"), **given)


# What changed.


def _compared(own: RigAxis, kept: Identified, fit: RunFit) -> tuple[list[ChangedValue], list[str]]:
    """Return the values that are others than those of the twin `own`, and those that cannot be compared."""
    stated, built = own.encoder_counts_per_revolution, own.simulation
    before = (built.torque_scale, (built.encoder_counts_per_revolution or stated) / stated)
    after = (fit.values["torque_scale"].value, fit.values["count_scale"].value)
    if after == (1.0, 1.0):  # no hand tells them, or nothing contradicts them
        after = (before[0], before[1] * _count_factor(own.identified, kept))
    names = {"torque_scale": "torque constant, rated values or unit",
             "encoder_counts_per_revolution": "encoder, lines for counts, or gear"}  # fmt: skip
    changed = [
        ChangedValue(name, old, new, f"× {exactly(float(f'{new / old:.3g}'))}: {why}")
        for (name, why), old, new in zip(names.items(), before, after, strict=True)
        if abs(new / old - 1.0) > WORTH_SCALE
    ]
    scales = _scales(*before), _scales(*after)
    unknown = [name for name in KEPT if None in (getattr(own.identified, name), getattr(kept, name))]
    for name in (name for name in KEPT if name not in unknown):
        sides = [(getattr(each, name) * scale[name], np.ptp(getattr(each, f"{name}_interval")) * scale[name])
                 for each, scale in zip((own.identified, kept), scales, strict=True)]  # fmt: skip
        (old, old_width), (new, new_width) = sides
        least = WORTH[name] * old if name in WORTH else WORTH_TIME
        if abs(new - old) > max(0.5 * (old_width + new_width), least):
            share = f" ({100.0 * (new / old - 1.0):+.3g} %)" if old else ""
            told = f"{in_unit(old, UNITS[name])} before, {in_unit(new, UNITS[name])} now{share}"
            changed.append(ChangedValue(name, old, new, told))
    return changed, unknown


def _count_factor(before: Identified, after: Identified) -> float:
    """Return the factor of counts that explains why inertia, and not friction, is divided by it; otherwise 1."""
    pairs = [(getattr(before, name), getattr(after, name)) for name in ("inertia", "coulomb_friction")]
    if not all(old and new for old, new in pairs):
        return 1.0
    inertia, friction = (old / new for old, new in pairs)
    near = [each for each in COUNT_SCALES if abs(inertia / each - 1.0) < ROUND_SHARE]
    return near[0] if near and abs(friction - 1.0) < ROUND_SHARE else 1.0

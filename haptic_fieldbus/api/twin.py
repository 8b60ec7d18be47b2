"""The twin of a bench: a rig whose simulation behaves as the bench did in a recorded run, and what changed since.

The run is an ordinary one. In a simulated run the provenance names the hand; on a real bench it is unknown, so the
caller states a hand, or the times in which nobody held the handle. A value that the recording does not tell is left
out.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.api.provenance import repeated
from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.drive.rig import MECHANICAL, Identified, Mechanics, Rig, RigAxis, default_axis
from haptic_fieldbus.drive.rig_units import rig_text
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.identification.fit import UNITS, Estimate
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.identification.twin import COUNT_SCALES, HoldingHand, RunFit, RunRecord, fit_run
from haptic_fieldbus.numerals import exactly, in_unit, rounded, with_interval
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.recordings.reading import RecordedRun, read_recording
from haptic_fieldbus.sim.hand import grip, hand_named

KEPT = (*MECHANICAL, "delay_and_lag", "torque_lag")
"""Values of a twin that a rig keeps."""
WORTH = {"inertia": 0.03, "viscous_damping": 0.1, "coulomb_friction": 0.05}
"""Least share of a value that is called a change."""
WORTH_TIME, WORTH_SCALE = 5e-5, 0.05
"""The same of the delay with the lag [s], and of a scale."""
ROUND_SHARE = 0.1
"""Largest distance of inertia and friction from those of an encoder with other counts, where no hand tells scales."""
FASTEST_LAG = 1e-5
"""Shortest lag of a simulated torque loop [s]."""
HEADING = """Twin of a bench: `run --bus sim`, `simulate` and the pytest plugin simulate it.
Fitted to {recording}; not told by it: {missing}."""


@dataclass(frozen=True)
class Change:
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
    fit: RunFit
    rig: Rig
    """The twin: the rig with `identified` and `simulation` of the axis."""
    hand: str
    compared: bool = False
    """Whether the rig is a twin, so that it was compared."""
    changed: tuple[Change, ...] = ()
    unknown: tuple[str, ...] = ()
    """Values that cannot be compared, because one of both recordings does not tell them."""
    warnings: tuple[str, ...] = ()

    @property
    def missing(self) -> list[str]:
        """Return the values that the recording does not tell."""
        return [name for name in KEPT if self.fit.values[name].reason]

    @property
    def text(self) -> str:
        """Return the twin as a rig file."""
        missing = ", ".join(self.missing) or "nothing"
        return rig_text(self.rig, HEADING.format(recording=Path(self.recording).name, missing=missing))

    def to_json(self) -> dict[str, object]:
        """Return the object of `twin --json`."""
        values = {
            name: {"value": each.value, "low": each.low, "high": each.high, "unit": each.unit or None,
                   "reason": each.reason or None} for name, each in self.fit.values.items()
        }  # fmt: skip
        return {
            "recording": self.recording, "axis": self.axis, "hand": self.hand, "values": values,
            "predicted": {"fit": self.fit.residual, "check": self.fit.predicted, "unit": "counts",
                          "seconds": self.fit.seconds},
            "changed": [vars(each) for each in self.changed], "unknown": list(self.unknown),
            "warnings": list(self.warnings),
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
    first row [s]. Both are needed only for a run on a real bench. Raises UsageError for a recording from which no bench
    can be fitted, and the errors of a plan.
    """
    found = recording if isinstance(recording, RecordedRun) else read_recording(recording)
    base = rig if isinstance(rig, Rig) else load_rig(rig, profiles)
    if found.provenance is None:
        raise UsageError(f"{found.path}: no provenance, so the plan of the run is not known")
    with repeated(found.provenance, simulated=False) as (task, conditions):
        plan = load(task).plan
    told = _hand_of(found, hand, free)
    name = _axis_of(found, plan, base, axis)
    of_plan, own = next(each for each in plan.axes if each.name == name), base.axis[name]
    record = _record(found, plan, of_plan, told, free, conditions["fade_in"])
    try:
        fit = fit_run(record, _stated(own, of_plan))
    except ValueError as error:
        raise UsageError(f"{found.path}: no bench can be fitted: {error}") from error
    serial = None if plan.simulated else found.provenance.drives.get(name, {}).get("serial")
    kept = replace(_identified(fit, of_plan, plan), date=found.provenance.date, serial=serial)
    fitted = replace(own, proved=None, identified=kept, simulation=_simulation(fit, own, of_plan))
    is_twin = own.identified != Identified()
    changed, unknown = _compared(own, kept, fit) if is_twin else ([], [])
    return BenchTwin(
        str(found.path), name, fit, replace(base, axis={**base.axis, name: fitted}, source=""), told, is_twin,
        tuple(changed), tuple(unknown), fit.warnings,
    )  # fmt: skip


# The record at the motor shaft.


def _hand_of(found: RecordedRun, hand: str | None, free: Sequence[tuple[float, float]]) -> str:
    """Return the name of the hand; raises UsageError where nobody knows it."""
    origin = found.provenance
    if hand is not None or free or origin is None:
        return hand or "none"
    if not origin.simulated:
        raise UsageError(
            f"{found.path}: of a real bench, so the hand is unknown. State --free FROM:TO for each time in which nobody "
            "held the handle, or --hand"
        )
    if origin.faults is not None or origin.conditions.led != ():
        raise UsageError(f"{found.path}: the run has faults, or a hand that was led on a page; state --free FROM:TO")
    return origin.conditions.hand


def _axis_of(found: RecordedRun, plan: Plan, base: Rig, axis: str | None) -> str:
    """Return the axis that is fitted; raises UsageError unless recording and rig have it, with the same scales."""
    names = [each.name for each in plan.axes if each.name in base.axis]
    if axis is None and len(names) != 1:
        raise UsageError(f"{found.path}: expected --axis, one of {', '.join(names) or 'none: the rig has other axes'}")
    name = axis or names[0]
    if name not in names:
        raise UsageError(f'--axis "{name}": expected an axis of recording and rig: {", ".join(names)}')
    own, recorded = base.axis[name], next(each for each in plan.axes if each.name == name)
    for key in ("encoder_counts_per_revolution", "mechanism", "rated_torque"):
        if getattr(own, key) != getattr(recorded.rig, key):
            raise UsageError(f"axis.{name}.{key} of the rig is not that of the recorded run, so they cannot be compared")
    missing = [each for each in ("position", "target torque", "statusword") if f"{name}.{each}" not in found.columns]
    if missing or recorded.integrates:
        raise UsageError(f"{found.path}: expected rows with {', '.join(missing) or 'a position of the drive'} of {name}")
    return name


def _record(
    found: RecordedRun, plan: Plan, axis: AxisPlan, hand: str, free: Sequence[tuple[float, float]], fade_in: float
) -> RunRecord:
    """Return the recorded run at the motor shaft, on a grid of whole periods."""
    name, ratio, period = axis.name, axis.rig.mechanism.ratio, plan.period
    times = found.time
    places = np.rint(times / period).astype(int)
    grid = np.arange(places[-1] + 1 if len(places) else 0)
    held = np.searchsorted(places, grid, side="right") - 1
    words = found[f"{name}.statusword"].astype(int)
    enabled = np.isin(words, [word for word in np.unique(words) if _enabled(axis, int(word))])
    if not enabled.any():
        raise UsageError(f"{found.path}: the drive of {name} was never enabled")
    inside = np.any([(first <= times) & (times <= last) for first, last in free], axis=0) if free else enabled
    usable: NDArray[np.bool_] = np.zeros(len(grid), bool)
    usable[places] = enabled & inside & (found[f"{name}.flags"] == 0)
    sign, first = axis.rig.mechanism.sign, int(places[np.argmax(enabled)])
    positions = np.interp(grid, places, found[f"{name}.position"]) / ratio
    torques = found[f"{name}.target torque"][held] * (sign * axis.effort_unit * ratio)
    holding = _holding(hand, axis, fade_in) if plan.scene.holds(name) else None
    return RunRecord(
        period, positions - positions[first], torques, axis.resolution / ratio, usable, holding, max(first - 1, 0)
    )


def _enabled(axis: AxisPlan, statusword: int) -> bool:
    return axis.power.state(statusword) is PowerState.OPERATION_ENABLED


def _holding(name: str, axis: AxisPlan, fade_in: float) -> HoldingHand | None:
    """Return a hand at the motor shaft; as in a run, it waits until force has faded in."""
    hand = hand_named(name)
    if hand is None:
        return None
    held = grip(hand.after(fade_in), replace(axis.rig.mechanism, sign=1))
    pieces = tuple((each.start, each.force, each.slope) for each in held.pieces)
    release = math.inf if held.release is None else held.release
    return HoldingHand(held.inertia, held.damping, held.stiffness, pieces, held.angular_frequency, release)


# The twin.


def _stated(own: RigAxis, axis: AxisPlan) -> ShaftModel:
    """Return the bench from which the fit begins; what the rig leaves out is that of the shipped bench."""
    shipped = default_axis(own.mechanism.workspace, bus=own.bus, node=own.node, profile=own.profile)
    inertia, damping, friction = (getattr(own, key) or getattr(shipped, key) for key in MECHANICAL)
    return ShaftModel(inertia, damping, friction, axis.delay.transport, axis.delay.torque_loop)


def _identified(fit: RunFit, axis: AxisPlan, plan: Plan) -> Identified:
    """Return what `identify` would measure: values as the counts and the torque of the rig show them.

    There is no digest, so that plans judge them like stated values.
    """
    torque, counts = fit.values["torque_scale"].value, fit.values["count_scale"].value
    scales = dict(zip(MECHANICAL, (torque * counts, torque * counts, torque), strict=True))
    kept: dict[str, Any] = {}
    for name in KEPT:
        each, scale = fit.values[name], scales.get(name, 1.0)
        if not each.reason:
            low, value, high = (float(f"{number / scale:.6g}") for number in (each.low, each.value, each.high))
            kept |= {name: value, f"{name}_interval": (low, high)}
    planned = float(f"{axis.delay.transport + axis.delay.torque_loop:.6g}")
    return Identified(
        **kept, profile=axis.profile.name, rate=1.0 / plan.period, planned_delay=planned,
        top_speed=float(f"{fit.top_speed:.4g}"), residual_counts=float(f"{fit.residual:.3g}"),
    )  # fmt: skip


def _simulation(fit: RunFit, own: RigAxis, axis: AxisPlan) -> Mechanics:
    """Return the bench that is simulated; a value that the recording does not tell stays as it is in the rig."""
    given: dict[str, Any] = {name: float(f"{fit.values[name].value:.6g}") for name in MECHANICAL
                             if not fit.values[name].reason}  # fmt: skip
    both, counts = fit.values["delay_and_lag"], fit.values["count_scale"].value
    if not both.reason:
        # The simulated bus and drive have their own delay; the lag is what is left of the sum, which is known best.
        lag = max(both.value - axis.delay.transport, FASTEST_LAG)
        given["torque_bandwidth"] = float(f"{1.0 / (2.0 * math.pi * lag):.6g}")
    if counts != 1.0:
        given["encoder_counts_per_revolution"] = max(1, round(counts * own.encoder_counts_per_revolution))
    return replace(own.simulation, torque_scale=float(f"{fit.values['torque_scale'].value:.6g}"), **given)


# What changed.


def _compared(own: RigAxis, kept: Identified, fit: RunFit) -> tuple[list[Change], list[str]]:
    """Return the values that are others than those of the twin `own`, and those that cannot be compared."""
    counts = (own.simulation.encoder_counts_per_revolution or own.encoder_counts_per_revolution)
    before = (own.simulation.torque_scale, counts / own.encoder_counts_per_revolution)
    after = (fit.values["torque_scale"].value, fit.values["count_scale"].value)
    if after == (1.0, 1.0):  # no hand tells them, or nothing contradicts them
        after = (before[0], before[1] * _count_factor(own.identified, kept))
    changed = [
        Change(name, old, new, f"{word} × {exactly(float(f'{new / old:.3g}'))}{more}")
        for name, word, more, old, new in (
            ("torque_scale", "torque", ": torque constant, rated values or unit", before[0], after[0]),
            ("encoder_counts_per_revolution", "counts", ": encoder, lines for counts, or gear", before[1], after[1]),
        )
        if abs(new / old - 1.0) > WORTH_SCALE
    ]
    unknown = []
    for name in KEPT[:-1]:
        pair = (getattr(own.identified, name), getattr(kept, name))
        if None in pair:
            unknown.append(name)
            continue
        scales = [_scale(name, torque, count) for torque, count in (before, after)]
        old, new = pair[0] * scales[0], pair[1] * scales[1]
        widths = [_half_width(each, name) * scale for each, scale in zip((own.identified, kept), scales, strict=True)]
        least = WORTH_TIME if name == "delay_and_lag" else WORTH[name] * old
        if abs(new - old) > max(sum(widths), least):
            unit = UNITS[name]
            share = "" if name == "delay_and_lag" else f" ({100.0 * (new / old - 1.0):+.3g} %)"
            changed.append(Change(name, old, new, f"{in_unit(old, unit)} before, {in_unit(new, unit)} now{share}"))
    return changed, unknown


def _scale(name: str, torque: float, counts: float) -> float:
    """Return the true value of an axis over the one that its counts and torque show."""
    return {"inertia": torque * counts, "viscous_damping": torque * counts, "coulomb_friction": torque}.get(name, 1.0)


def _half_width(measured: Identified, name: str) -> float:
    low, high = getattr(measured, f"{name}_interval")
    return 0.5 * float(high - low)


def _count_factor(before: Identified, after: Identified) -> float:
    """Return the factor of counts that explains why inertia, and not friction, is divided by it; otherwise 1."""
    pairs = [(getattr(before, name), getattr(after, name)) for name in ("inertia", "coulomb_friction")]
    if any(None in pair or 0.0 in pair for pair in pairs):
        return 1.0
    inertia, friction = (old / new for old, new in pairs)
    near = [each for each in COUNT_SCALES if abs(inertia / each - 1.0) < ROUND_SHARE]
    return near[0] if near and abs(friction - 1.0) < ROUND_SHARE else 1.0

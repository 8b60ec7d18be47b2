"""Summary of a run that went to its end: timing, error, energy, traces, and a verdict of one sentence."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.assessing.record import Record
from haptic_fieldbus.assessing.recording import Conversion, Recording, Times, TrueMotion, Truth
from haptic_fieldbus.assessing.result import Result, TorqueError, Trace, known_before
from haptic_fieldbus.assessing.run_verdict import ripple, run_verdict
from haptic_fieldbus.assessing.spans import Handover, Kind, spans
from haptic_fieldbus.assessing.torque_error import ErrorSplit, split
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.selection import Selection
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:  # imported for its type alone: a scene without couplings never loads it
    from haptic_fieldbus.assessing.ties import Tie

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """Data of a finished run, from which its result is made."""

    selection: Selection
    cycle: Cycle
    record: Record
    report: LoopReport
    worlds: Mapping[str, Truth]
    """True motions by the name of the bus; empty on real drives."""
    clock: str
    """Name of the clock."""
    elapsed: float
    """Wall-clock time of the loop [s]."""


def summarise(run: Run) -> Result:
    """Return the result of a run that went to its end.

    The torque error needs the true motion of the shafts, so only a simulated run has one.
    """
    plan = run.selection.plan
    rows = _enabled_rows(run)
    columns = {name: rows[:, position] for position, name in enumerate(run.record.columns)}
    splits = {axis.name: _split(run, axis, columns) for axis in plan.axes}
    known = [found for found in splits.values() if found is not None]
    # Only an axis that the hand holds can be felt, so the verdict is about those.
    felt = [found for name, found in splits.items() if found is not None and plan.scene.holds(name)]
    contacts = [found.error_rms_contact / found.ideal_rms_contact for found in felt if found.ideal_rms_contact]
    first = plan.axes[0]
    verdict = run_verdict(
        scene=plan.scene.name.replace("_", " "),
        stable=all(map(_is_stable, [plan, *[applied.change.plan for applied in run.report.changes]])),
        effort=first.workspace.effort_name,
        contact=max(contacts, default=None),
        # A scene that needs the time is a wave: its force is meant to move fast.
        ripple=None if Signal.ELAPSED_NS in first.needs else ripple(columns[f"{first.name}.command"], plan.rate),
        missed=run.report.missed,
    )
    return replace(
        known_before(run.selection, run.report),
        clock=run.clock,
        elapsed=run.elapsed,
        torque_error=_error_of(known[0], contacts) if known else None,
        energy_generated=sum(found.energy_generated for found in known) if known else None,
        traces=tuple(_trace(axis, columns, splits[axis.name]) for axis in plan.axes),
        verdict=verdict if run.worlds else "Rendered on a real drive: its true error is not known here.",
    )


def _is_stable(plan: Plan) -> bool:
    """Return whether no axis is judged unstable; an axis without a judgement counts as stable."""
    return all(axis.stability is None or axis.stability.verdict is not Verdict.UNSTABLE for axis in plan.axes)


def _enabled_rows(run: Run) -> Array:
    """Return the recorded rows from operation enabled on, `(n_periods, n_columns)`; no rows when it was not reached."""
    rows = run.record.rows()
    begin_ns = run.report.enabled_at_ns
    return rows[rows[:, 0] >= begin_ns] if begin_ns is not None else rows[:0]


def _split(run: Run, axis: AxisPlan, columns: dict[str, Array]) -> ErrorSplit | None:
    """Return the error of one axis in simulation; None on a real drive and for a run shorter than the fade-in."""
    times_ns = columns["t_ns"].astype(np.int64)
    # Before the end of the fade-in the torque is reduced on purpose, which is no error of the rendering.
    begin_ns = int(times_ns[0] + axis.limits.fade_in * 1e9) if len(times_ns) else 0
    if not run.worlds or not len(times_ns) or times_ns[-1] <= begin_ns:
        return None
    return split(
        axis.elements,
        *_known_of(run, axis, columns),
        period=run.selection.plan.period,
        begin_ns=begin_ns,
        method=axis.method,
        unit=axis.workspace.effort_unit,
        exchanges=_exchanges(run, axis, lambda plan: plan.elements),
        ties=_ties(run, axis, columns) if axis.couplings else (),
    )


def _known_of(run: Run, axis: AxisPlan, columns: dict[str, Array]) -> tuple[Recording, TrueMotion, Conversion]:
    """Return the recording of an axis, the true motion of its shaft, and the conversion between both."""
    times_ns = columns["t_ns"].astype(np.int64)
    recording = Recording(
        times_ns=times_ns,
        position=columns[f"{axis.name}.position"],
        force=columns[f"{axis.name}.force"],
        command=columns[f"{axis.name}.command"],
        # The record always has the column; without an estimator no element used its value.
        velocity=columns[f"{axis.name}.velocity"] if axis.estimator else None,
        tachometer=axis.integrates,
    )
    trajectory, mechanism = run.worlds[axis.rig.bus].trajectory(axis.node), axis.rig.mechanism
    return recording, trajectory, Conversion(mechanism.ratio * mechanism.sign, _zero(run, axis, trajectory, times_ns))


def _ties(run: Run, axis: AxisPlan, columns: dict[str, Array]) -> "list[Tie]":
    """Return the couplings of an axis, each with the recording and true motion of the axis at its other end."""
    from haptic_fieldbus.assessing.ties import Tie

    others = {each.name: each for each in run.selection.plan.axes}
    found = []
    exchanges = _exchanges(run, axis, lambda plan: plan.couplings)
    for span in spans(axis.couplings, exchanges, columns["t_ns"].astype(np.int64)):
        place = span.element.axes.index(axis.name)
        known = _known_of(run, others[span.element.axes[1 - place]], columns)
        found.append(Tie(span.element, place, *known, span.share))
    return found


def _exchanges(run: Run, axis: AxisPlan, of: Callable[[AxisPlan], tuple[Kind, ...]]) -> list[Handover[Kind]]:
    """Return a handover for each change of the run; `of` selects the elements or the couplings of the axis."""
    place = run.selection.plan.axes.index(axis)  # a change keeps the axes and their order
    return [
        Handover(applied.after_ns, applied.periods, of(applied.change.plan.axes[place]))
        for applied in run.report.changes
    ]


def _zero(run: Run, axis: AxisPlan, trajectory: TrueMotion, times_ns: Times) -> float:
    """Return the shaft angle at which the handle is at 0 [rad]."""
    if axis.integrates:
        # Without a position from the drive, the integral begins at 0 in the first enabled period.
        return float(trajectory.sample(times_ns[:1])[0][0])
    return 2 * np.pi * run.cycle.zero_counts(axis.name) / axis.steps_per_revolution


def _error_of(split: ErrorSplit, contacts: list[float]) -> TorqueError:
    """Return the error of one axis with the largest relative error in contact of all axes."""
    return TorqueError(split.rms, split.max, split.unit, split.by_source, max(contacts, default=None))


def _trace(axis: AxisPlan, columns: dict[str, Array], split: ErrorSplit | None) -> Trace:
    """Return the trace of an axis: the true motion where its error is known, else the recorded one."""
    start_ns = columns["t_ns"][0] if len(columns["t_ns"]) else 0.0
    times = (columns["t_ns"] - start_ns) * 1e-9
    position = columns[f"{axis.name}.position"]
    if split is None:
        return Trace(axis.name, axis.workspace, times, position, columns[f"{axis.name}.command"])
    return Trace(
        axis.name,
        axis.workspace,
        (split.times_ns - start_ns) * 1e-9,
        split.position,
        split.force,
        ideal=split.ideal,
        sample_times=times,
        samples=position,
        virtual={name: states[:, 0] for name, states in split.virtual.items()},
        sensor="tachometer" if axis.integrates else "encoder",
    )

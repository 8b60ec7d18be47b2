"""A recording as a regression test of a controller: its feedback through today's cycle, period by period."""

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from haptic_fieldbus.api.provenance import repeated
from haptic_fieldbus.assessing.result import Changed, Result, Trace
from haptic_fieldbus.cycle.cycle import Cycle, columns, decoded_columns
from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import above_limit
from haptic_fieldbus.planning.selection import load, select
from haptic_fieldbus.recordings.provenance import Provenance
from haptic_fieldbus.recordings.reading import RecordedRun, check_rows, read_recording
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.signals import Signal, Workspace

if TYPE_CHECKING:  # most runs change nothing
    from haptic_fieldbus.running.changes import Changes

SENT = (Signal.CONTROLWORD.value, Signal.TARGET_TORQUE.value)
"""Columns that went to the drives."""
RAW = "the raw value of a drive"
WORKSPACES = {each.length_unit: each for each in Workspace}
"""Workspaces by the unit of their positions."""


@dataclass(frozen=True)
class FirstDifference:
    """First period whose set-point today's cycle computes otherwise."""

    period: int
    """Number of the period in the recording, from 0."""
    time: float
    """Time from the first period of the recording [s]."""
    column: str
    """Column of the set-point, such as `handle.target torque`."""
    recorded: float
    today: float

    def __str__(self) -> str:
        """Return the difference in words."""
        place = f"period {self.period}, {self.time:.3f} s after the first"
        return f"{place}: {self.column} is {self.today:g}, recorded was {self.recorded:g}"


@own_faults()
def compare_recording(recording: str | Path | RecordedRun) -> FirstDifference | None:
    """Return the first period whose set-points differ when today's cycle gets the recorded feedback; None: all agree.

    Scene, rig and profiles are those of the recording, of a simulated or a real bench; no bus is opened. Raises
    UsageError for a recording of frames, without provenance, or without a signal that today's plan needs, and PlanError
    for a run that would be refused today.
    """
    found = recording if isinstance(recording, RecordedRun) else read_recording(recording)
    table = found.table()
    if found.provenance is None:
        raise UsageError(f"{found.path}: no provenance, so the plan of the run is not known")
    changes: Changes | None
    with repeated(found.provenance, simulated=False) as (task, conditions):
        force, changes = conditions["force"], conditions["changes"]
        selection = (load if force else select)(task)
        if force and not found.provenance.simulated and any(above_limit(selection.plan)):
            selection = replace(selection, forced=True)  # as in the run
        plan = selection.plan.fading_in(conditions["fade_in"])
        if changes is not None:
            longest = 1.0 + max((time for time, _ in changes.scheduled), default=0.0)
            changes.check(plan, max(conditions["duration"], longest), force=force)
    names = list(found.columns)
    missing = sorted(set(columns(plan)) - set(names))
    if missing:
        raise UsageError(f"{found.path}: today's plan needs {', '.join(missing)}, not recorded")
    decoded = [names.index(name) for name in decoded_columns(plan)]
    for name in decoded_columns(plan):
        values = found[name]
        check_rows(found.path, name, values, (np.trunc(values) == values) & (np.abs(values) < 2.0**63), RAW)
    sent = [(names.index(name), at) for at, name in enumerate(columns(plan)) if name.rpartition(".")[2] in SENT]
    cycle = Cycle(plan)
    if changes is not None:
        changes.open(cycle)
    enabled_ns: int | None = None
    for number, row in enumerate(table.tolist()):
        try:
            octets = plan.image.input.pack(*(int(row[place]) for place in decoded))
        except struct.error as error:
            raise UsageError(f"{found.path}: row {number + 2}: {error}; expected {RAW}") from error
        cycle.step(octets)
        now = cycle.row
        for place, at in sent:
            if row[place] != now[at]:
                return FirstDifference(number, float(found.time[number]), names[place], row[place], now[at])
        if cycle.enabled:
            enabled_ns = cycle.t_ns if enabled_ns is None else enabled_ns
            if changes is not None and changes.waiting:  # as in the loop
                changes.make(cycle.t_ns + plan.period_ns - enabled_ns, cycle.t_ns, plan.period_ns)
    return None


def shown(found: RecordedRun) -> Result:
    """Return a result whose picture shows the rows: position and commanded force of each axis, units from the rig.

    It has the plan of the run, so walls and force at rest are drawn. If no plan can be made, a warning says why. Raises
    UsageError for frames, and for a recording without rows.
    """
    table, provenance, times = found.table(), found.provenance, found.time
    names = [name.removesuffix(".command") for name in found.columns if name.endswith(".command")]
    if not len(table) or not names:
        raise UsageError(f"{found.path}: there is nothing to draw")
    traces = []
    for name in names:
        place, force = f"{name}.position", f"{name}.command"
        if place not in found.columns:
            raise UsageError(f"{found.path}: no column {place}, so there is nothing to draw")
        for column in (place, force):
            check_rows(found.path, column, found[column], np.isfinite(found[column]), "a finite number")
        workspace = WORKSPACES.get(found.units.get(place, ""))
        traces.append(
            Trace(name, workspace, times, found[place], found[force], sample_times=times, samples=found[place])
        )
    rate = provenance.conditions.rate if provenance else (len(table) - 1) / max(float(times[-1]), 1e-9)
    scene = provenance.scene_name if provenance else found.path.name
    titles = dict.fromkeys(str(each["title"]) for each in provenance.drives.values()) if provenance else ()
    bus, drive = provenance.bus if provenance else "", ", ".join(titles)
    changes = tuple(Changed(*each) for each in provenance.conditions.changes) if provenance else ()
    found_plan, why = _plan_of(provenance)
    return Result(
        scene, drive, bus, rate, cycles=len(table), traces=tuple(traces), changes=changes, provenance=provenance,
        plan=found_plan, warnings=(f"walls and force at rest are not drawn: {why}",) if why else (),
    )  # fmt: skip


def _plan_of(provenance: Provenance | None) -> tuple[Plan | None, str]:
    """Return the plan of a recorded run, or None and why it cannot be made."""
    if provenance is None:
        return None, "the recording has no provenance"
    try:
        with repeated(provenance, simulated=False) as (task, _):
            return load(task).plan, ""
    except HapticFieldbusError as error:
        return None, str(error)

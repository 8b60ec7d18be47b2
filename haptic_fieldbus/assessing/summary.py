"""Assessment of a run: timing, error, energy, traces, warnings, and a verdict of one sentence.

A simulated run is assessed part by part during the run, so an hour needs no more memory than a minute. In virtual time
this causes no delay. A run on real drives has no known error. It is assessed after its end.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from haptic_fieldbus.assessing.axis_assessment import AxisAssessment, Part, Run
from haptic_fieldbus.assessing.element_forces import first_periods
from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.assessing.passivity import passivities
from haptic_fieldbus.assessing.recording import Array
from haptic_fieldbus.assessing.result import Result, TorqueError, Trace, known_before
from haptic_fieldbus.assessing.run_verdict import real_verdict, ripple, run_verdict
from haptic_fieldbus.assessing.travel import Travels
from haptic_fieldbus.cycle.axis import AxisCycle
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.numerals import exactly, in_unit, percent
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.encoder_probe import why_not_asked
from haptic_fieldbus.planning.limits import START_SHARE
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import above_limit
from haptic_fieldbus.signals import Signal

PART = 15_000
"""Periods that are assessed at once."""
BEHIND = 500
"""Periods that stay for the next part, so that the last part is not too short and simulated drives are ahead."""
OVERLAP = 64
"""Periods of the previous part that are read again; no command takes longer to reach its drive."""
WORTH_TELLING = 0.01
"""Smallest reported share of periods with a cut force."""
ROWS_NEEDED = PART + 4 * BEHIND
"""Rows that the record of a simulated run must hold."""


class Assessment:
    """Assessment of one run; `advance` takes the periods done so far, `finish` the rest."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._axes = [AxisAssessment(run, axis) for axis in run.plan.axes] if run.worlds else []
        self._taken: int | None = None
        """Number of the first row of the record that is not assessed yet."""
        self._begin = 0
        """Number of the first row in operation enabled."""
        self._firsts: list[int] = []
        self._began_ns = 0
        self._travels = Travels(run.plan.axes, run.report)

    def advance(self) -> None:
        """Assess all whole parts of the run so far; call it between two periods, at least once in `BEHIND` periods."""
        if not self._axes:
            self._follow_decoded()
        elif self._run.record.pushed - (self._taken or 0) > PART + BEHIND:
            self._begun()
            while self._taken is not None and self._run.record.pushed - self._taken > PART + BEHIND:
                self._take(PART)

    def finish(self, elapsed: float) -> Result:
        """Return the result of a complete run after `elapsed` [s] of wall-clock time."""
        self._begun()
        if self._axes and self._taken is not None and self._taken < self._run.record.pushed:
            self._take(self._run.record.pushed - self._taken)
        return self.with_travel(summarise(self._run, self._axes, elapsed))

    def with_travel(self, result: Result) -> Result:
        """Return the result of a run with the travel of each handle, also after a trip."""
        self._begun()
        if not self._axes:
            self._follow_decoded()
        elif self._taken is not None and self._taken < self._run.record.pushed:
            self._follow(self._part(self._run.record.pushed - self._taken))
        travel = self._travels.told()
        return replace(result, travel=travel, warnings=(*result.warnings, *self._travels.faults))

    def _begun(self) -> None:
        """Find the first row in operation enabled, if there is one yet."""
        record, begin_ns = self._run.record, self._run.report.enabled_at_ns
        if self._taken is None and begin_ns is not None:
            self._began_ns = begin_ns
            self._taken = self._begin = record.pushed - int((record.column("t_ns") >= begin_ns).sum())

    def _follow_decoded(self) -> None:
        """Follow the positions of real drives; this must be little work, because the next period waits for it."""
        self._begun()
        record, first = self._run.record, self._taken
        if first is not None and first < record.pushed:
            times_ns = record.column("t_ns", first).astype(np.int64)
            for axis in self._run.plan.axes:
                self._travels.add(axis.name, times_ns, record.column(f"{axis.name}.position", first))
            self._taken = record.pushed

    def _follow(self, part: Part) -> None:
        """Follow the true positions of simulated drives."""
        for axis in self._axes:
            self._travels.add(axis.axis.name, *axis.true_way(part))

    def _part(self, periods: int) -> Part:
        """Return the next `periods`, at least one, with the overlap of the previous part."""
        taken = self._taken or 0
        overlap = min(OVERLAP, taken - self._begin)
        first = taken - overlap
        rows = self._run.record.since(first)[: overlap + periods]
        columns = {name: rows[:, place] for place, name in enumerate(self._run.record.columns)}
        last = first + len(rows) == self._run.record.pushed
        return Part(columns, overlap, first - self._begin, self._began_ns, self._firsts, last=last)

    def _take(self, periods: int) -> None:
        """Assess the next `periods`, and let the simulation drop the motion before them."""
        part = self._part(periods)
        self._follow(part)
        exchanges = [applied.after_ns for applied in self._run.report.changes]
        self._firsts += [part.skipped + each for each in first_periods(exchanges[len(self._firsts) :], part.times_ns)]
        for axis in self._axes:
            axis.take(part)
        self._taken = (self._taken or 0) + periods
        before_ns = int(part.times_ns[-min(2 * OVERLAP, len(part.times_ns))])
        for world in self._run.worlds.values():
            world.forget(before_ns)


def summarise(run: Run, assessed: list[AxisAssessment], elapsed: float) -> Result:
    """Return the result of a complete run from the assessments of its axes; on real drives there are none."""
    plan = run.plan
    known = [found for each in assessed if (found := each.figures) is not None]
    # Only an axis that the hand holds can be felt, so the verdict is about those.
    held = [each for each in assessed if plan.scene.holds(each.axis.name)]
    felt = [each.felt for each in held if each.felt is not None]
    worst = max(felt, key=lambda each: -1.0 if each.contact is None else each.contact, default=None)
    first = plan.axes[0]
    plans = (plan, *(applied.change.plan for applied in run.report.changes))
    judged = [axis.stability for each in plans for axis in each.axes if axis.stability is not None]
    verdict = run_verdict(
        scene=plan.scene.name.replace("_", " "),
        # An axis without a judgement counts as stable.
        stable=not any(each.verdict is Verdict.UNSTABLE for each in judged),
        inside=all(each.is_inside for each in judged),
        effort=first.workspace.effort_name,
        hand=run.hand,
        felt=worst,
        # A scene that needs the time is a wave: its force is meant to move fast.
        ripple=None if Signal.ELAPSED_NS in first.needs else ripple(_enabled(run, f"{first.name}.command"), plan.rate),
    )
    error = None
    if known:  # of the first axis, with the largest relative error in moving contact of all axes
        contact, seconds = (None, 0.0) if worst is None else (worst.contact, worst.seconds)
        error = TorqueError(known[0].rms, known[0].max, known[0].unit, known[0].by_source, contact, seconds)
    traces = {each.axis.name: each.trace for each in assessed}
    return replace(
        known_before(run.plan, run.bus, run.report),
        passivity=tuple(passivities(plan, run.cycle, run.report.cycles)),
        clock=run.clock,
        elapsed=elapsed,
        torque_error=error,
        energy_generated=sum(found.energy_generated for found in known) if known else None,
        traces=tuple(traces.get(axis.name) or _recorded(axis, run) for axis in plan.axes),
        verdict=verdict if run.worlds else _rendered(run),
        warnings=tuple(notices(run.plan, run.cycle, run.report)),
    )


def _rendered(run: Run) -> str:
    """Return the verdict on a run on real drives."""
    plan = run.plan
    behind = [share for axis in plan.axes if (share := _behind(run, axis)) is not None]
    return real_verdict(
        effort=plan.axes[0].workspace.effort_name,
        cut=max(_cut(run, axis.name) for axis in plan.axes),
        behind=max(behind, default=None),
        confirmed=all(axis.sign.unseen is None for axis in run.cycle.axes.values()),
        rehearsed=any(bus.rehearsed for bus in plan.rig.bus.values()),
    )


def _cut(run: Run, axis: str) -> float:
    """Return the share of the periods in which limit, cap or a check cut the force, or a gap shifted the scene."""
    permission = run.cycle.axes[axis].permission
    periods = permission.clipped + permission.checked + permission.gaps.shifted
    return min(1.0, periods / max(1, run.report.cycles))


def _behind(run: Run, axis: AxisPlan) -> float | None:
    """Return rms(torque actual − target) / rms(target); None without torque actual, or if all targets were 0."""
    if not any(mapped.signal is Signal.TORQUE_ACTUAL for mapped in axis.incoming):
        return None
    told = _enabled(run, f"{axis.name}.{Signal.TORQUE_ACTUAL.value}") * axis.shown_unit
    asked = _enabled(run, f"{axis.name}.{Signal.TARGET_TORQUE.value}") * axis.effort_unit
    square = float(asked @ asked)
    return math.sqrt(float((told - asked) @ (told - asked)) / square) if square else None


def notices(plan: Plan, cycle: Cycle, report: LoopReport) -> Iterator[str]:
    """Yield a sentence for each limit that was exceeded before the run, or acted during it."""
    applied = (change.change.plan for change in report.changes)
    yield from dict.fromkeys(text for each in (plan, *applied) for text in above_limit(each, caveat=False))
    for axis in plan.axes:
        yield from (f"axis {axis.name}: {text}" for text in _axis_notices(axis, cycle.axes[axis.name], report, plan))
    if unmade := report.unmade:
        settings = ", ".join(dict.fromkeys(setting for change in unmade for setting in change.settings))
        was = f"the change of {settings} was" if len(unmade) == 1 else f"{len(unmade)} changes, of {settings}, were"
        yield (
            f"{was} not made. A change waits for the end of the one before, and while it would alter the force at the "
            f"handle by more than {percent(START_SHARE, 2)} of the limit"
        )


def _axis_notices(axis: AxisPlan, handle: AxisCycle, report: LoopReport, plan: Plan) -> Iterator[str]:
    """Yield a sentence for each limit of an axis that acted during the run."""
    limits, unit, effort = axis.limits, axis.workspace.effort_unit, axis.workspace.effort_name
    permission, gaps, sign = handle.permission, handle.permission.gaps, handle.sign
    periods = report.cycles or math.inf  # in no period nothing acted
    if gaps.capped >= WORTH_TELLING * periods:
        yield (
            f"after {_times(gaps.long, 'long feedback gap')} the {effort} stayed limited to its value before the gap, "
            f"{_often(gaps.capped / periods)}; the limit ends when the handle leaves contact"
        )
    if gaps.shifted >= WORTH_TELLING * periods:
        yield (
            f"after {_times(gaps.short + gaps.long, 'feedback gap')} the scene was displaced by up to "
            f"{in_unit(gaps.farthest, axis.workspace.length_unit)}, {_often(gaps.shifted / periods)}; it moves back as "
            "the handle gives way"
        )
    share, asked = (permission.clipped - gaps.capped) / periods, permission.asked
    if share >= WORTH_TELLING and asked > limits.effort:
        yield f"the motor applied {limits.effort:.3g} of the {asked:.3g} {unit} requested, {_often(share)}"
    elif share >= WORTH_TELLING and not (handle.stalls or sign.doubts):  # what these capped is told by itself
        yield f"{_often(share)} the scene requested more {effort} than the limit of {limits.effort:.3g} {unit}"
    holding = in_unit(limits.before_sign, unit)
    if report.cycles and sign.unseen is not None:
        told = "the run was too short"
        if sign.unseen:
            told = "the handle moved neither with the torque nor against it: release it; friction may be larger than "
            told += "in the rig"
        elif sign.broken_off:
            told = f"feedback gaps interrupted the check {sign.broken_off} times: look at late periods and feedback age"
        yield f"motor direction not confirmed, so the {effort} was limited to {holding}; {told}"
    elif permission.checked >= WORTH_TELLING * periods:
        yield (
            f"{_often(permission.checked / periods)} the motor direction check took the place of the {effort} of the "
            "scene. It lasts longer where feedback is missing"
        )
    if sign.doubts:
        yield (
            f"the handle moved against the torque {sign.doubts} times, as after a blow; the {effort} was then limited "
            f"to {holding} until the motor direction was confirmed again and contact had ended"
        )
    if handle.stalls:
        yield (
            f"the position did not change under {effort} for {exactly(limits.stall)} s, "
            f"{'once' if handle.stalls == 1 else f'{handle.stalls} times'}. A leaning hand and a broken encoder cable "
            f"look the same, and no test pulses were possible ({why_not_asked(axis, plan.period)}). The {effort} was "
            f"then limited to {in_unit(limits.holding, unit)} until contact ended; a hand that pushes harder gets "
            f"through. To allow more time, raise axis.{axis.name}.limits.stall in the rig"
        )


def _often(share: float) -> str:
    return f"in {100 * share:.0f} % of the periods"


def _times(number: int, what: str) -> str:
    return f"a {what}" if number == 1 else f"{number} {what}s"


def _enabled(run: Run, column: str) -> Array:
    """Return a column since operation enabled, as far as the record holds it; empty if that state was not reached."""
    values, begin_ns = run.record.column(column), run.report.enabled_at_ns
    return values[run.record.column("t_ns") >= begin_ns] if begin_ns is not None else values[:0]


def _recorded(axis: AxisPlan, run: Run) -> Trace:
    """Return the trace of an axis without a known error: the decoded motion and the command, as far as recorded."""
    times = (_enabled(run, "t_ns") - (run.report.enabled_at_ns or 0)) * 1e-9
    position, command = (_enabled(run, f"{axis.name}.{name}") for name in ("position", "command"))
    return Trace(axis.name, axis.workspace, times, position, command)

"""Assessment of a run: timing, error, energy, traces, warnings, and a verdict of one sentence.

A simulated run is assessed part by part during the run, so an hour needs no more memory than a minute. In virtual time
this causes no delay. A run on real drives has no known error. It is assessed after its end.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.element_forces import POINTS_PER_PERIOD, Handover, Kind, Span, first_periods, spans
from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.assessing.passivity import passivities
from haptic_fieldbus.assessing.recording import Array, Conversion, Recording, Times, TrueMotion, Truth, true_motion
from haptic_fieldbus.assessing.result import Result, TorqueError, Trace, known_before
from haptic_fieldbus.assessing.run_verdict import FeltError, real_verdict, ripple, run_verdict
from haptic_fieldbus.assessing.torque_error import ErrorFigures, ErrorPoints, Splitter
from haptic_fieldbus.assessing.travel import Travels
from haptic_fieldbus.cycle.axis import AxisCycle
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.energy import ECHO
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.numerals import exactly, in_unit, percent
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.encoder_probe import why_not_asked
from haptic_fieldbus.planning.limits import HELD_ENERGY, HELD_POWER, START_SHARE
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import above_limit
from haptic_fieldbus.scenes.element import abilities
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:
    from haptic_fieldbus.assessing.coupling_error import Tie

# Traces of a run, gathered part by part; those of a long run are thinned as they come.
#
# Of each bin, the points with the least and the greatest value of every line are kept, so that no spike is lost. Points
# around the first considerable force are all kept, for a closer look.

WHOLE = 30_000
"""Largest number of periods of a run without thinning of its traces."""
BINS = 10_000
"""Bins to which the traces of a longer run are thinned."""
CONSIDERABLE = 0.05
"""Smallest considerable force, as a share of the greatest force."""
VIRTUAL = "virtual "
BEFORE, AFTER = 20, 400
"""Periods around the first considerable force in which all points are kept."""


class Traces:
    """The traces of one axis of a run of about `periods`."""

    def __init__(self, periods: int, period_ns: int) -> None:
        self._bin = 0 if periods <= WHOLE else -(-periods // BINS)
        """Periods of a bin; 0: keep all."""
        self._period_ns = period_ns
        self._lines: list[dict[str, NDArray[Any]]] = []
        self._samples: list[tuple[Times, Array]] = []
        self._greatest = 0.0
        self._began = 0.0
        """Force at which all points begin to be kept; 0 before."""

    def add(self, points: ErrorPoints, times_ns: Times, samples: Array) -> None:
        """Add a part of the run: its points, and the decoded positions at the instants `times_ns`."""
        lines = {"position": points.position, "force": points.force, "ideal": points.ideal}
        lines |= {f"{VIRTUAL}{name}": states[:, 0] for name, states in points.virtual.items()}
        kept, seen = np.arange(len(points.times_ns)), np.arange(len(times_ns))
        if self._bin:
            near_ns, size = self._near(points), round(self._bin * POINTS_PER_PERIOD)
            kept = extremes([*lines.values(), points.error], points.times_ns, size, near_ns)
            seen = extremes([samples], times_ns, self._bin, near_ns)
        self._lines.append({"times_ns": points.times_ns[kept]} | {name: line[kept] for name, line in lines.items()})
        self._samples.append((times_ns[seen], samples[seen]))

    def _near(self, points: ErrorPoints) -> tuple[int, int]:
        """Return the instants [ns] around the first considerable force of the run; (0, 0) if it is not in this part."""
        force = np.abs(points.ideal)
        self._greatest = max(self._greatest, float(force.max(initial=0.0)))
        considerable = np.flatnonzero((force > 0.0) & (force >= CONSIDERABLE * self._greatest))
        # The force at which the first one began may have become small beside a later, far greater one.
        if not len(considerable) or (self._began and self._began >= CONSIDERABLE * self._greatest):
            return 0, 0
        self._began, at_ns = float(force[considerable[0]]), int(points.times_ns[considerable[0]])
        return at_ns - BEFORE * self._period_ns, at_ns + AFTER * self._period_ns

    def trace(self, axis: AxisPlan) -> Trace:
        """Return the trace of all parts; there must be one at least."""
        start_ns = self._samples[0][0][0]
        lines = {name: np.concatenate([part[name] for part in self._lines]) for name in self._lines[-1]}
        times_ns, samples = (np.concatenate(part) for part in zip(*self._samples, strict=True))
        return Trace(
            axis.name,
            axis.workspace,
            (lines["times_ns"] - start_ns) * 1e-9,
            lines["position"],
            lines["force"],
            ideal=lines["ideal"],
            sample_times=(times_ns - start_ns) * 1e-9,
            samples=samples,
            virtual={name.removeprefix(VIRTUAL): line for name, line in lines.items() if name.startswith(VIRTUAL)},
            sensor="tachometer" if axis.integrates else "encoder",
            period=self._period_ns * 1e-9,
        )


def extremes(lines: Sequence[Array], times_ns: Times, size: int, near_ns: tuple[int, int]) -> NDArray[np.int64]:
    """Return the indices of both ends, of the extremes of each line in each bin, and of all near points.

    `lines` and `times_ns` have the shape `(n,)`; a bin has `size` points; near points lie between the instants
    `near_ns`.
    """
    whole = len(times_ns) // size * size
    starts = np.arange(0, whole, size)
    kept = [np.array([0, len(times_ns) - 1]) if len(times_ns) else np.array([], dtype=np.int64)]
    kept.append(np.flatnonzero((times_ns >= near_ns[0]) & (times_ns <= near_ns[1])))
    for values in lines:
        blocks = values[:whole].reshape(-1, size)
        rest = values[whole:]
        kept += [starts + blocks.argmin(axis=1), starts + blocks.argmax(axis=1)] if whole else []
        kept += [np.array([whole + rest.argmin(), whole + rest.argmax()])] if len(rest) else []
    return np.unique(np.concatenate(kept), return_counts=True)[0].astype(np.int64)  # alone it imports numpy.ma


WAY_POINTS = 4
"""Points per period for the extremes of the true position, which may lie between samples."""


@dataclass(frozen=True)
class Run:
    """Data of a run for its result."""

    plan: Plan
    bus: str
    """Name of the bus, or those of all buses."""
    cycle: Cycle
    record: Record
    report: LoopReport
    worlds: Mapping[str, Truth]
    """True motions by the name of the bus; empty on real drives."""
    clock: str
    """Name of the clock."""
    periods: int
    """Number of periods that the run is to last."""
    hand: str
    """Name of the simulated hand; empty without a simulated hand."""


@dataclass(frozen=True, eq=False)
class Part:
    """Rows of some periods, by the names of their columns, each `(n_periods,)`."""

    columns: Mapping[str, Array]
    overlap: int
    """Number of periods at the beginning that the previous part contained too."""
    skipped: int
    """Number of periods of the run before the first row of this part."""
    began_ns: int
    """Instant of the first period of the run."""
    firsts: list[int]
    """First periods after the changes so far, counted from the beginning of the run."""
    last: bool
    """Whether the run ends with this part."""

    @property
    def times_ns(self) -> Times:
        """Instants at which the positions were latched [ns], `(n_periods,)`."""
        return self.columns["t_ns"].astype(np.int64)


class AxisAssessment:
    """Error and traces of one axis of a simulated run."""

    def __init__(self, run: Run, axis: AxisPlan) -> None:
        self.axis = axis
        self._run = run
        self._splitter: Splitter | None = None
        self._traces = Traces(run.periods, run.plan.period_ns)
        self._zeros: dict[str, float] = {}

    @property
    def figures(self) -> ErrorFigures | None:
        """Figures of the error; None for a run shorter than the fade-in."""
        return self._splitter.figures if self._splitter is not None else None

    @property
    def felt(self) -> FeltError | None:
        """Felt error; None without contact, and for a run shorter than the fade-in."""
        found = self.figures
        if found is None or not found.touched:
            return None
        ideal, seconds = found.ideal_rms_contact, found.scored * self._run.plan.period / POINTS_PER_PERIOD
        if not ideal:
            return FeltError(None, 0.0, 0.0, 0.0)
        by_event = all(abilities(each).by_event for each in (*self.axis.elements, *self.axis.couplings))
        error, shape = found.error_rms_contact / ideal, found.shape_rms_contact / ideal
        return FeltError(error, shape, found.late, seconds, found.energy_generated, by_event)

    @property
    def trace(self) -> Trace | None:
        """Trace of the true motion; None for a run shorter than the fade-in."""
        return self._traces.trace(self.axis) if self.figures is not None else None

    def true_way(self, part: Part) -> tuple[Times, Array]:
        """Return the true positions of the handle in new periods of a part and the instants [ns], both `(n,)`."""
        _, trajectory, conversion = self._known_of(self.axis, part)
        first_ns, last_ns = part.times_ns[max(part.overlap - 1, 0)], min(part.times_ns[-1], trajectory.end_ns)
        spacing_ns = self._run.plan.period_ns // WAY_POINTS
        times_ns = np.append(np.arange(first_ns, last_ns, spacing_ns, dtype=np.int64), last_ns)
        return times_ns, true_motion(times_ns, trajectory, conversion)[0][Signal.POSITION]

    def take(self, part: Part) -> None:
        """Assess a part; a run that ends before the fade-in has no error."""
        axis, times_ns = self.axis, part.times_ns
        # Before the end of the fade-in the torque is reduced on purpose, which is no error of the rendering.
        permitted_ns = self._run.cycle.axes[axis.name].state.permitted_ns
        # A sign that was not seen in the first part is too rare to go through virtual states for.
        if permitted_ns is None or (self._splitter is None and part.skipped):
            return
        if Signal.TORQUE_ACTUAL in axis.needs:  # nobody knows what the torque of an ideal drive would be
            return
        begin_ns = int(permitted_ns + axis.limits.fade_in * 1e9)
        if times_ns[-1] <= begin_ns and part.skipped == 0 and part.last:
            return
        if self._splitter is None:
            self._splitter = Splitter(
                period=self._run.plan.period,
                begin_ns=begin_ns,
                method=axis.method,
                unit=axis.workspace.effort_unit,
                step=axis.effort_unit,
                late=(axis.delay.transport, axis.delay.torque_loop),
            )
        acted = self._spans(axis.elements, part, lambda plan: plan.elements)
        ties = self._ties(part) if axis.couplings else ()
        points = self._splitter.take(*self._known_of(axis, part), acted=acted, ties=ties)
        new = slice(part.overlap, None)
        self._traces.add(points, times_ns[new], part.columns[f"{axis.name}.position"][new])

    def _known_of(self, axis: AxisPlan, part: Part) -> tuple[Recording, TrueMotion, Conversion]:
        """Return the recording of an axis, the true motion of its shaft, and the conversion between both."""
        names = ("position", "force", "command", "velocity")
        position, force, command, velocity = (part.columns[f"{axis.name}.{name}"] for name in names)
        # The record always has the column of the velocity; without an estimator no element used its value.
        feedback = (position, force, command, velocity if axis.estimator else None)
        recording = Recording(part.times_ns, *feedback, axis.integrates, part.overlap, part.began_ns)
        trajectory, mechanism = self._run.worlds[axis.rig.bus].so_far(axis.node), axis.rig.mechanism
        if axis.name not in self._zeros:
            self._zeros[axis.name] = self._zero(axis, trajectory, part.times_ns)
        return recording, trajectory, Conversion(mechanism.ratio * mechanism.sign, self._zeros[axis.name])

    def _zero(self, axis: AxisPlan, trajectory: TrueMotion, times_ns: Times) -> float:
        """Return the shaft angle at which the handle is at 0 [rad]."""
        if axis.integrates:
            # Without a position from the drive, the integral begins at 0 in the first enabled period.
            return float(trajectory.sample(times_ns[:1])[0][0])
        return 2 * np.pi * (self._run.cycle.axes[axis.name].state.zero_counts or 0) / axis.steps_per_revolution

    def _spans(
        self, elements: tuple[Kind, ...], part: Part, of: Callable[[AxisPlan], tuple[Kind, ...]]
    ) -> list[Span[Kind]]:
        """Return the spans of elements or couplings, as `of` selects them, that act in new periods of the part."""
        place, changes = self._run.plan.axes.index(self.axis), self._run.report.changes  # a change keeps the order
        exchanges = [Handover(each.after_ns, each.periods, of(each.change.plan.axes[place])) for each in changes]
        known = spans(elements, exchanges, part.times_ns, part.firsts, part.skipped)
        return [span for span in known if span.rows.stop > part.overlap]

    def _ties(self, part: Part) -> "list[Tie]":
        """Return the couplings of an axis, each with the recording and true motion of the axis at its other end."""
        from haptic_fieldbus.assessing.coupling_error import Tie

        found = []
        for span in self._spans(self.axis.couplings, part, lambda plan: plan.couplings):
            place = span.element.axes.index(self.axis.name)
            other = self._run.plan.axis(span.element.axes[1 - place])
            found.append(Tie(span, place, *self._known_of(other, part)))
        return found


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
        known=not any(Signal.TORQUE_ACTUAL in axis.needs for axis in plan.axes),
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
        traces=tuple(traces.get(axis.name) or recorded_trace(axis, run.record, run.report) for axis in plan.axes),
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
    """Return rms(torque actual − target) / rms(target) while the target was not 0; None without either of them.

    The pulses that show the motor direction come before: a drive gives less of a short pulse than of a force.
    """
    if not any(mapped.signal is Signal.TORQUE_ACTUAL for mapped in axis.incoming):
        return None
    told = _enabled(run, f"{axis.name}.{Signal.TORQUE_ACTUAL.value}") * axis.shown_unit
    asked = _enabled(run, f"{axis.name}.{Signal.TARGET_TORQUE.value}") * axis.effort_unit
    permitted_ns = run.cycle.axes[axis.name].state.permitted_ns
    counted = (asked != 0.0) & (_enabled(run, "t_ns") >= (permitted_ns or 0))
    told, asked = told[counted], asked[counted]
    return math.sqrt(float((told - asked) @ (told - asked) / (asked @ asked))) if len(asked) else None


def notices(plan: Plan, cycle: Cycle, report: LoopReport) -> Iterator[str]:
    """Yield a sentence for each limit that was exceeded before the run, or acted during it."""
    applied = (change.change.plan for change in report.changes)
    yield from dict.fromkeys(text for each in (plan, *applied) for text in above_limit(each, caveat=False))
    for axis in plan.axes:
        yield from (f"axis {axis.name}: {text}" for text in _axis_notices(axis, cycle.axes[axis.name], report, plan))
        if axis.name in report.late_faults:
            fault = axis.traffic.fault_text(*report.late_faults[axis.name], axis.bus_name)
            yield f"axis {axis.name}: after the last period, {fault}"
    for ledger in cycle.ledgers:
        given = ledger.tally.booked.get(ECHO, 0.0)
        if given > HELD_ENERGY + HELD_POWER * (report.cycles or 0) * plan.period:
            names = ", ".join(axis.name for axis in ledger.axes)
            yield (
                f"axis {names}: {in_unit(given, 'J')} more went into the handle than the set-points would have given, "
                "because the drive showed another torque; set-points may be lost: look at the bus"
            )
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
    return _since_enabled(run.record, run.report, column)


def _since_enabled(record: Record, report: LoopReport, column: str) -> Array:
    """Return a column since operation enabled, as far as the record holds it; empty if that state was not reached."""
    values, begin_ns = record.column(column), report.enabled_at_ns
    return values[record.column("t_ns") >= begin_ns] if begin_ns is not None else values[:0]


def recorded_trace(axis: AxisPlan, record: Record, report: LoopReport) -> Trace:
    """Return the trace of an axis without a known error: the decoded motion and the command, as far as recorded."""
    times, position, command = (
        _since_enabled(record, report, name) for name in ("t_ns", f"{axis.name}.position", f"{axis.name}.command")
    )
    return Trace(axis.name, axis.workspace, (times - (report.enabled_at_ns or 0)) * 1e-9, position, command)

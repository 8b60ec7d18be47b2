"""Assessment of a run: timing, error, energy, traces, warnings, and a verdict of one sentence.

A simulated run is assessed part by part while it goes on, so that an hour needs no more memory than a minute. In
virtual time nothing waits for it. A run on real drives has no known error, and its assessment waits for its end.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.error_sums import ErrorFigures
from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.assessing.record import Record
from haptic_fieldbus.assessing.recording import Conversion, Recording, Times, TrueMotion, Truth
from haptic_fieldbus.assessing.result import Result, TorqueError, Trace, known_before
from haptic_fieldbus.assessing.spans import Handover, Kind, Span, first_periods, spans
from haptic_fieldbus.assessing.torque_error import Splitter
from haptic_fieldbus.assessing.traces import Traces
from haptic_fieldbus.assessing.verdict import ripple, verdict_of
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.selection import Selection
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:  # imported for its type alone: a scene without couplings never loads it
    from haptic_fieldbus.assessing.ties import Tie

Array = NDArray[np.float64]
PART = 15_000
"""Periods that are assessed at once."""
BEHIND = 500
"""Periods that stay for the next part, so that the last one is not too short, and simulated drives have gone past."""
OVERLAP = 64
"""Periods of the part before that are read again; no command waits longer for its drive."""
WORTH_TELLING = 0.01
"""Smallest share of periods with a cut force that is told."""
ROWS_NEEDED = PART + 4 * BEHIND
"""Rows that the record of a simulated run must hold."""


@dataclass(frozen=True)
class Run:
    """Data of a run, from which its result is made."""

    selection: Selection
    cycle: Cycle
    record: Record
    report: LoopReport
    worlds: Mapping[str, Truth]
    """True motions by the name of the bus; empty on real drives."""
    clock: str
    """Name of the clock."""
    periods: int
    """Number of periods that the run is to last."""


class Assessment:
    """Assessment of one run; `advance` takes the periods done so far, `finish` the rest."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._axes = [AxisAssessment(run, axis) for axis in run.selection.plan.axes] if run.worlds else []
        self._taken: int | None = None
        """Number of the first row of the record that is not assessed yet."""
        self._begin = 0
        """Number of the first row in operation enabled."""
        self._firsts: list[int] = []
        self._began_ns = 0

    def advance(self) -> None:
        """Assess all whole parts of the run so far; to be called between two periods, at least once in `BEHIND`."""
        if self._axes and self._run.record.pushed - (self._taken or 0) > PART + BEHIND:
            self._begun()
            while self._taken is not None and self._run.record.pushed - self._taken > PART + BEHIND:
                self._take(PART)

    def finish(self, elapsed: float) -> Result:
        """Return the result of a run that went to its end, after `elapsed` [s] of wall-clock time."""
        self._begun()
        if self._axes and self._taken is not None and self._taken < self._run.record.pushed:
            self._take(self._run.record.pushed - self._taken)
        return summarise(self._run, self._axes, elapsed)

    def _begun(self) -> None:
        """Find the first row in operation enabled, once there is one."""
        record, begin_ns = self._run.record, self._run.report.enabled_at_ns
        if self._taken is None and begin_ns is not None:
            rows = record.rows()
            self._began_ns = begin_ns
            self._taken = self._begin = record.pushed - int((rows[:, 0] >= begin_ns).sum())

    def _take(self, periods: int) -> None:
        """Assess the next `periods`, and let the simulation forget what lies before them."""
        if self._taken is None:
            return
        overlap = min(OVERLAP, self._taken - self._begin)
        first = self._taken - overlap
        rows = self._run.record.since(first)[: overlap + periods]
        columns = {name: rows[:, place] for place, name in enumerate(self._run.record.columns)}
        part = Part(columns, overlap, first - self._begin, self._began_ns, self._firsts)
        exchanges = [applied.after_ns for applied in self._run.report.changes]
        self._firsts += [part.skipped + each for each in first_periods(exchanges[len(self._firsts) :], part.times_ns)]
        for axis in self._axes:
            axis.take(part)
        self._taken += periods
        before_ns = int(part.times_ns[-min(2 * OVERLAP, len(rows))])
        for world in self._run.worlds.values():
            world.forget(before_ns)


@dataclass(frozen=True, eq=False)
class Part:
    """Rows of some periods, by the names of their columns, each `(n_periods,)`."""

    columns: Mapping[str, Array]
    overlap: int
    """Periods at the begin that the part before had too."""
    skipped: int
    """Periods of the run before the first row here."""
    began_ns: int
    """Instant of the first period of the run."""
    firsts: list[int]
    """First periods after the changes so far, counted from the begin of the run."""

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
        self._traces = Traces(run.periods, run.selection.plan.period_ns)
        self._zeros: dict[str, float] = {}

    @property
    def figures(self) -> ErrorFigures | None:
        """Figures of the error; None for a run shorter than the fade-in."""
        return self._splitter.figures if self._splitter is not None else None

    @property
    def trace(self) -> Trace | None:
        """Trace of the true motion; None for a run shorter than the fade-in."""
        return self._traces.trace(self.axis) if self.figures is not None else None

    def take(self, part: Part) -> None:
        """Assess a part; a run that ends before the fade-in has no error."""
        axis, times_ns = self.axis, part.times_ns
        # Before the end of the fade-in the torque is reduced on purpose, which is no error of the rendering.
        begin_ns = int(part.began_ns + axis.limits.fade_in * 1e9)
        if times_ns[-1] <= begin_ns and part.skipped == 0 and len(times_ns) < PART:
            return
        if self._splitter is None:
            self._splitter = Splitter(
                period=self._run.selection.plan.period,
                begin_ns=begin_ns,
                method=axis.method,
                unit=axis.workspace.effort_unit,
            )
        points = self._splitter.take(
            *self._known_of(axis, part),
            acted=self._spans(axis.elements, part, lambda plan: plan.elements),
            ties=self._ties(part) if axis.couplings else (),
        )
        new = slice(part.overlap, None)
        self._traces.add(points, times_ns[new], part.columns[f"{axis.name}.position"][new])

    def _known_of(self, axis: AxisPlan, part: Part) -> tuple[Recording, TrueMotion, Conversion]:
        """Return the recording of an axis, the true motion of its shaft, and the conversion between both."""
        columns = part.columns
        recording = Recording(
            times_ns=part.times_ns,
            position=columns[f"{axis.name}.position"],
            force=columns[f"{axis.name}.force"],
            command=columns[f"{axis.name}.command"],
            # The record always has the column; without an estimator no element used its value.
            velocity=columns[f"{axis.name}.velocity"] if axis.estimator else None,
            tachometer=axis.integrates,
            overlap=part.overlap,
            began_ns=part.began_ns,
        )
        world, mechanism = self._run.worlds[axis.rig.bus], axis.rig.mechanism
        trajectory = world.so_far(axis.node)
        if axis.name not in self._zeros:
            self._zeros[axis.name] = self._zero(axis, trajectory, part.times_ns)
        return recording, trajectory, Conversion(mechanism.ratio * mechanism.sign, self._zeros[axis.name])

    def _zero(self, axis: AxisPlan, trajectory: TrueMotion, times_ns: Times) -> float:
        """Return the shaft angle at which the handle is at 0 [rad]."""
        if axis.integrates:
            # Without a position from the drive, the integral begins at 0 in the first enabled period.
            return float(trajectory.sample(times_ns[:1])[0][0])
        return 2 * np.pi * self._run.cycle.zero_counts(axis.name) / axis.steps_per_revolution

    def _spans(
        self, elements: tuple[Kind, ...], part: Part, of: Callable[[AxisPlan], tuple[Kind, ...]]
    ) -> list[Span[Kind]]:
        """Return the spans of elements or couplings, as `of` selects them, that act in new periods of the part."""
        place = self._run.selection.plan.axes.index(self.axis)  # a change keeps the axes and their order
        exchanges = [
            Handover(applied.after_ns, applied.periods, of(applied.change.plan.axes[place]))
            for applied in self._run.report.changes
        ]
        known = spans(elements, exchanges, part.times_ns, part.firsts, part.skipped)
        return [span for span in known if span.rows.stop > part.overlap]

    def _ties(self, part: Part) -> "list[Tie]":
        """Return the couplings of an axis, each with the recording and true motion of the axis at its other end."""
        from haptic_fieldbus.assessing.ties import Tie

        others = {each.name: each for each in self._run.selection.plan.axes}
        found = []
        for span in self._spans(self.axis.couplings, part, lambda plan: plan.couplings):
            place = span.element.axes.index(self.axis.name)
            other = others[span.element.axes[1 - place]]
            found.append(Tie(span, place, *self._known_of(other, part)))
        return found


def summarise(run: Run, assessed: list[AxisAssessment], elapsed: float) -> Result:
    """Return the result of a run that went to its end, from the assessments of its axes, none on real drives."""
    plan = run.selection.plan
    figures = {each.axis.name: each.figures for each in assessed}
    known = [found for found in figures.values() if found is not None]
    # Only an axis that the hand holds can be felt, so the verdict is about those.
    felt = [found for name, found in figures.items() if found is not None and plan.scene.holds(name)]
    contacts = [found.error_rms_contact / found.ideal_rms_contact for found in felt if found.ideal_rms_contact]
    first = plan.axes[0]
    verdict = verdict_of(
        scene=plan.scene.name.replace("_", " "),
        stable=all(map(_is_stable, [plan, *[applied.change.plan for applied in run.report.changes]])),
        effort=first.workspace.effort_name,
        contact=max(contacts, default=None),
        # A scene that needs the time is a wave: its force is meant to move fast.
        ripple=None if Signal.ELAPSED_NS in first.needs else ripple(_enabled(run, f"{first.name}.command"), plan.rate),
        missed=run.report.missed,
    )
    traces = {each.axis.name: each.trace for each in assessed}
    return replace(
        known_before(run.selection, run.report),
        clock=run.clock,
        elapsed=elapsed,
        torque_error=_error_of(known[0], contacts) if known else None,
        energy_generated=sum(found.energy_generated for found in known) if known else None,
        traces=tuple(traces.get(axis.name) or _recorded(axis, run) for axis in plan.axes),
        verdict=verdict if run.worlds else "Rendered on a real drive: its true error is not known here.",
        warnings=tuple(notices(run.selection.plan, run.cycle, run.report)),
    )


def notices(plan: Plan, cycle: Cycle, report: LoopReport) -> Iterator[str]:
    """Yield a sentence for each limit that was at work during the run."""
    for axis in plan.axes:
        share = cycle.clipped(axis.name) / report.cycles if report.cycles else 0.0
        if share >= WORTH_TELLING:
            yield (
                f"axis {axis.name}: in {100 * share:.0f} % of the periods the scene asked for more "
                f"{axis.workspace.effort_name} than permitted; the limit is {axis.limits.effort:.3g} "
                f"{axis.workspace.effort_unit}"
            )
        if stalls := cycle.stalls(axis.name):
            yield (
                f"axis {axis.name}: the position stood still under {axis.workspace.effort_name} for "
                f"{axis.limits.stall:g} s, {stalls} times; each time no more than {axis.limits.holding:.3g} "
                f"{axis.workspace.effort_unit} was permitted until contact was left"
            )


def _is_stable(plan: Plan) -> bool:
    """Return whether no axis is judged unstable; an axis without a judgement counts as stable."""
    return all(axis.stability is None or axis.stability.verdict is not Verdict.UNSTABLE for axis in plan.axes)


def _error_of(found: ErrorFigures, contacts: list[float]) -> TorqueError:
    """Return the error of one axis with the largest relative error in contact of all axes."""
    return TorqueError(found.rms, found.max, found.unit, found.by_source, max(contacts, default=None))


def _enabled(run: Run, column: str) -> Array:
    """Return a column from operation enabled on, as far as the record holds it; empty when that was not reached."""
    values, begin_ns = run.record.column(column), run.report.enabled_at_ns
    return values[run.record.column("t_ns") >= begin_ns] if begin_ns is not None else values[:0]


def _recorded(axis: AxisPlan, run: Run) -> Trace:
    """Return the trace of an axis without a known error: the decoded motion and the command, as far as recorded."""
    times_ns = _enabled(run, "t_ns")
    start_ns = run.report.enabled_at_ns or 0
    return Trace(
        axis.name,
        axis.workspace,
        (times_ns - start_ns) * 1e-9,
        _enabled(run, f"{axis.name}.position"),
        _enabled(run, f"{axis.name}.command"),
    )

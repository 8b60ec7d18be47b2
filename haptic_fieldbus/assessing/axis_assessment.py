"""Assessment of one axis of a simulated run, part by part: force error and traces."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.element_forces import POINTS_PER_PERIOD, Handover, Kind, Span, spans
from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.assessing.recording import Array, Conversion, Recording, Times, TrueMotion, Truth, true_motion
from haptic_fieldbus.assessing.result import Trace
from haptic_fieldbus.assessing.run_verdict import FeltError
from haptic_fieldbus.assessing.torque_error import ErrorFigures, ErrorPoints, Splitter
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
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

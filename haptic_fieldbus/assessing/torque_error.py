"""Torque error of a simulated run, split by source.

The error e(t) is the motor torque after the torque loop, through the mechanism, minus the *ideal* torque: the torque of
the scene in continuous time on the true, unquantised trajectory. Sources of error are added one after another: ideal →
sampling and delay → encoder → estimator → integrator → limits → torque step → torque loop. The error of a source is the
difference of two neighbouring stages, so the sources sum to e. The share of a source is ⟨e_i, e⟩/⟨e, e⟩. The shares sum
to 1; a share is negative where a source compensates another one.

1. sampling and delay: the ideal at the sample t_k, held while the command computed from t_k acts
2. encoder: the same with the decoded position; the velocity is still the true one at t_k
   (for a drive that offers velocity only: tachometer, with the velocity read and the position integrated from it)
3. estimator: the same with the estimated velocity (absent when none is estimated)
4. integrator: the force that the loop computed, virtual states by the method of the run (absent without such states)
5. limits: the force that was permitted, which is cut by effort, slew, fade-in and cap
6. torque step: the target torque that the drive followed, rounded to its steps, and limited by the drive itself
7. torque loop: the motor torque

If elements changed during the run, the ideal and the rendered torque go from the old elements to the new ones along the
same ramp. New virtual states begin with the ramp, at rest at the handle's position.

A coupling's force follows both its axes (`ties`).

A long run is split part by part, so that it needs no more memory than a short one: laws, virtual states and delays
continue from one part to the next, and the figures cover the whole run. The last periods of a part are read again with
the next part, because their commands still act there.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.element_forces import (
    POINTS_PER_PERIOD,
    PartState,
    Span,
    begins,
    exact_forces,
    forces_of,
    new_nodes,
    new_rows,
    part_of,
    stepped_forces,
)
from haptic_fieldbus.assessing.recording import (
    Array,
    CommandDelay,
    Conversion,
    Recording,
    Times,
    TrueMotion,
    made_real,
    target_in_force,
    true_motion,
    with_time,
)
from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.element import DynamicElement, Element
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:
    from haptic_fieldbus.assessing.coupling_error import Tie


# What of an error is delay alone: a force of the right shape that comes late.
#
# An edge that the handle meets between two samples comes later than the loop by a part of a period, so that no single
# delay explains all edges of a scene. Of all delays that the loop can have, the one that explains most is taken. The
# torque loop rounds each edge off by its lag, which is no distortion either.

LONGEST_LAG = 512
"""Longest lag [points]."""


class Lateness:
    """The possible delays of a loop with a `period`, a `transport` delay and a `lag` of the torque [s]."""

    def __init__(self, period: float, transport: float, lag: float) -> None:
        parts = round(POINTS_PER_PERIOD)
        self.delays = [transport + period * part / parts for part in range(parts + 1)]
        """[s]"""
        points = max(1e-9, lag * POINTS_PER_PERIOD / period)
        length = min(LONGEST_LAG, math.ceil(8.0 * points))
        weights = np.exp(-np.arange(length) / points) if length else np.ones(1)
        self._weights: Array = weights / weights.sum()

    def ideals(self, times_ns: Times, nodes_ns: Times, ideal: Array) -> list[Array]:
        """Return the `ideal` at these times for each delay, each `(n_times,)`, from its values at the nodes."""
        behind = np.convolve(ideal, self._weights)[: len(ideal)]
        return [np.interp(times_ns - 1e9 * delay, nodes_ns, behind) for delay in self.delays]


# Sums from which the figures of a torque error are made, part by part.
#
# The score of a run is taken in *moving contact* alone: where the ideal is not zero and the handle is faster than 5 %
# of the fastest of the run. Rest would dilute it: a hand that leans for half a minute feels no error, however wrong the
# way was. How fast the fastest is shows only at the end, so points in contact are summed by their speed, in bins of 1
# %.

LIMITS = "limits"
"""Source of error: effort, slew, fade-in and cap."""
MOVING = 0.05
"""Speed from which the handle counts as moving, as a share of the fastest speed of the run."""
_SLOWEST, _FASTEST = 1e-9, 1e6
"""Lowest and highest speed of the bins [m/s or rad/s]."""
_BIN = math.log(1.01)
_BINS = round(math.log(_FASTEST / _SLOWEST) / _BIN) + 2


@dataclass(frozen=True, eq=False)
class ErrorFigures:
    """Error of the motor's force against the ideal [N or N·m], split by source."""

    rms: float
    max: float
    unit: str
    by_source: Mapping[str, float]
    """Shares in the order of the sources; all 0 when there is no error at all."""
    energy_generated: float
    """∫ (force − ideal) dx [J]."""
    touched: int
    """Number of points in contact, moving or not."""
    scored: int
    """Number of points in moving contact."""
    ideal_rms_contact: float
    """Rms of the ideal over the points in moving contact; 0 without any."""
    error_rms_contact: float
    """Rms of the error there."""
    shape_rms_contact: float
    """Rms there of the error against the ideal delayed by `late`: the error that delay does not explain."""
    late: float
    """Possible delay of the loop that explains most of the error [s]."""
    replay_difference: float
    """Largest difference between the recorded force and the force computed anew from the recorded feedback.

    It checks the split itself: a difference above rounding means that the loop rendered something else.
    """


@dataclass
class ErrorSums:
    """Sums over the points of a run so far."""

    points: int = 0
    square: float = 0.0
    largest: float = 0.0
    by_source: dict[str, float] = field(default_factory=dict)
    energy: float = 0.0
    replay_difference: float = 0.0
    fastest: float = 0.0
    touched: NDArray[np.float64] = field(default_factory=lambda: np.zeros((_BINS, 0)))
    """By speed: number of points in contact, and sums of squares of the ideal, the error, and each error of shape."""

    def add(
        self, error: Array, ideal: Array, sources: Mapping[str, Array], speed: Array, shapes: Sequence[Array]
    ) -> None:
        """Add points; error, ideal, each source, `speed` and the errors of shape have the shape `(n_points,)`."""
        self.points += len(error)
        self.square += float(error @ error)
        self.largest = max(self.largest, float(np.abs(error).max(initial=0.0)))
        for name, source in sources.items():
            self.by_source[name] = self.by_source.get(name, 0.0) + float(source @ error)
        pace = np.abs(speed)
        self.fastest = max(self.fastest, float(pace.max(initial=0.0)))
        touching = ideal != 0.0
        bins = _bin(pace[touching])
        squares = [each[touching] ** 2 for each in (ideal, error, *shapes)]
        new = [np.bincount(bins, minlength=_BINS), *(np.bincount(bins, each, minlength=_BINS) for each in squares)]
        self.touched = np.column_stack(new) + (self.touched if self.touched.size else 0.0)

    def figures(self, unit: str, delays: Sequence[float]) -> ErrorFigures:
        """Return the figures of all points so far, at least one; `delays` are those of the shapes [s]."""
        # The bin of the threshold itself counts whole.
        moving = self.touched[int(_bin(np.array([MOVING * self.fastest]))[0]) :].sum(axis=0)
        ideal, wrong, *shapes = np.sqrt(moving[1:] / max(1.0, moving[0]))
        best = int(np.argmin(shapes))
        square = self.square
        return ErrorFigures(
            rms=float(np.sqrt(square / self.points)),
            max=self.largest,
            unit=unit,
            by_source={
                name: share / square if square else 0.0
                for name, share in self.by_source.items()
                if share or name != LIMITS  # limits that were never at work are no source
            },
            energy_generated=self.energy,
            touched=int(self.touched[:, 0].sum()),
            scored=int(moving[0]),
            ideal_rms_contact=float(ideal),
            error_rms_contact=float(wrong),
            shape_rms_contact=float(shapes[best]),
            late=delays[best],
            replay_difference=self.replay_difference,
        )


def _bin(speed: Array) -> NDArray[np.int64]:
    """Return the bins of speeds, whose edges are 1 % apart."""
    return (np.log(np.clip(speed, _SLOWEST, _FASTEST) / _SLOWEST) / _BIN).astype(np.int64)


@dataclass(frozen=True, eq=False)
class ErrorPoints:
    """Error at the points of a part of a run [N or N·m]; arrays have the shape `(n_points,)`."""

    times_ns: Times
    position: Array
    """True position of the handle [m or rad]."""
    force: Array
    """Force of the motor."""
    ideal: Array
    error: Array
    sources: Mapping[str, Array]
    """Error of each source; they sum to `error`."""
    virtual: Mapping[str, Array]
    """Ideal virtual states by the name of their element, each `(n_points, order)`."""


class Splitter:
    """Splits the error of one axis, part by part, from `begin_ns` to the last sample, at `POINTS_PER_PERIOD`.

    `period` [s] and `method` (integrator of virtual states; None for the default) are those of the run. `begin_ns` is
    the end of the fade-in. `step` is one step of the drive's torque [N or N·m]; `late` is the delay of the loop without
    its hold, and the lag of its torque [s].
    """

    def __init__(
        self,
        *,
        period: float,
        begin_ns: int,
        method: str | None = None,
        unit: str = "N",
        step: float = 0.0,
        late: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._period, self._method, self._unit = period, method, unit
        self._begin_ns = begin_ns
        self._spacing_ns = round(period * 1e9 / POINTS_PER_PERIOD)
        self._half_step = 0.5 * step * (1.0 + 1e-9)
        self._lateness = Lateness(period, *late)
        self._sums, self._carried, self._delay = ErrorSums(), PartState(), CommandDelay()
        self._node_ns: int | None = None

    @property
    def figures(self) -> ErrorFigures | None:
        """Figures of all parts so far; None before the end of the fade-in."""
        return self._sums.figures(self._unit, self._lateness.delays) if self._sums.points else None

    def take(
        self,
        recording: Recording,
        trajectory: TrueMotion,
        conversion: Conversion,
        *,
        acted: Sequence[Span[Element]],
        ties: Sequence["Tie"] = (),
    ) -> ErrorPoints:
        """Return the points of the next part of the run, after the end of the fade-in.

        `acted` has the spans of the elements that act in new periods of this part, `ties` the couplings with other
        axes. Raises ValueError when the drive has taken over no recorded command.
        """
        overlap = recording.overlap
        nodes_ns = self._nodes(recording)
        shown = nodes_ns >= self._begin_ns
        # The first node belongs to the part before, or is a sample: virtual states start from it.
        shown[0] = False
        motion, force = true_motion(nodes_ns, trajectory, conversion)
        sampled, _ = true_motion(recording.times_ns, trajectory, conversion)
        ideal, stages, virtual = self._stages(acted, recording, motion, sampled, nodes_ns, ties)
        for name, stage in stages.items():
            stage[:overlap] = self._carried.tail(name, overlap)
        self._carried.stages = stages
        late = self._lateness.ideals(nodes_ns[shown], nodes_ns, ideal)
        times_ns, ideal, force = nodes_ns[shown], ideal[shown], force[shown]

        acting_ns, row = self._delay.acting(recording, trajectory, conversion.ratio)
        # The command in force at each point; before the first known instant, that of the first acting period.
        held = row[np.maximum(np.searchsorted(acting_ns, times_ns, side="right") - 1, 0)]
        levels = {name: stage[held] for name, stage in stages.items()}
        levels["torque step"] = target_in_force(trajectory, times_ns) / conversion.ratio
        levels["torque loop"] = force
        steps = pairwise([("ideal", ideal), *levels.items()])
        sources = {name: after - before for (_, before), (name, after) in steps}
        error = force - ideal

        speed = motion[Signal.VELOCITY][shown]
        self._sums.add(error, ideal, sources, speed, [force - each for each in late])
        self._sums.energy += float(error @ speed) * self._spacing_ns * 1e-9
        replayed = self._replay(acted, recording, ties)[overlap:] - recording.force[overlap:]
        self._sums.replay_difference = max(self._sums.replay_difference, float(np.abs(replayed).max()))
        self._node_ns = int(nodes_ns[-1])
        return ErrorPoints(
            times_ns=times_ns,
            position=motion[Signal.POSITION][shown],
            force=force,
            ideal=ideal,
            error=error,
            sources=sources,
            virtual={name: states[shown] for name, states in virtual.items()},
        )

    def _nodes(self, recording: Recording) -> Times:
        """Return the last node before this part, or its first sample, then points up to the last sample, `(n_nodes,)`.

        The points are equally spaced. They begin half a spacing after the first sample of the run, away from the
        instants at which the sampled position is exact.
        """
        spacing_ns, last = self._spacing_ns, int(recording.times_ns[-1])
        if self._node_ns is not None:
            return np.arange(self._node_ns, last + 1, spacing_ns, dtype=np.int64)
        first = int(recording.times_ns[0])
        return np.concatenate([[first], np.arange(first + spacing_ns // 2, last + 1, spacing_ns, dtype=np.int64)])

    def _stages(
        self,
        acted: Sequence[Span[Element]],
        recording: Recording,
        motion: Mapping[Signal, Array],
        sampled: Mapping[Signal, Array],
        nodes_ns: Times,
        ties: Sequence["Tie"],
    ) -> tuple[Array, dict[str, Array], dict[str, Array]]:
        """Return the ideal force at the nodes, the force of each stage in each period, and the ideal virtual states.

        Shapes: `(n_nodes,)`; each stage `(n_periods,)`; each element's states `(n_nodes, order)`. `motion` is the true
        motion at the nodes, `sampled` the true motion at the samples.
        """
        motion = with_time(motion, nodes_ns, recording)
        sampled = with_time(sampled, recording.times_ns, recording)
        feedback = made_real(recording, sampled)
        ideal = np.zeros(len(nodes_ns))
        stages = {name: np.zeros(len(recording.position)) for name in feedback}
        virtual: dict[str, Array] = {}
        carried, period, times_ns = self._carried, self._period, recording.times_ns
        for span in acted:
            element, rows = span.element, new_rows(span, recording.overlap)
            within = new_nodes(span, recording.overlap, nodes_ns, times_ns)
            if begins(span, recording.overlap):
                # The loop starts the element with the inputs of the instant at which it begins.
                start = {each: values[span.before] for each, values in sampled.items()}
                start_ns = times_ns[span.before]
            else:
                start, start_ns = {each: values[0] for each, values in motion.items()}, nodes_ns[0]
            way = {each: np.append(start[each], values[within]) for each, values in motion.items()}
            truth, real = part_of(sampled, rows), {name: part_of(each, rows) for name, each in feedback.items()}
            if isinstance(element, DynamicElement):
                way_ns = np.append(start_ns, nodes_ns[within])
                forces = exact_forces(element, span, way_ns, way, times_ns[rows], truth, real, carried, period)
            else:
                forces = stepped_forces(span, recording.overlap, way, real, carried, period)
            if forces.states is not None:
                known = virtual.setdefault(element.name, np.zeros((len(nodes_ns), forces.states.shape[1])))
                known[within] = forces.states
            for name, stage in forces.stages.items():
                stages[name][rows] += span.share[rows] * stage
            ideal[within] += forces.ideal * np.interp(nodes_ns[within], times_ns, span.share)
        for tie in ties:
            ideal += tie.ideal(motion, nodes_ns, period / POINTS_PER_PERIOD, carried)
            for name, stage in tie.stages(feedback, period, carried).items():
                stages[name] += stage
        if virtual:  # otherwise the stage before already is the computed force
            stages["integrator"] = recording.force.copy()
        # What was permitted is recorded in whole steps; a difference that is no rounding is a limit at work.
        cut = np.abs(recording.command - recording.force) > self._half_step
        stages[LIMITS] = np.where(cut, recording.command, recording.force)
        return ideal, stages, virtual

    def _replay(self, acted: Sequence[Span[Element]], recording: Recording, ties: Sequence["Tie"]) -> Array:
        """Return the force computed anew from the recorded feedback, with the steps of the loop, `(n_periods,)`."""
        feedback = with_time({Signal.POSITION: recording.position}, recording.times_ns, recording)
        if recording.velocity is not None:
            feedback[Signal.VELOCITY] = recording.velocity
        total = np.zeros(len(recording.position))
        for span in acted:
            rows, element = new_rows(span, recording.overlap), span.element
            law = self._carried.law((*span.key, "replay"), partial(law_of, element, self._period, self._method))
            total[rows] += span.share[rows] * forces_of(law, element, part_of(feedback, rows))
        for tie in ties:
            total += tie.replayed(feedback, self._period, self._carried)
        return total

"""Torque error of a simulated run, split by source.

The error e(t) is the motor torque after the torque loop, through the mechanism, minus the *ideal* torque: that of the
scene in continuous time on the true, unquantised trajectory. Sources of error are made real one after another: ideal →
sampling and delay → encoder → estimator → integrator → torque step → torque loop. The error of a source is the
difference of two neighbouring stages, so the sources sum to e. The share of a source is ⟨e_i, e⟩/⟨e, e⟩. The shares sum
to 1; a share is negative where a source compensates another one.

1. sampling and delay: the ideal at the sample t_k, held while the command computed from t_k acts
2. encoder: the same with the decoded position; the velocity is still the true one at t_k
   (for a drive that offers velocity only: tachometer, with the velocity read and the position integrated from it)
3. estimator: the same with the estimated velocity (absent when none is estimated)
4. integrator: the force that the loop computed, virtual states by the method of the run (absent without such states)
5. torque step: the target torque that the drive followed, which is rounded, limited and faded
6. torque loop: the motor torque

Where elements changed while the loop ran, the ideal and the rendered torque go from the old elements to the new ones
along the same ramp. New virtual states begin with the ramp, at rest at the handle's position.

A coupling's force follows both its axes (`ties`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat, starmap
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.recording import (
    Array,
    Conversion,
    Recording,
    Times,
    TrueMotion,
    acting,
    columns_of,
    made_real,
    target_in_force,
    true_motion,
    with_time,
)
from haptic_fieldbus.assessing.spans import Handover, Span, spans
from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.element import DynamicElement, Element
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:  # imported for its type alone: a scene without couplings never loads it
    from haptic_fieldbus.assessing.ties import Tie

POINTS_PER_PERIOD = 16 / 1.001
"""Points per period at which the error is taken.

Slightly off 16, so that the points drift through all phases of the period in the course of a run; with a whole number,
the same 16 phases would be taken in every period.
"""


@dataclass(frozen=True, eq=False)
class ErrorSplit:
    """Error of the motor's force against the ideal [N or N·m], split by source; arrays have the shape `(n_points,)`."""

    rms: float
    max: float
    unit: str
    by_source: Mapping[str, float]
    """Shares in the order of the sources; all 0 when there is no error at all."""
    energy_generated: float
    """∫ (force − ideal) dx [J]."""
    ideal_rms_contact: float
    """Rms of the ideal over the points in contact; 0 without contact."""
    error_rms_contact: float
    """Rms of the error over the points in contact; 0 without contact."""
    replay_difference: float
    """Largest difference between the recorded force and the force computed anew from the recorded feedback.

    It checks the split itself: a difference above rounding means that the loop rendered something else.
    """
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

    @property
    def contact(self) -> NDArray[np.bool_]:
        """Mask of the points in contact, where the ideal is not zero, `(n_points,)`."""
        mask: NDArray[np.bool_] = self.ideal != 0.0
        return mask


def split(
    elements: Sequence[Element],
    recording: Recording,
    trajectory: TrueMotion,
    conversion: Conversion,
    *,
    period: float,
    begin_ns: int,
    method: str | None = None,
    unit: str = "N",
    exchanges: Sequence[Handover[Element]] = (),
    ties: Sequence["Tie"] = (),
) -> ErrorSplit:
    """Return the error from `begin_ns` to the last recorded sample, at `POINTS_PER_PERIOD`.

    `period` [s] and `method` (integrator of virtual states; None for the default) are those of the run. `begin_ns` is
    the end of the fade-in. `exchanges` are the changes of elements, in order; `ties` the couplings with other axes.

    Raises ValueError when nothing was recorded in that time, or when the drive took over no recorded command.
    """
    spacing_ns = round(period * 1e9 / POINTS_PER_PERIOD)
    nodes_ns = _nodes(recording.times_ns, spacing_ns)
    shown = nodes_ns >= begin_ns
    # The first node is a sample, and no full spacing before the next; it is there for the virtual states to start from.
    shown[0] = False
    if not shown.any():
        raise ValueError(f"nothing was recorded after {begin_ns} ns")
    motion, force = true_motion(nodes_ns, trajectory, conversion)
    sampled, _ = true_motion(recording.times_ns, trajectory, conversion)
    acted = spans(elements, exchanges, recording.times_ns)
    ideal, stages, virtual = _stages(acted, recording, motion, sampled, nodes_ns, period, ties)
    times_ns, ideal, force = nodes_ns[shown], ideal[shown], force[shown]

    acting_ns, row = acting(recording, trajectory, conversion.ratio)
    # The command in force at each point; before the first known instant, that of the first acting period.
    held = row[np.maximum(np.searchsorted(acting_ns, times_ns, side="right") - 1, 0)]
    levels = {name: stage[held] for name, stage in stages.items()}
    levels["torque step"] = target_in_force(trajectory, times_ns) / conversion.ratio
    levels["torque loop"] = force
    sources, before = {}, ideal
    for name, level in levels.items():
        sources[name], before = level - before, level

    error = force - ideal
    square = float(error @ error)
    return ErrorSplit(
        rms=_rms(error),
        max=float(np.abs(error).max()),
        unit=unit,
        by_source={name: float(source @ error) / square if square else 0.0 for name, source in sources.items()},
        energy_generated=float(error @ motion[Signal.VELOCITY][shown]) * spacing_ns * 1e-9,
        ideal_rms_contact=_rms(ideal[ideal != 0.0]),
        error_rms_contact=_rms(error[ideal != 0.0]),
        replay_difference=float(np.abs(_replay(acted, recording, period, method, ties) - recording.force).max()),
        times_ns=times_ns,
        position=motion[Signal.POSITION][shown],
        force=force,
        ideal=ideal,
        error=error,
        sources=sources,
        virtual={name: states[shown] for name, states in virtual.items()},
    )


def _rms(values: Array) -> float:
    """Return the root mean square of values of shape `(n,)`; 0 when there are none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _nodes(times_ns: Times, spacing_ns: int) -> Times:
    """Return the first sample, then points spaced by `spacing_ns` up to the last sample, `(n_nodes,)`.

    The points begin half a spacing after the sample, away from the instants at which the sampled position is exact.
    """
    first, last = int(times_ns[0]), int(times_ns[-1])
    return np.concatenate([[first], np.arange(first + spacing_ns // 2, last + 1, spacing_ns, dtype=np.int64)])


def _stages(
    acted: Sequence[Span[Element]],
    recording: Recording,
    motion: Mapping[Signal, Array],
    sampled: Mapping[Signal, Array],
    nodes_ns: Times,
    period: float,
    ties: Sequence["Tie"],
) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """Return the ideal force at the nodes, the force of each stage in each period, and the ideal virtual states.

    Shapes: `(n_nodes,)`; each stage `(n_periods,)`; each element's states `(n_nodes, order)`. `motion` is the true
    motion at the nodes, `sampled` that at the samples.
    """
    motion = with_time(motion, nodes_ns, recording)
    sampled = with_time(sampled, recording.times_ns, recording)
    feedback = made_real(recording, sampled)
    ideal = np.zeros(len(nodes_ns))
    stages = {name: np.zeros(len(recording.position)) for name in feedback}
    virtual: dict[str, Array] = {}
    for span in acted:
        element, rows, times_ns = span.element, span.rows, recording.times_ns
        within = _nodes_of(span, nodes_ns, times_ns)
        share, truth = span.share[rows], _part(sampled, rows)
        # The element's inputs at its nodes, after those of the instant at which it begins: the loop starts it there.
        way = {each: np.append(sampled[each][span.before], values[within]) for each, values in motion.items()}
        if isinstance(element, DynamicElement):
            from haptic_fieldbus.assessing.virtual_states import exact_response, response_to_error

            exact = exact_response(element, np.append(times_ns[span.before], nodes_ns[within]), way)
            force = exact.force
            known = virtual.setdefault(element.name, np.zeros((len(nodes_ns), exact.states.shape[1])))
            known[within] = exact.states[1:]
            at_samples = exact.force_at(times_ns[rows], truth[Signal.POSITION], truth[Signal.VELOCITY])
            # The element is linear: the answer to imperfect inputs is the exact one plus that to their error alone.
            for name, real in feedback.items():
                stages[name][rows] += share * (
                    at_samples + response_to_error(element, _part(real, rows), truth, period)
                )
        else:
            # A memory is stepped from node to node, 16 times finer than in the loop, in place of continuous time.
            force = _forces(law_of(element, period / POINTS_PER_PERIOD), element, way)
            for name, real in feedback.items():
                stages[name][rows] += share * _forces(law_of(element, period), element, _part(real, rows))
        ideal[within] += force[1:] * np.interp(nodes_ns[within], times_ns, span.share)
    for tie in ties:
        ideal += tie.ideal(motion, nodes_ns, period / POINTS_PER_PERIOD)
        for name, forces in tie.stages(feedback, period).items():
            stages[name] += forces
    if virtual:  # otherwise the stage before already is the computed force
        stages["integrator"] = recording.force
    return ideal, stages, virtual


def _nodes_of(span: Span[Element], nodes_ns: Times, times_ns: Times) -> slice:
    """Return the slice of nodes after the period in which the span's ramp begins, up to its last period."""
    first, last = np.searchsorted(nodes_ns, [times_ns[span.before], times_ns[span.last - 1]], side="right")
    return slice(int(first), int(last))


def _part(feedback: Mapping[Signal, Array], rows: slice) -> dict[Signal, Array]:
    """Return the feedback in these periods only."""
    return {signal: values[rows] for signal, values in feedback.items()}


def _forces(law: Callable[..., float], element: Element, feedback: Mapping[Signal, Array]) -> Array:
    """Return the forces of a law, called once for each instant of the feedback in turn, `(n,)`."""
    needed = columns_of(element.needs, feedback)
    count = len(feedback[Signal.POSITION])
    # An element that needs no signal is called all the same, once an instant.
    rows = zip(*needed, strict=True) if needed else repeat((), count)
    return np.fromiter(starmap(law, rows), dtype=np.float64, count=count)


def _replay(
    acted: Sequence[Span[Element]], recording: Recording, period: float, method: str | None, ties: Sequence["Tie"]
) -> Array:
    """Return the force computed anew from the recorded feedback, with the steps of the loop, `(n_periods,)`."""
    feedback = with_time({Signal.POSITION: recording.position}, recording.times_ns, recording)
    if recording.velocity is not None:
        feedback[Signal.VELOCITY] = recording.velocity
    total = np.zeros(len(recording.position))
    for span in acted:
        law, rows = law_of(span.element, period, method), span.rows
        total[rows] += span.share[rows] * _forces(law, span.element, _part(feedback, rows))
    for tie in ties:
        total += tie.replayed(feedback, period)
    return total

"""The torque error of a simulated run, split by source.

e(t) = motor torque after the torque loop, through the mechanism, minus the *ideal*: the scene in continuous time on the
true, unquantised trajectory. Things are made real one after another, ideal → sampling and delay → encoder → estimator →
integrator → torque step → torque loop; each source is the difference of two neighbours, so they sum to e. The share of
a source is ⟨e_i, e⟩/⟨e, e⟩; shares sum to 1 and can be negative where a source undoes another.

1. sampling and delay: the ideal at t_k, held while the command computed from t_k acts
2. encoder: the same of the position that was decoded, the velocity still the true one at t_k
   (of a drive that offers velocity only: tachometer, with the velocity that was read and the position that it made)
3. estimator: with the velocity that was estimated (left out where none is)
4. integrator: the force that was computed, virtual states by the method of the run (left out where there are none)
5. torque step: the target that the drive followed: rounded, limited, faded
6. torque loop: the motor's torque

Where elements changed while the loop ran, both the ideal and what was rendered go over from the old to the new along
the same ramp; new virtual states begin where it begins, at rest where the handle is then.

A coupling's force follows both its axes: the ideal answers the true motion of both, and what is made real is made so on
both.
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

if TYPE_CHECKING:  # a scene without couplings does without it
    from haptic_fieldbus.assessing.ties import Tie

POINTS_PER_PERIOD = 16 / 1.001
"""A little off 16: in the course of a run the points come to lie at every phase of the period, none is preferred."""


@dataclass(frozen=True, eq=False)
class ErrorSplit:
    """How far the motor's force [N or N·m] was from the ideal, and why; arrays of shape (m,)."""

    rms: float
    max: float
    unit: str
    by_source: Mapping[str, float]
    """Shares in the order of the sources; all 0 where there is no error at all."""
    energy_generated: float
    """∫ (force − ideal) dx [J]."""
    ideal_rms_contact: float
    """Over the points where the ideal is not zero; 0 without contact."""
    error_rms_contact: float
    replay_difference: float
    """Largest difference between the recorded force and the elements computed anew from the recorded feedback."""
    times_ns: Times
    position: Array
    """True, of the handle."""
    force: Array
    """Of the motor."""
    ideal: Array
    error: Array
    sources: Mapping[str, Array]
    virtual: Mapping[str, Array]
    """Ideal virtual states by the name of their element, (m, order)."""

    @property
    def contact(self) -> NDArray[np.bool_]:
        """Where the ideal is not zero."""
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
    """The error from `begin_ns` (full fade-in) to the last recorded sample, at 16 points a period.

    `ties` are the couplings with other axes.

    ValueError when nothing was recorded in that time, or no recorded command was ever taken over by the drive.
    """
    spacing_ns = round(period * 1e9 / POINTS_PER_PERIOD)
    nodes_ns = _nodes(recording.times_ns, spacing_ns)
    shown = nodes_ns >= begin_ns
    shown[0] = False
    if not shown.any():
        raise ValueError(f"nothing was recorded after {begin_ns} ns")
    motion, force = true_motion(nodes_ns, trajectory, conversion)
    sampled, _ = true_motion(recording.times_ns, trajectory, conversion)
    acted = spans(elements, exchanges, recording.times_ns)
    ideal, stages, virtual = _stages(acted, recording, motion, sampled, nodes_ns, period, ties)
    times_ns, ideal, force = nodes_ns[shown], ideal[shown], force[shown]

    acting_ns, row = acting(recording, trajectory, conversion.ratio)
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
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _nodes(times_ns: Times, spacing_ns: int) -> Times:
    """The first sample, then points spaced by about a sixteenth of a period up to the last sample, none at a sample."""
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
    """(ideal at the nodes, force of each period with more and more made real, ideal virtual states)"""
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
        way = {each: np.append(sampled[each][span.before], values[within]) for each, values in motion.items()}
        if isinstance(element, DynamicElement):
            from haptic_fieldbus.assessing.virtual_states import exact_response, response_to_error

            exact = exact_response(element, np.append(times_ns[span.before], nodes_ns[within]), way)
            force = exact.force
            known = virtual.setdefault(element.name, np.zeros((len(nodes_ns), exact.states.shape[1])))
            known[within] = exact.states[1:]
            at_samples = exact.force_at(times_ns[rows], truth[Signal.POSITION], truth[Signal.VELOCITY])
            for name, real in feedback.items():
                stages[name][rows] += share * (
                    at_samples + response_to_error(element, _part(real, rows), truth, period)
                )
        else:
            force = _forces(law_of(element, period / POINTS_PER_PERIOD), element, way)
            for name, real in feedback.items():
                stages[name][rows] += share * _forces(law_of(element, period), element, _part(real, rows))
        ideal[within] += force[1:] * np.interp(nodes_ns[within], times_ns, span.share)
    for tie in ties:
        ideal += tie.ideal(motion, nodes_ns, period / POINTS_PER_PERIOD)
        for name, forces in tie.stages(feedback, period).items():
            stages[name] += forces
    if virtual:
        stages["integrator"] = recording.force
    return ideal, stages, virtual


def _nodes_of(span: Span[Element], nodes_ns: Times, times_ns: Times) -> slice:
    """The nodes after the period in which the element's ramp begins, up to the last in which it acts."""
    first, last = np.searchsorted(nodes_ns, [times_ns[span.before], times_ns[span.last - 1]], side="right")
    return slice(int(first), int(last))


def _part(feedback: Mapping[Signal, Array], rows: slice) -> dict[Signal, Array]:
    return {signal: values[rows] for signal, values in feedback.items()}


def _forces(law: Callable[..., float], element: Element, feedback: Mapping[Signal, Array]) -> Array:
    needed = columns_of(element.needs, feedback)
    count = len(feedback[Signal.POSITION])
    rows = zip(*needed, strict=True) if needed else repeat((), count)
    return np.fromiter(starmap(law, rows), dtype=np.float64, count=count)


def _replay(
    acted: Sequence[Span[Element]], recording: Recording, period: float, method: str | None, ties: Sequence["Tie"]
) -> Array:
    """The elements once more, with the recorded feedback and the steps of the loop."""
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

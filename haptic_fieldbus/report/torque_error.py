"""The torque error of a simulated run, split by source.

e(t) = motor torque after the torque loop, through the mechanism, minus the *ideal*: the scene in continuous time on the
true, unquantised trajectory. Things are made real one after another, ideal → sampling and delay → encoder → estimator →
integrator → torque step → torque loop; each source is the difference of two neighbours, so they sum to e. The share of
a source is ⟨e_i, e⟩/⟨e, e⟩; shares sum to 1 and can be negative where a source undoes another.

1. sampling and delay: the ideal at t_k, held while the command computed from t_k acts
2. encoder: the same of the position that was decoded, the velocity still the true one at t_k
3. estimator: with the velocity that was estimated (left out where none is)
4. integrator: the force that was computed, virtual states by the method of the run (left out where there are none)
5. torque step: the target that the drive followed: rounded, limited, faded
6. torque loop: the motor's torque
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.axis_cycle import law_of
from haptic_fieldbus.report.recording import (
    Array,
    Conversion,
    Recording,
    Times,
    Trajectory,
    acting,
    target_in_force,
    true_motion,
)
from haptic_fieldbus.scenes.element import DynamicElement, Element
from haptic_fieldbus.signals import Signal

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
    trajectory: Trajectory,
    conversion: Conversion,
    *,
    period: float,
    begin_ns: int,
    method: str | None = None,
    unit: str = "N",
) -> ErrorSplit:
    """The error from `begin_ns` (full fade-in) to the last recorded sample, at 16 points a period.

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
    ideal, stages, virtual = _stages(elements, recording, motion, sampled, nodes_ns, period)
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
        replay_difference=float(np.abs(_replay(elements, recording, period, method) - recording.force).max()),
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
    elements: Sequence[Element],
    recording: Recording,
    motion: Mapping[Signal, Array],
    sampled: Mapping[Signal, Array],
    nodes_ns: Times,
    period: float,
) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """(ideal at the nodes, force of each period with more and more made real, ideal virtual states)"""
    decoded = {Signal.POSITION: recording.position, Signal.VELOCITY: sampled[Signal.VELOCITY]}
    feedback = {"sampling and delay": sampled, "encoder": decoded}
    if recording.velocity is not None:
        feedback["estimator"] = {**decoded, Signal.VELOCITY: recording.velocity}
    ideal = np.zeros(len(nodes_ns))
    stages = {name: np.zeros(len(recording.position)) for name in feedback}
    virtual: dict[str, Array] = {}
    for element in elements:
        if isinstance(element, DynamicElement):
            from haptic_fieldbus.report.virtual_states import exact_response, response_to_error

            exact = exact_response(element, nodes_ns, motion)
            at_samples = exact.force_at(recording.times_ns, sampled[Signal.POSITION], sampled[Signal.VELOCITY])
            virtual[element.name] = exact.states
            ideal += exact.force
            for name, real in feedback.items():
                stages[name] += at_samples + response_to_error(element, real, sampled, period)
        else:
            law = law_of(element, period)
            ideal += _forces(law, element, motion)
            for name, real in feedback.items():
                stages[name] += _forces(law, element, real)
    if virtual:
        stages["integrator"] = recording.force
    return ideal, stages, virtual


def _forces(law: Callable[..., float], element: Element, feedback: Mapping[Signal, Array]) -> Array:
    needed = [feedback[signal].tolist() for signal in element.needs]
    return np.fromiter(map(law, *needed), dtype=np.float64, count=len(needed[0]))


def _replay(elements: Sequence[Element], recording: Recording, period: float, method: str | None) -> Array:
    """The elements once more, with the recorded feedback and the steps of the loop."""
    feedback = {Signal.POSITION: recording.position}
    if recording.velocity is not None:
        feedback[Signal.VELOCITY] = recording.velocity
    total = np.zeros(len(recording.position))
    for element in elements:
        total += _forces(law_of(element, period, method), element, feedback)
    return total

"""Contribution of a coupling to the torque error of one of its axes.

A coupling's force follows both axes. The ideal force is that of the true motion of both; in the stages of the error
split, each source of error is added on both axes at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import starmap

import numpy as np

from haptic_fieldbus.assessing.element_forces import Key, PartState, Span, new_nodes, new_rows, part_of
from haptic_fieldbus.assessing.recording import (
    Array,
    Conversion,
    Recording,
    Times,
    TrueMotion,
    columns_of,
    made_real,
    true_motion,
    with_time,
)
from haptic_fieldbus.scenes.element import CouplingElement, PairLaw
from haptic_fieldbus.signals import Signal

Feedback = Mapping[Signal, Array]


@dataclass(frozen=True, eq=False)
class Tie:
    """Coupling seen from one of its axes, "this axis"; the recording, motion and conversion are the other axis's."""

    span: Span[CouplingElement]
    place: int
    """Index of this axis in `element.axes`: 0 or 1."""
    recording: Recording
    trajectory: TrueMotion
    conversion: Conversion

    def ideal(self, own: Feedback, nodes_ns: Times, step: float, carried: PartState) -> Array:
        """Return the ideal force on this axis at the nodes [N or N·m], `(n_nodes,)`.

        `own` is the true motion of this axis at `nodes_ns`. `step` is the distance of the nodes [s]; the memory of a
        coupling advances by it.
        """
        motion, _ = true_motion(nodes_ns, self.trajectory, self.conversion)
        other = with_time(motion, nodes_ns, self.recording)
        within = new_nodes(self.span, self.recording.overlap, nodes_ns, self.recording.times_ns)
        if self.span.first == self.recording.overlap == 0:
            within = slice(0, within.stop)  # the first sample of the run is a node as well
        forces = np.zeros(len(nodes_ns))
        law = carried.law(self._key("ideal"), lambda: self.span.element.begin(step))
        share = np.interp(nodes_ns[within], self.recording.times_ns, self.span.share)
        forces[within] = share * self._forces(law, own, other, within)
        return forces

    def stages(self, feedback: Mapping[str, Feedback], period: float, carried: PartState) -> dict[str, Array]:
        """Return the force on this axis in each new period, for each stage of its feedback, each `(n_periods,)`.

        `feedback` is that of this axis by source of error, from `made_real`; `period` [s] is that of the loop.
        """
        sampled, _ = true_motion(self.recording.times_ns, self.trajectory, self.conversion)
        other = made_real(self.recording, with_time(sampled, self.recording.times_ns, self.recording))
        # This axis may have a stage that the other lacks, since it estimates a velocity for another element.
        others = {name: other.get(name, list(other.values())[-1]) for name in feedback}
        return {name: self._in_periods(name, own, others[name], period, carried) for name, own in feedback.items()}

    def replayed(self, own: Feedback, period: float, carried: PartState) -> Array:
        """Return the force on this axis in each new period, computed anew from the feedback of both axes.

        Its shape is `(n_periods,)`; `own` is the recorded feedback of this axis, `period` [s] that of the loop.
        """
        other = list(made_real(self.recording, own).values())[-1]
        return self._in_periods("replay", own, other, period, carried)

    def _key(self, purpose: str) -> Key:
        return ("coupling", *self.span.key, purpose)

    def _in_periods(self, purpose: str, own: Feedback, other: Feedback, period: float, carried: PartState) -> Array:
        """Return the force in each new period, by a law that keeps its memory from part to part, `(n_periods,)`."""
        rows = new_rows(self.span, self.recording.overlap)
        law = carried.law(self._key(purpose), lambda: self.span.element.begin(period))
        forces = np.zeros(len(self.recording.times_ns))
        forces[rows] = self.span.share[rows] * self._forces(law, own, other, rows)
        return forces

    def _forces(self, law: PairLaw, own: Feedback, other: Feedback, part: slice) -> Array:
        """Return the forces on this axis, `(n,)`, from feedback of both axes at the n instants of a part."""
        # The law takes the axes in the order of the element, and returns a force for each.
        both = (other, own) if self.place else (own, other)
        needs, place = self.span.element.needs, self.place
        needed = [column for feedback in both for column in columns_of(needs, part_of(feedback, part))]
        pairs = starmap(law, zip(*needed, strict=True))
        count = len(own[Signal.POSITION][part])
        return np.fromiter((pair[place] for pair in pairs), dtype=np.float64, count=count)

"""Contribution of a coupling to the torque error of one of its axes.

A coupling's force follows both axes. The ideal force is that of the true motion of both; in the stages of the error
split, each source of error is made real on both axes at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import starmap

import numpy as np

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
from haptic_fieldbus.scenes.element import CouplingElement
from haptic_fieldbus.signals import Signal

Feedback = Mapping[Signal, Array]


@dataclass(frozen=True, eq=False)
class Tie:
    """Coupling seen from one of its axes, "this axis"; the recording, motion and conversion are the other axis's."""

    element: CouplingElement
    place: int
    """Index of this axis in `element.axes`: 0 or 1."""
    recording: Recording
    trajectory: TrueMotion
    conversion: Conversion
    share: Array
    """Factor 0 to 1 on its force in each recorded period, `(n_periods,)`; straight lines in between."""

    def ideal(self, own: Feedback, nodes_ns: Times, step: float) -> Array:
        """Return the ideal force on this axis at the nodes [N or N·m], `(n_nodes,)`.

        `own` is the true motion of this axis at `nodes_ns`; `step` is their distance [s], with which a memory of the
        coupling advances.
        """
        motion, _ = true_motion(nodes_ns, self.trajectory, self.conversion)
        share = np.interp(nodes_ns, self.recording.times_ns, self.share)
        return share * self._forces(own, with_time(motion, nodes_ns, self.recording), step)

    def stages(self, feedback: Mapping[str, Feedback], period: float) -> dict[str, Array]:
        """Return the force on this axis in each period, for each stage of its feedback, each `(n_periods,)`.

        `feedback` is that of this axis by source of error, from `made_real`; `period` [s] is that of the loop.
        """
        sampled, _ = true_motion(self.recording.times_ns, self.trajectory, self.conversion)
        other = made_real(self.recording, with_time(sampled, self.recording.times_ns, self.recording))
        # This axis may have a stage that the other lacks, since it estimates a velocity for another element.
        last = list(other.values())[-1]
        return {name: self.share * self._forces(own, other.get(name, last), period) for name, own in feedback.items()}

    def replayed(self, own: Feedback, period: float) -> Array:
        """Return the force on this axis in each period, computed anew from the feedback of both axes, `(n_periods,)`.

        `own` is the recorded feedback of this axis; `period` [s] is that of the loop.
        """
        return self.share * self._forces(own, list(made_real(self.recording, own).values())[-1], period)

    def _forces(self, own: Feedback, other: Feedback, period: float) -> Array:
        """Return the forces on this axis, `(n,)`, from feedback of both axes at the same n instants."""
        # The law takes the axes in the order of the element, and returns a force for each.
        both = (other, own) if self.place else (own, other)
        needed = [column for feedback in both for column in columns_of(self.element.needs, feedback)]
        law, place, count = self.element.begin(period), self.place, len(own[Signal.POSITION])
        pairs = starmap(law, zip(*needed, strict=True))
        return np.fromiter((pair[place] for pair in pairs), dtype=np.float64, count=count)

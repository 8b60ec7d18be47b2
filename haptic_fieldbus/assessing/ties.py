"""What the torque error of an axis has from a coupling: the other axis as it truly moved, and as the loop knew it."""

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
    """A coupling as one of its axes feels it: `place` is that of this axis among both, all else is the other's."""

    element: CouplingElement
    place: int
    recording: Recording
    trajectory: TrueMotion
    conversion: Conversion
    share: Array
    """Of its force in each recorded period, where couplings changed while the loop ran; between them straight."""

    def ideal(self, own: Feedback, nodes_ns: Times, step: float) -> Array:
        """The force of the coupling in continuous time on the axis, whose true motion at the nodes is `own`."""
        motion, _ = true_motion(nodes_ns, self.trajectory, self.conversion)
        share = np.interp(nodes_ns, self.recording.times_ns, self.share)
        return share * self._forces(own, with_time(motion, nodes_ns, self.recording), step)

    def stages(self, feedback: Mapping[str, Feedback], period: float) -> dict[str, Array]:
        """The same in each period with more and more made real, on both axes alike."""
        sampled, _ = true_motion(self.recording.times_ns, self.trajectory, self.conversion)
        other = made_real(self.recording, with_time(sampled, self.recording.times_ns, self.recording))
        last = list(other.values())[-1]  # an axis may estimate a velocity that the coupling does not ask for
        return {name: self.share * self._forces(own, other.get(name, last), period) for name, own in feedback.items()}

    def replayed(self, own: Feedback, period: float) -> Array:
        """The coupling once more, with what the loop knew of both."""
        return self.share * self._forces(own, list(made_real(self.recording, own).values())[-1], period)

    def _forces(self, own: Feedback, other: Feedback, period: float) -> Array:
        both = (other, own) if self.place else (own, other)
        needed = [column for feedback in both for column in columns_of(self.element.needs, feedback)]
        law, place, count = self.element.begin(period), self.place, len(own[Signal.POSITION])
        pairs = starmap(law, zip(*needed, strict=True))
        return np.fromiter((pair[place] for pair in pairs), dtype=np.float64, count=count)

"""Figures of the torque error, and the sums over all points of a run from which they follow."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from haptic_fieldbus.assessing.recording import Array


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
    ideal_rms_contact: float
    """Rms of the ideal over the points in contact; 0 without contact."""
    error_rms_contact: float
    """Rms of the error over the points in contact; 0 without contact."""
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
    contact: int = 0
    ideal_contact: float = 0.0
    error_contact: float = 0.0
    replay_difference: float = 0.0

    def add(self, error: Array, ideal: Array, sources: Mapping[str, Array]) -> None:
        """Add points: error, ideal and each source have the shape `(n_points,)`."""
        touching = ideal != 0.0
        self.points += len(error)
        self.square += float(error @ error)
        self.largest = max(self.largest, float(np.abs(error).max(initial=0.0)))
        for name, source in sources.items():
            self.by_source[name] = self.by_source.get(name, 0.0) + float(source @ error)
        self.contact += int(touching.sum())
        self.ideal_contact += float(ideal[touching] @ ideal[touching])
        self.error_contact += float(error[touching] @ error[touching])

    def figures(self, unit: str) -> ErrorFigures:
        """Return the figures of all points so far; there must be one at least."""
        square, contact = self.square, max(1, self.contact)
        return ErrorFigures(
            rms=float(np.sqrt(square / self.points)),
            max=self.largest,
            unit=unit,
            by_source={name: share / square if square else 0.0 for name, share in self.by_source.items()},
            energy_generated=self.energy,
            ideal_rms_contact=float(np.sqrt(self.ideal_contact / contact)),
            error_rms_contact=float(np.sqrt(self.error_contact / contact)),
            replay_difference=self.replay_difference,
        )

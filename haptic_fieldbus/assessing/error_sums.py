"""Sums from which the figures of a torque error are made, part by part.

The score of a run is taken in *moving contact* alone: where the ideal is not zero and the handle is faster than 5 % of
the fastest of the run. Rest would dilute it: a hand that leans for half a minute feels no error, however wrong the way
was. How fast the fastest is shows only at the end, so points in contact are summed by their speed, in bins of 1 %.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.recording import Array

LIMITS = "limits"
"""Source of error: effort, slew, fade-in and cap."""
MOVING = 0.05
"""Share of the fastest speed of the run from which the handle counts as moving."""
_SLOWEST, _FASTEST = 1e-9, 1e6
"""Speeds beyond which bins are not told apart [m/s or rad/s]."""
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
    """Rms there of the error against the ideal of `late` before: what delay alone leaves over."""
    late: float
    """Delay that explains most of the error, of those that the loop can have [s]."""
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
        """Return the figures of all points so far, of which there must be one; `delays` are those of the shapes [s]."""
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

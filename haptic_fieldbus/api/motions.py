"""Prescribed motions of the puck: a step, a ramp, a sine, or the rows of a file."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.defaults import DEFAULT_MOTION_DURATION
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly

Array = NDArray[np.float64]

INPUT_FORMS = "step, ramp, sine@HZ or FILE.csv with the columns time and position"
LARGEST_FREQUENCY = 1e9
"""[Hz]"""


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
    """A motion: the position `rest` before it [m or rad], and `at` from times `(n,)` [s] to positions `(n,)`."""

    rest: float
    at: Callable[[Array], Array]
    duration: float = DEFAULT_MOTION_DURATION
    frequency: float | None = None
    """Of a sine [Hz]."""

    def alias(self, period: float) -> float | None:
        """Return the frequency [Hz] that samples every `period` [s] show of a sine; None where it is its own."""
        if self.frequency is None or self.frequency < 0.5 / period:
            return None
        # A sine of half the rate is sampled where it is 0.
        return 0.0 if self.frequency == 0.5 / period else abs(math.remainder(self.frequency, 1.0 / period))


def motion_of(name: str | Path, amplitude: float) -> PrescribedMotion:
    """Return the motion of a name (`INPUT_FORMS`).

    Raises UsageError when there is none, and DocumentError for a file without one.
    """
    if not math.isfinite(amplitude):
        raise UsageError(f"amplitude {exactly(amplitude)}: expected a number")
    text = str(name)
    if text == "step":
        return PrescribedMotion(0.0, lambda time: np.full_like(time, amplitude))
    if text == "ramp":
        return PrescribedMotion(0.0, lambda time: amplitude * time)
    if text.startswith("sine@"):
        frequency = _frequency(text)
        turn = 2.0 * math.pi * frequency
        return PrescribedMotion(0.0, lambda time: amplitude * np.sin(turn * time), frequency=frequency)
    if Path(text).suffix == ".csv":
        return _recorded(Path(text), amplitude)
    raise UsageError(f'no input "{text}"; there are: {INPUT_FORMS}')


def _frequency(text: str) -> float:
    try:
        frequency = float(text.partition("@")[2])
    except ValueError:
        frequency = math.nan
    if not 0.0 < frequency <= LARGEST_FREQUENCY:
        expected = f"a frequency above 0 in Hz, at most {exactly(LARGEST_FREQUENCY)}, for example sine@2"
        raise UsageError(f'input "{text}": after @ stands {expected}')
    return frequency


def _recorded(path: Path, amplitude: float) -> PrescribedMotion:
    """Return a motion on straight lines between the rows of a file; its first time becomes 0."""
    from haptic_fieldbus.documents.samples import read_samples  # a motion without a file does without it

    rows = read_samples(path, ("position",))
    # Where an amplitude is too large for the positions, the response ends before its first sample.
    with np.errstate(over="ignore"):
        first, places = rows.times[0], amplitude * rows.values
    return PrescribedMotion(
        float(places[0]), lambda time: np.interp(first + time, rows.times, places), float(rows.times[-1] - first)
    )

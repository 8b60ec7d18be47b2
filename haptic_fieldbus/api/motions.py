"""Prescribed motions of the puck: a step, a ramp, a sine, or the rows of a file."""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from io import StringIO
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.defaults import DEFAULT_MOTION_DURATION
from haptic_fieldbus.documents import TABLE_SIZE, read_octets
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly

Array = NDArray[np.float64]

INPUT_FORMS = "step, ramp, sine@HZ or FILE.csv with the columns time and position"
LARGEST_FREQUENCY = 1e9
"""[Hz]"""
MOST_ROWS = 1_000_000
"""Most rows of a file."""


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
    """A motion: the position `rest` before it [m or rad], and `at` from times `(n,)` [s] to positions `(n,)`."""

    rest: float
    at: Callable[[Array], Array]
    duration: float = DEFAULT_MOTION_DURATION


def motion_of(name: str | Path, amplitude: float) -> PrescribedMotion:
    """Return the motion of a name (`INPUT_FORMS`); raises UsageError when there is none."""
    if not math.isfinite(amplitude):
        raise UsageError(f"amplitude {exactly(amplitude)}: expected a number")
    text = str(name)
    if text == "step":
        return PrescribedMotion(0.0, lambda time: np.full_like(time, amplitude))
    if text == "ramp":
        return PrescribedMotion(0.0, lambda time: amplitude * time)
    if text.startswith("sine@"):
        turn = 2.0 * math.pi * _frequency(text)
        return PrescribedMotion(0.0, lambda time: amplitude * np.sin(turn * time))
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
    try:
        text = read_octets(path, TABLE_SIZE).decode("utf-8-sig")
    except OSError as error:
        raise UsageError(f'input "{path}": cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise UsageError(f'input "{path}": not UTF-8, from octet {error.start} on') from error
    try:
        # A generator: the rows as dictionaries would take ten times the memory of their numbers.
        rows = csv.DictReader(StringIO(text, newline=""))
        pairs = ((float(row["time"]), amplitude * float(row["position"])) for row in islice(rows, MOST_ROWS))
        times, places = np.fromiter(pairs, dtype=(np.float64, 2)).T
    except (KeyError, TypeError, ValueError, csv.Error):
        raise UsageError(f'input "{path}": expected the columns time and position, with numbers') from None
    if next(rows, None) is not None:
        raise UsageError(f'input "{path}": too many rows; expected at most {MOST_ROWS}')
    if len(times) < 2 or not (np.diff(times) > 0.0).all() or not np.isfinite([times, places]).all():
        raise UsageError(f'input "{path}": expected two rows or more of finite numbers, their times rising')
    first = times[0]
    return PrescribedMotion(
        float(places[0]), lambda time: np.interp(first + time, times, places), float(times[-1] - first)
    )

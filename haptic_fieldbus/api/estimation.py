"""A velocity estimator, a filter or the integration of a tachometer, on a recorded signal.

- A file of positions: the estimator returns velocity, as in the loop.
- A file of velocities: an estimator returns the filtered velocity, since the position that it takes is the sum of the
  velocities. `moving-average` is then the mean of the last readings (FIR), `low-pass` the recursive filter (IIR).
- A file of velocities and `INTEGRATION`: the position by the trapezoid, as the loop finds it with a tachometer.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.api.arguments import check_arguments
from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.documents.samples import Samples, read_samples
from haptic_fieldbus.errors import DocumentError, Fault, UsageError
from haptic_fieldbus.numerals import GIVEN_DIGITS, exactly, rounded
from haptic_fieldbus.numerics.estimators import chosen, discrete
from haptic_fieldbus.numerics.estimators.tachometer import VelocityIntegrator
from haptic_fieldbus.numerics.linear import filter_delay, noise_gain, velocity_filter

Array = NDArray[np.float64]

POSITION, VELOCITY = "position", "velocity"
INTEGRATION = "trapezoidal"
"""Name of the integration by the trapezoid, in the place of an estimator."""
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-9, 1e9
"""[s]"""
EVEN = 0.5
"""Largest deviation of a time between two rows from the mean, as a share, that an estimator takes."""

WHOLE = 0.05
"""Largest deviation from a whole number of steps, because values are written in decimals."""
FINEST = 1e-12
"""Smallest step that is looked for."""


@dataclass(frozen=True, kw_only=True)
class SignalRequest:
    """A file, and what is to be estimated from it."""

    file: Path
    estimator: str | None = None
    """NAME:key=value,… of an estimator, or `INTEGRATION`; None is that for velocities, the default for positions."""
    resolution: float | None = None
    """One step of the signal [m, rad, m/s or rad/s]; None is that of its values."""


@dataclass(frozen=True, eq=False)
class Estimated:
    """Output of an estimator for a signal, and its figures."""

    quantity: str
    """POSITION or VELOCITY."""
    values: Array
    """One for each value of the signal."""
    noise_gain: float | None
    """White noise of rms 1 in the signal is noise of this rms in the estimate, after an integration at its end; None
    for an estimator that is not linear."""
    delay: float | None
    """By how much slow changes are late [s]; None for an estimator that is not linear."""
    drift: float | None = None
    """Largest error of the last position from readings in steps of the resolution; None without an integration."""


@dataclass(frozen=True, eq=False)
class Estimation:
    """A signal and what was estimated from it."""

    signal: Samples
    estimator: str
    period: float
    """Mean time between two rows [s]."""
    unevenness: float
    """Largest deviation from the period, as a share of it."""
    resolution: float
    """One step of the signal."""
    estimate: Estimated

    def to_json(self) -> dict[str, object]:
        """Return the object that `estimate --json` prints."""
        signal, found = self.signal, self.estimate
        return {
            "time": signal.times.tolist(), "signal": signal.values.tolist(), "estimate": found.values.tolist(),
            "noise_gain": found.noise_gain, "delay_s": found.delay,
        }  # fmt: skip


def estimate_from(asked: SignalRequest) -> Estimation:
    """Return the estimate from a file; raises DocumentError for the file, UsageError for all else."""
    check_arguments("estimate_from", asked)
    signal = read_samples(asked.file, (POSITION, VELOCITY))
    period, unevenness = _period_of(asked.file, signal)
    resolution = _resolution(signal.values, asked.resolution)
    spec = asked.estimator or (INTEGRATION if signal.quantity == VELOCITY else DEFAULT_ESTIMATOR)
    if spec == INTEGRATION:
        if signal.quantity != VELOCITY:
            raise UsageError(
                f"{INTEGRATION} integrates velocities, but {asked.file} has positions: choose an estimator"
            )
        found = _integrated(signal, period, resolution)
    else:
        chosen(spec).setup(period)  # a wrong parameter is told before a fault of the times
        _check_even(asked.file, signal, period)
        found = _estimated(signal, spec, period, resolution)
    return Estimation(signal, spec, period, unevenness, resolution, found)


def _period_of(file: Path, signal: Samples) -> tuple[float, float]:
    """Return the mean time between two rows [s], and the largest deviation from it as a share."""
    steps = np.diff(signal.times)
    # Times are written in decimals; rounding removes what binary fractions add to them.
    period = float(rounded(float(signal.times[-1] - signal.times[0]) / len(steps), GIVEN_DIGITS))
    if not SHORTEST_PERIOD <= period <= LONGEST_PERIOD:
        expected = f"expected {exactly(SHORTEST_PERIOD)} to {exactly(LONGEST_PERIOD)} s"
        raise DocumentError(file, [Fault("time", f"{rounded(period)} s between two rows; {expected}")])
    return period, float(np.abs(steps / period - 1.0).max())


def _check_even(file: Path, signal: Samples, period: float) -> None:
    """Raise DocumentError for times between which a sample is missing: an estimator counts periods."""
    steps = np.diff(signal.times)
    uneven = np.nonzero(np.abs(steps / period - 1.0) > EVEN)[0]
    if len(uneven):
        row = int(uneven[0])
        message = (
            f"{rounded(float(steps[row]))} s after the row before; expected about {rounded(period)} s, because an "
            f"estimator counts periods ({INTEGRATION} accepts any times); {len(uneven)} such rows in total"
        )
        raise DocumentError(file, [Fault("time", message, int(signal.lines[row + 1]))])


def _resolution(values: Array, given: float | None) -> float:
    """Return one step of the signal: the given one, or that of its values; 0 for a constant.

    It is the least difference between two values if the others are multiples of it, else the last decimal of the file.
    """
    if given is not None:
        if not 0.0 <= given < math.inf:
            raise UsageError(f"resolution {exactly(given)}: expected a number from 0 up")
        return given
    steps = np.diff(np.unique(values))
    # Decimals that are written to twelve digits differ by rounding; such a difference is no step.
    steps = steps[steps > 1e-12 * np.abs(values).max()]
    if not len(steps):
        return 0.0
    least = float(rounded(float(steps.min()), GIVEN_DIGITS))
    multiples = np.abs(steps / least - np.round(steps / least)) < WHOLE
    return least if np.mean(multiples) > 0.5 else _last_decimal(values)


def _last_decimal(values: Array) -> float:
    """Return the power of ten of which all values are multiples, `FINEST` at least."""
    error = 1e-12 * np.abs(values).max()
    fitting = (places for places in range(12) if np.abs(values - np.round(values, places)).max() <= error)
    return next((10.0**-places for places in fitting), FINEST)


def _integrated(signal: Samples, period: float, resolution: float) -> Estimated:
    """Return the positions by the trapezoid, from 0 on.

    The weight of a reading in the last position is the mean of the times before and after it: for n even periods T/2,
    T, …, T, T/2, of norm T·√(n − ½).
    """
    integrator = VelocityIntegrator(period, resolution)
    first, *others = signal.values.tolist()
    integrator.start(first)
    places = [integrator.position]
    for time, velocity in zip((signal.times - signal.times[0]).tolist()[1:], others, strict=True):
        integrator.step(velocity, time)
        places.append(integrator.position)
    steps = np.diff(signal.times)
    gain = 0.5 * float(np.linalg.norm(np.append(steps, 0.0) + np.append(0.0, steps)))
    return Estimated(POSITION, np.array(places), gain, 0.0, integrator.drift)


def _estimated(signal: Samples, spec: str, period: float, resolution: float) -> Estimated:
    """Return the velocities, from positions or from velocities that are summed up to positions."""
    filters = signal.quantity == VELOCITY
    estimator = chosen(spec).estimator
    step = estimator.start(chosen(spec).setup(period, period * resolution if filters else resolution))
    positions, times_ns = signal.values, np.round(1e9 * (signal.times - signal.times[0]))
    if filters:  # one period before the first reading the sum is 0
        positions = np.append(0.0, period * np.cumsum(signal.values))
        times_ns = np.append(-1e9 * period, times_ns)
    rows = zip(positions.tolist(), times_ns.tolist(), strict=True)
    values = [step(x, time_ns) if estimator.timed else step(x) for x, time_ns in rows]
    return Estimated(VELOCITY, np.array(values[int(filters) :]), *_figures(spec, period, filters))


def _figures(spec: str, period: float, filters: bool) -> tuple[float | None, float | None]:
    """Return noise gain and delay [s] of an estimator, or of the filter in it; None for one that is not linear."""
    system = discrete(spec, period)
    if system is None:
        return None, None
    through = velocity_filter(system, period)
    if filters:
        return noise_gain(through), filter_delay(through, period)
    return noise_gain(system), filter_delay(through, period) + 0.5 * period

"""Fit of the shaft model to records, with intervals, and with the reason where a value cannot be separated.

Theory. The values minimise the sum of the squared prediction errors of all samples, by the method of Levenberg and
Marquardt within bounds: inertia, lag and delay are positive, damping and friction at least 0, and the delay plus the
lag, which is what a hand feels, is a parameter of its own. Derivatives are differences of whole predictions.

The covariance is (HᵀH)⁻¹·S·(HᵀH)⁻¹ with the sensitivities H and S = Σ w_l·Γ_l, the covariances Γ of the gradient over
lags up to `MEMORY` with the weights of Bartlett (Newey and West, Econometrica 55, 1987, 703). So a residual that is no
white noise, as of an encoder at low speed or of cogging, widens the intervals. It is never taken below that of white
noise, nor below the noise of an encoder that rounds.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from haptic_fieldbus.identification.shaft import ShaftModel, predicted_positions
from haptic_fieldbus.numerals import exactly, in_unit, rounded
from haptic_fieldbus.numerics.linear import Matrix

FEWEST_SAMPLES = 200
MEMORY = 0.15
"""Longest lag of the residual that widens an interval [s]."""
WIDTH = 2.4
"""Half of an interval in standard deviations: 95 % where the covariance itself is uncertain by a fifth."""
MOST_STEPS = 60
SHORTEST_LAG, LONGEST_LAG = 1e-5, 0.02
"""Range of the lag of a torque loop [s]."""
LONGEST_DELAY = 6.0
"""Longest delay plus lag, in periods, beyond the lag."""
SMALL = 1e-4
"""Step of a difference, of the scale of its value."""
NAMES = ("inertia", "viscous_damping", "coulomb_friction", "delay_and_lag", "torque_lag", "load")
UNITS = {
    "inertia": "kg·m²",
    "viscous_damping": "N·m·s/rad",
    "coulomb_friction": "N·m",
    "delay_and_lag": "s",
    "delay": "s",
    "torque_lag": "s",
    "load": "N·m",
}
SEPARATED = {"inertia": 0.1, "viscous_damping": 0.5, "coulomb_friction": 0.5, "delay": 0.5, "torque_lag": 0.5}
"""Half width of an interval, of its value, from which on the value is called not separated."""
DELAY_KNOWN, DELAY_SHARE = 1e-4, 0.1
"""The delay plus lag is known to this time [s], or to this share of it."""


@dataclass(frozen=True)
class ShaftRecord:
    """Samples of one experiment at the motor shaft, at multiples of the period."""

    period: float
    """[s]"""
    positions: tuple[float, ...]
    """[rad]"""
    torques: tuple[float, ...]
    """Set-point that was computed from each sample [N·m]."""
    resolution: float
    """One encoder count [rad]."""

    @property
    def top_speed(self) -> float:
        """Return the largest speed, of means over 10 ms or a period [rad/s]."""
        width = max(1, round(0.01 / self.period))
        ways = np.subtract(self.positions[width:], self.positions[:-width])
        return float(np.abs(ways).max(initial=0.0)) / (width * self.period)


@dataclass(frozen=True)
class Estimate:
    """One value with its interval of 95 %."""

    value: float
    low: float
    high: float
    unit: str
    reason: str = ""
    """Why the value cannot be separated; empty if it can."""

    @property
    def half_width(self) -> float:
        """Return half of the width of the interval."""
        return 0.5 * (self.high - self.low)


@dataclass(frozen=True)
class ShaftFit:
    """The fitted shaft, and what the fit rests on."""

    model: ShaftModel
    values: Mapping[str, Estimate]
    residual: float
    """Root mean square of the prediction error [encoder counts]."""
    top_speed: float
    """[rad/s]"""
    samples: int
    warnings: tuple[str, ...] = field(default=())


def fit_shaft(records: Sequence[ShaftRecord], guess: ShaftModel | None = None) -> ShaftFit:
    """Return the fit to all records together; raises ValueError if there are too few samples or nothing moved."""
    samples = sum(len(each.positions) for each in records)
    if samples < FEWEST_SAMPLES:
        raise ValueError(f"{samples} samples; at least {FEWEST_SAMPLES} are needed")
    if max(np.ptp(each.positions) / each.resolution for each in records) < 10.0:
        raise ValueError("the shaft moved by less than 10 counts; more torque is needed")
    problem = _Problem(records, guess or first_guess(records))
    vector = problem.solved()
    return problem.told(vector)


# A first guess, by linear least squares of second differences.


def first_guess(records: Sequence[ShaftRecord]) -> ShaftModel:
    """Return a first model by linear least squares.

    The second difference of the position over 2·w samples is the mean of the acceleration under a triangle of that
    width, so it is compared with the mean of the torque under the same triangle, for several delays.
    """
    period = records[0].period
    width = max(2, round(0.01 / period))
    found = []
    for delay in np.arange(0.0, LONGEST_DELAY + 0.1, 0.5):
        rows, force = zip(*(_weak_form(each, width, float(delay)) for each in records), strict=True)
        found.append((*_non_negative(np.vstack(rows), np.concatenate(force)), float(delay)))
    _, values, delay = min(found, key=lambda each: each[0])
    inertia, damping, coulomb, load = values
    lag = max(0.2 * delay * period, 2e-4)
    return ShaftModel(inertia, damping, coulomb, max(delay * period - lag, 0.0), lag, load)


def _weak_form(record: ShaftRecord, width: int, delay: float) -> tuple[Matrix, Matrix]:
    """Return the rows (acceleration, speed, direction, −1) and the torque on them."""
    y, w, period = np.array(record.positions), width, record.period
    bend = (y[2 * w :] - 2.0 * y[w:-w] + y[: -2 * w]) / (w * period) ** 2
    speed = (y[2 * w :] - y[: -2 * w]) / (2.0 * w * period)
    triangle = np.concatenate([np.arange(1, w + 1), np.arange(w - 1, 0, -1)]) / w**2
    # The set-point acts from its sample on, so its middle is half a period later.
    times = np.arange(len(y)) - 0.5 - delay
    acting = np.interp(times, np.arange(len(y)), record.torques)
    force = np.convolve(acting, triangle, "valid")[1 : len(bend) + 1]
    moving = np.abs(speed) > 2.0 * record.resolution / (2.0 * w * period)
    bend, speed, force = bend[: len(force)][moving], speed[: len(force)][moving], force[moving]
    return np.column_stack([bend, speed, np.sign(speed), -np.ones(len(bend))]), force


def _non_negative(rows: Matrix, force: Matrix) -> tuple[float, tuple[float, float, float, float]]:
    """Return (residual, values) of the least squares with an inertia above 0, and damping and friction of 0 or more."""
    columns = [0, 1, 2, 3]
    while True:
        solved, *_ = np.linalg.lstsq(rows[:, columns], force, rcond=None)
        below = [column for column, value in zip(columns, solved, strict=True) if column in (1, 2) and value < 0.0]
        if not below:
            break
        columns.remove(below[0])
    values = np.zeros(4)
    values[columns] = solved
    left = float(np.sum((rows @ values - force) ** 2))
    scale = float(np.std(force)) / max(float(np.std(rows[:, 0])), 1e-12)
    inertia = float(values[0]) if values[0] > 0.0 else scale
    return left, (max(inertia, 1e-3 * scale, 1e-12), float(values[1]), float(values[2]), float(values[3]))


# The problem in scaled values.


class _Problem:
    """Sum of squares over all records; a vector holds `NAMES`, then the first speed of each record, all scaled."""

    def __init__(self, records: Sequence[ShaftRecord], guess: ShaftModel) -> None:
        self.records, self.period = records, records[0].period
        torque = float(np.sqrt(np.mean(np.concatenate([each.torques for each in records]) ** 2))) or 1.0
        speed = max(each.top_speed for each in records) or 1.0
        self.scales = np.array(
            [guess.inertia, torque / speed, torque, self.period, self.period, torque, *[speed] * len(records)]
        )
        both = guess.delay + guess.lag
        values = [guess.inertia, guess.damping, guess.coulomb, both, guess.lag, guess.load]
        firsts = [self._first_speed(each) for each in records]
        self.start = np.array([*values, *firsts]) / self.scales
        low = np.full(len(self.start), -np.inf)
        high = np.full(len(self.start), np.inf)
        low[0], high[0] = 1e-3, 1e3
        low[1] = low[2] = 0.0
        low[4], high[4] = np.array([SHORTEST_LAG, LONGEST_LAG]) / self.period
        low[3], high[3] = low[4], high[4] + LONGEST_DELAY
        self.low, self.high = low, high

    def _first_speed(self, record: ShaftRecord) -> float:
        width = max(2, round(0.01 / record.period))
        return (record.positions[width] - record.positions[0]) / (width * record.period)

    def model(self, vector: Matrix) -> ShaftModel:
        inertia, damping, coulomb, both, lag, load = (vector * self.scales)[: len(NAMES)].tolist()
        return ShaftModel(inertia, damping, coulomb, max(both - lag, 0.0), lag, load)

    def residuals(self, vector: Matrix) -> Matrix:
        """Return the prediction errors of all records [counts], shape (n,)."""
        model, speeds = self.model(vector), (vector * self.scales)[len(NAMES) :]
        parts = [
            (
                np.array(each.positions)
                - predicted_positions(model, each.positions, each.torques, each.period, float(speed))
            )
            / each.resolution
            for each, speed in zip(self.records, speeds, strict=True)
        ]
        return np.concatenate(parts)

    def within(self, vector: Matrix) -> Matrix:
        """Return the vector inside its bounds; the lag is at most the delay and the lag together."""
        inside = np.clip(vector, self.low, self.high)
        inside[4] = min(inside[4], inside[3])
        return inside

    def sensitivities(self, vector: Matrix, residuals: Matrix) -> Matrix:
        """Return the derivative of the residuals, shape (n, m)."""
        columns = []
        for place in range(len(vector)):
            step = SMALL if place != len(NAMES) - 1 else SMALL * 0.1
            if vector[place] + step > self.high[place] or (place == 4 and vector[4] + step > vector[3]):
                step = -step
            moved = vector.copy()
            moved[place] += step
            columns.append((self.residuals(moved) - residuals) / step)
        return np.column_stack(columns)

    def solved(self) -> Matrix:
        """Return the vector of the least sum of squares."""
        vector = self.within(self.start)
        residuals = self.residuals(vector)
        cost, damping = float(residuals @ residuals), 1e-3
        for _ in range(MOST_STEPS):
            slopes = self.sensitivities(vector, residuals)
            gradient, curvature = slopes.T @ residuals, slopes.T @ slopes
            while damping < 1e9:
                moved = self.within(vector - self._step(vector, gradient, curvature, damping))
                after = self.residuals(moved)
                if (new := float(after @ after)) < cost:
                    break
                damping *= 5.0
            else:
                return vector
            gained, cost = cost - new, new
            vector, residuals, damping = moved, after, max(damping * 0.2, 1e-9)
            if gained < 1e-7 * cost:
                return vector
        return vector

    def _step(self, vector: Matrix, gradient: Matrix, curvature: Matrix, damping: float) -> Matrix:
        """Return the step of the values that no bound holds."""
        held = ((vector <= self.low) & (gradient > 0.0)) | ((vector >= self.high) & (gradient < 0.0))
        free = np.flatnonzero(~held)
        inner = curvature[np.ix_(free, free)]
        step = np.zeros(len(vector))
        weight = np.diag(np.maximum(np.diag(inner), 1e-12 * float(np.trace(inner)) + 1e-300))
        step[free] = np.linalg.lstsq(inner + damping * weight, gradient[free], rcond=None)[0]
        # An inertia changes by at most a factor of two in one step.
        step[0] = max(-vector[0], min(0.5 * vector[0], step[0]))
        return step

    # What the solution says.

    def told(self, vector: Matrix) -> ShaftFit:
        """Return the fit with its intervals and reasons."""
        residuals = self.residuals(vector)
        covariance = self._covariance(self.sensitivities(vector, residuals), residuals)
        model, top = self.model(vector), max(each.top_speed for each in self.records)
        estimates = {}
        for place, name in enumerate(NAMES):
            value = float(vector[place] * self.scales[place])
            spread = float(WIDTH * math.sqrt(covariance[place, place]) * self.scales[place])
            lowest = -math.inf if name == "load" else 0.0
            estimates[name] = Estimate(value, max(value - spread, lowest), value + spread, UNITS[name])
        variance = float(covariance[3, 3] + covariance[4, 4] - 2.0 * covariance[3, 4])
        spread = WIDTH * self.period * math.sqrt(max(variance, 0.0))
        estimates["delay"] = Estimate(model.delay, max(model.delay - spread, 0.0), model.delay + spread, "s")
        rms = float(np.sqrt(np.mean(residuals**2)))
        told = {name: replace(each, reason=reason_of(name, estimates, top)) for name, each in estimates.items()}
        return ShaftFit(model, told, rms, top, len(residuals), tuple(self._warnings(rms)))

    def _covariance(self, slopes: Matrix, residuals: Matrix) -> Matrix:
        """Return the covariance of the scaled values, shape (m, m)."""
        inverse = np.linalg.pinv(slopes.T @ slopes, rcond=1e-14)
        noise = max(float(residuals @ residuals) / max(len(residuals) - slopes.shape[1], 1), 1.0 / 12.0)
        white = noise * inverse
        first, robust = 0, np.zeros_like(white)
        for record in self.records:
            rows = slice(first, first + len(record.positions))
            first += len(record.positions)
            robust += _long_run(slopes[rows] * residuals[rows, np.newaxis], round(MEMORY / record.period))
        coloured = inverse @ robust @ inverse
        # The correlations of the wider one; each variance is at least that of white noise.
        ratio = np.sqrt(np.maximum(np.diag(coloured), np.diag(white)) / np.maximum(np.diag(white), 1e-300))
        widened: Matrix = white * np.outer(ratio, ratio)
        return widened

    def _warnings(self, rms: float) -> Iterator[str]:
        """Yield what the fit cannot explain."""
        if rms > 3.0:
            yield (
                f"the model leaves {rounded(rms)} counts unexplained: cogging, play, a weight on a lever or an elastic "
                "coupling are not in it; the intervals are wider by this"
            )


def _long_run(gradient: Matrix, most: int) -> Matrix:
    """Return the covariance of the sum of the rows, with the weights of Bartlett up to the lag `most`."""
    total: Matrix = gradient.T @ gradient
    for lag in range(1, min(most, len(gradient) - 1) + 1):
        beside = gradient[lag:].T @ gradient[:-lag]
        total = total + (1.0 - lag / (most + 1.0)) * (beside + beside.T)
    return total


def reason_of(name: str, estimates: Mapping[str, Estimate], top: float) -> str:
    """Return why a value cannot be separated from the others; empty if it can. `top` is the top speed [rad/s]."""
    width, value = estimates[name].half_width, estimates[name].value
    if name == "load":
        return ""
    if name == "delay_and_lag":
        known = max(DELAY_KNOWN, DELAY_SHARE * value)
        return "" if width <= known else "the fast part of the motion was too small beside one count of the encoder"
    if width <= SEPARATED[name] * value:
        return ""
    if name == "viscous_damping":
        friction, at_top = estimates["coulomb_friction"].value, f"at the top speed of {in_unit(top, 'rad/s')}"
        if value * top < friction:
            share = rounded(100.0 * value * top / friction)
            return f"friction hides it: {at_top} it is {share} % of the Coulomb friction"
        return f"its torque {at_top} is too small beside the torque that the inertia takes"
    if name in ("delay", "torque_lag"):
        both = exactly(round(1e3 * estimates["delay_and_lag"].value, 3))
        return f"delay and lag act alike at the frequencies of the motion; together they are {both} ms"
    if name == "coulomb_friction":
        return "it is small beside the torques of the experiment"
    return "the motion was too small beside one count of the encoder"

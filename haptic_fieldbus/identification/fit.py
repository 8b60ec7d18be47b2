"""Fit of the shaft model to records, with intervals, and with the reason where a value cannot be separated.

Theory. The values minimise the sum of the squared prediction errors of all samples, by the method of Levenberg and
Marquardt within bounds: inertia and lag are positive, damping, friction and delay at least 0. Derivatives are
differences of whole predictions. A solution at a bound of delay or lag is tried again from another share of the lag.
Of delay and lag the sum is best known, and is what a hand feels; it has an interval of its own.

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

FEWEST_SAMPLES, FEWEST_ROWS = 200, 30
GUESS_WIDTHS = (0.01, 0.03, 0.06)
"""Half widths of the triangles of the first guess [s]."""
ENCODER_NOISE = 0.4
"""Largest prediction error of a shaft that the model explains, a little above that of rounding, 1/√12 [counts]."""
SETTLED = 0.6
"""Time after which the first speed of a record is forgotten [s]."""
MEMORY = 0.15
"""Longest lag of the residual that widens an interval [s]."""
WIDTH = 2.4
"""Half of an interval in standard deviations: 95 % where the covariance itself is uncertain by a fifth."""
LEAST_SHARE = 1e-3
"""Half of an interval is at least this share of its value: set-points act a little earlier or later in each period."""
MOST_STEPS = 60
SHORTEST_LAG, LONGEST_LAG = 1e-5, 0.02
"""Range of the lag of a torque loop [s]."""
LONGEST_DELAY = 6.0
"""Longest delay plus lag, in periods, beyond the lag."""
LAG_SHARES = (0.3, 0.7)
"""Shares of the lag in the delay and the lag together, from which a solution at a bound is tried again."""
SMALL = 1e-4
"""Step of a difference, of the scale of its value."""
NAMES = ("inertia", "viscous_damping", "coulomb_friction", "delay", "torque_lag", "load")
DELAY, LAG = NAMES.index("delay"), NAMES.index("torque_lag")
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
    width, so it is compared with the mean of the torque under the same triangle, for several widths and delays.
    """
    period = records[0].period
    found = []
    for width in dict.fromkeys(max(2, round(seconds / period)) for seconds in GUESS_WIDTHS):
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
    """Return (share of the torque that is left, values) of the least squares.

    The inertia is above 0, damping and friction are 0 or more. A share of infinity: the rows tell nothing.
    """
    columns = [0, 1, 2, 3]
    while True:
        solved, *_ = np.linalg.lstsq(rows[:, columns], force, rcond=None)
        below = [column for column, value in zip(columns, solved, strict=True) if column in (1, 2) and value < 0.0]
        if not below:
            break
        columns.remove(below[0])
    values = np.zeros(4)
    values[columns] = solved
    known = len(force) >= FEWEST_ROWS and values[0] > 0.0
    left = float(np.sum((rows @ values - force) ** 2) / max(np.sum(force**2), 1e-300)) if known else math.inf
    scale = float(np.std(force)) / max(float(np.std(rows[:, 0])), 1e-12)
    inertia = float(values[0]) if values[0] > 0.0 else scale
    return left, (max(inertia, 1e-3 * scale, 1e-12), float(values[1]), float(values[2]), float(values[3]))


def prediction_errors(model: ShaftModel, record: ShaftRecord) -> Matrix:
    """Return the prediction errors of a record [counts], without those of its beginning, shape (n,).

    The first speed is not known well, and no parameter: near rest, a shaft that sticks does not depend on it smoothly.
    """
    first, width = 0.0, max(6, round(0.02 / record.period))
    begin = np.array(record.positions[:width])
    if np.ptp(begin) > 2.5 * record.resolution:
        first = float(np.polyfit(record.period * np.arange(width), begin, 2)[1])
    found = predicted_positions(model, record.positions, record.torques, record.period, first)
    errors: Matrix = (np.array(record.positions) - found)[unsettled_samples(record) :] / record.resolution
    return errors


def unsettled_samples(record: ShaftRecord) -> int:
    """Return the number of samples until the first speed is forgotten."""
    return min(round(SETTLED / record.period), len(record.positions) // 4)


# The problem in scaled values.


class _Problem:
    """Sum of squares over all records; a vector holds the scaled values of `NAMES`."""

    def __init__(self, records: Sequence[ShaftRecord], guess: ShaftModel) -> None:
        self.records, self.period = records, records[0].period
        torque = float(np.sqrt(np.mean(np.concatenate([each.torques for each in records]) ** 2))) or 1.0
        speed = max(each.top_speed for each in records) or 1.0
        self.scales = np.array([guess.inertia, torque / speed, torque, self.period, self.period, torque])
        values = [guess.inertia, guess.damping, guess.coulomb, guess.delay, guess.lag, guess.load]
        self.start = np.array(values) / self.scales
        low = np.full(len(self.start), -np.inf)
        high = np.full(len(self.start), np.inf)
        low[0], high[0] = 1e-3, 1e3
        low[1] = low[2] = low[DELAY] = 0.0
        high[DELAY] = LONGEST_DELAY
        low[LAG], high[LAG] = np.array([SHORTEST_LAG, LONGEST_LAG]) / self.period
        self.low, self.high = low, high

    def model(self, vector: Matrix) -> ShaftModel:
        return ShaftModel(*(vector * self.scales).tolist())

    def residuals(self, vector: Matrix) -> Matrix:
        """Return the prediction errors of all records [counts], shape (n,)."""
        model = self.model(vector)
        return np.concatenate([prediction_errors(model, each) for each in self.records])

    def sensitivities(self, vector: Matrix, residuals: Matrix) -> Matrix:
        """Return the derivative of the residuals, shape (n, m)."""
        columns = []
        for place in range(len(vector)):
            step = SMALL
            if vector[place] + step > self.high[place]:
                step = -step
            moved = vector.copy()
            moved[place] += step
            columns.append((self.residuals(moved) - residuals) / step)
        return np.column_stack(columns)

    def solved(self) -> Matrix:
        """Return the vector of the least sum of squares."""
        cost, vector = self._descended(self.start)
        for share in LAG_SHARES:
            inner = self.low[DELAY] < vector[DELAY] < self.high[DELAY] and self.low[LAG] < vector[LAG] < self.high[LAG]
            if inner:
                break
            again, both = vector.copy(), vector[DELAY] + vector[LAG]
            again[DELAY], again[LAG] = (1.0 - share) * both, share * both
            cost, vector = min((cost, vector), self._descended(again), key=lambda each: each[0])
        return vector

    def _descended(self, start: Matrix) -> tuple[float, Matrix]:
        """Return the sum of squares at the end of the way down from a start, and the vector there."""
        vector = np.clip(start, self.low, self.high)
        residuals = self.residuals(vector)
        cost, damping = float(residuals @ residuals), 1e-3
        for _ in range(MOST_STEPS):
            slopes = self.sensitivities(vector, residuals)
            gradient, curvature = slopes.T @ residuals, slopes.T @ slopes
            while damping < 1e9:
                step = self._step(vector, gradient, curvature, damping)
                moved = np.clip(vector - step, self.low, self.high)
                after = self.residuals(moved)
                if (new := float(after @ after)) < cost:
                    break
                damping *= 5.0
            else:
                return cost, vector
            gained, cost = cost - new, new
            vector, residuals, damping = moved, after, max(damping * 0.2, 1e-9)
            if gained < 1e-7 * cost:
                break
        return cost, vector

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
        spreads = self._spreads(self.sensitivities(vector, residuals), residuals)
        model, top = self.model(vector), max(each.top_speed for each in self.records)
        found = dict(zip(NAMES, (vector * self.scales).tolist(), strict=True))
        found["delay_and_lag"] = model.delay + model.lag
        rms = float(np.sqrt(np.mean(residuals**2)))
        # Above the noise of an encoder, a residual is a torque that the model lacks, and it may take sides.
        unexplained = 1.0 + min(1.0, max(0.0, rms / ENCODER_NOISE - 1.0))
        estimates = {}
        for name, spread in zip((*NAMES, "delay_and_lag"), spreads, strict=True):
            value, lowest = found[name], -math.inf if name == "load" else 0.0
            half = max(WIDTH * unexplained * spread, LEAST_SHARE * abs(value))
            estimates[name] = Estimate(value, max(value - half, lowest), value + half, UNITS[name])
        told = {name: replace(each, reason=reason_of(name, estimates, top)) for name, each in estimates.items()}
        return ShaftFit(model, told, rms, top, len(residuals), tuple(self._warnings(rms)))

    def _spreads(self, slopes: Matrix, residuals: Matrix) -> list[float]:
        """Return the standard deviation of each of `NAMES`, and then of the delay and the lag together."""
        inverse = np.linalg.pinv(slopes.T @ slopes, rcond=1e-14)
        noise = max(float(residuals @ residuals) / max(len(residuals) - slopes.shape[1], 1), 1.0 / 12.0)
        first, coloured = 0, np.zeros_like(inverse)
        for record in self.records:
            rows = slice(first, first + len(record.positions) - unsettled_samples(record))
            first = rows.stop
            coloured += _long_run(slopes[rows] * residuals[rows, np.newaxis], round(MEMORY / record.period))
        forms = np.vstack([np.eye(len(NAMES)), np.zeros(len(NAMES))])
        forms[-1, [DELAY, LAG]] = 1.0
        forms = forms * self.scales
        white = np.einsum("ij,jk,ik->i", forms, noise * inverse, forms)
        wide = np.einsum("ij,jk,ik->i", forms, inverse @ coloured @ inverse, forms)
        spreads: list[float] = np.sqrt(np.maximum(np.maximum(white, wide), 0.0)).tolist()
        return spreads

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

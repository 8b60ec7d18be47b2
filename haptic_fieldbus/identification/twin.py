"""Fit of a bench to an ordinary run, in which a hand of stated model, or no hand, moves the handle.

Theory. The shaft of `shaft` is held by a hand: a mass m, which a spring k and a damper d join to the handle, with the
force f on it. With the stretch δ of the spring and the speed ν of the mass,

    J·ω' = τ + g − c·sign ω − b·ω + k·δ + d·(ν − ω)        T·τ' = s·u − τ
    δ' = ν − ω                                             m·ν' = f − k·δ − d·(ν − ω)

with s, torque given over torque asked. The recorded position is the angle times true counts over stated counts. Both
scales are 1 unless the record contradicts it. Only a hand of stated force and stiffness tells them: without a hand, a
record is the same for all benches with the same ratios of inertia, damping, friction and torque.

The record is cut into pieces that begin in motion, each with a first angle and speed of its own (multiple shooting:
Bock 1981, doi:10.1007/978-3-642-68220-9_8). All pieces and all derivatives are simulated side by side. The linear
motion is exact; a reversal inside a span of 1 ms is found by a straight line. First angles and speeds are eliminated
from each step of Levenberg and Marquardt (variable projection: Golub and Pereyra 1973, doi:10.1137/0710036).

The covariance takes pieces as independent, and samples of one piece as correlated in an unknown way (Liang and Zeger
1986, doi:10.1093/biomet/73.1.13). What the profile tells about delay and lag is a weak observation beside the record.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.identification.fit import ENCODER_NOISE, LONGEST_DELAY, LONGEST_LAG, SHORTEST_LAG, UNITS, WIDTH
from haptic_fieldbus.identification.fit import Estimate, ShaftModel, reason_of
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.numerics.linear import Matrix, expm

NAMES = ("inertia", "viscous_damping", "coulomb_friction", "delay_and_lag", "torque_lag", "load", "hand_start",
         "zero", "torque_scale", "count_scale")  # fmt: skip
INERTIA, DAMPING, FRICTION, BOTH, LAG, LOAD, START, ZERO, TORQUE, COUNTS = range(len(NAMES))
TOLD = (*NAMES[: LOAD + 1], "torque_scale", "count_scale")
"""Values that a fit tells; the start of the hand and the zero of the encoder within a count serve the fit alone."""
PIECE, FEWEST_SAMPLES, FEWEST_PIECES, MOST_PIECES = 0.5, 24, 4, 160
"""Length of a piece [s], its fewest samples, and numbers of pieces."""
MOVING_TIME, MOVING_COUNTS = 0.01, 4.0
"""Half of the time in which a shaft that moves passes at least these counts [s]."""
LONGEST_SPAN = 1e-3
"""[s]"""
HISTORY = 64
"""Set-points before a piece that still act in it."""
CHECKED = 5
"""Each piece of this number is predicted and not used in the fit."""
MOST_STEPS, LEAST_GAIN, SMALL = 40, 1e-4, 1e-3
"""Steps of the fit, their least relative gain, and the step of a derivative."""
FIRST_SHARES = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Shares of the stated inertia from which a fit may begin."""
COUNT_SCALES = (1.0, 0.25, 4.0)
SAME_SCALE = 0.02
"""Share within which a scale is one of round numbers."""
LEAST_SHARE, LEAST_TIME = 0.01, 1e-5
"""Half of an interval is at least this share of its value, or this time [s]."""


@dataclass(frozen=True)
class HoldingHand:
    """A hand as it acts on the motor shaft: kg·m², N·m·s/rad, N·m/rad, N·m; times from its start [s]."""

    inertia: float
    damping: float
    stiffness: float
    pieces: tuple[tuple[float, float, float], ...] = ()
    """Start of each piece of its force, with force and slope there."""
    angular_frequency: float = 0.0
    """Of a sine [rad/s]; 0: ramps and constants."""
    release: float = math.inf

    def impulse(self, times: Matrix) -> Matrix:
        """Return the integral of the force up to each time [N·m·s]."""
        omega, total = self.angular_frequency, np.zeros_like(times)
        ends = [*(start for start, _, _ in self.pieces[1:]), math.inf]
        for (start, force, slope), end in zip(self.pieces, ends, strict=True):
            t = np.clip(times - start, 0.0, end - start)
            if omega:
                total += force / omega * np.sin(omega * t) + slope / omega**2 * (1.0 - np.cos(omega * t))
            else:
                total += force * t + 0.5 * slope * t * t
        return total


@dataclass(frozen=True, eq=False)
class RunRecord:
    """Samples of an ordinary run at the motor shaft, at multiples of the period."""

    period: float
    """[s]"""
    positions: Matrix
    """[rad]"""
    torques: Matrix
    """Set-point that was computed from each sample [N·m]."""
    resolution: float
    """One encoder count [rad]."""
    usable: NDArray[np.bool_]
    """Whether the motion up to a sample is that of shaft and hand alone."""
    hand: HoldingHand | None = None
    """None: nobody holds the handle in the usable samples."""
    enabled: int = 0
    """Sample in whose period the hand starts."""


@dataclass(frozen=True)
class RunFit:
    """The bench that explains a run best."""

    values: Mapping[str, Estimate]
    """Values with intervals of 95 %; a value with a reason is not told by the record."""
    residual: float
    """Root mean square of the error [counts]."""
    predicted: float
    """The same in the pieces that were not used [counts]."""
    top_speed: float
    """[rad/s]"""
    seconds: float
    """Length of all pieces [s]."""
    warnings: tuple[str, ...] = field(default=())


def fit_run(record: RunRecord, stated: ShaftModel) -> RunFit:
    """Return the bench that explains a run best; delay and lag of `stated` are those of the profile.

    Raises ValueError when the handle moves too little.
    """
    pieces = _Pieces.of(record)
    if len(pieces.first) < FEWEST_PIECES:
        raise ValueError(f"the handle moves for less than {rounded(FEWEST_PIECES * pieces.length * record.period)} s")
    rest = np.arange(len(pieces.first)) % CHECKED == CHECKED - 1
    used, unused = pieces.part(~rest), pieces.part(rest)
    values = np.array([stated.inertia, stated.damping, stated.coulomb, stated.delay + stated.lag, stated.lag,
                       0.0, 0.4 * record.period, 0.0, 1.0, 1.0])  # fmt: skip
    free = [*range(START if record.hand is None else TORQUE)]
    fit = _Fit(used, values, free).solved()
    if record.hand is not None and fit.rms > ENCODER_NOISE:
        fit = _with_scales(fit, values)
    check = _Fit(unused, fit.values, []).solved().rms if rest.any() else math.nan
    return fit.told(check)


def _with_scales(fit: "_Fit", values: Matrix) -> "_Fit":
    """Return the best fit with scales of torque and counts; one within `SAME_SCALE` of a round number is that number."""
    found, scaled = [fit], [*fit.free, TORQUE, COUNTS]
    for scale in COUNT_SCALES:
        start = values.copy()
        start[COUNTS] = scale
        found.append(_Fit(fit.pieces, start, scaled).solved())
    best = min(found, key=lambda each: each.cost)
    start, free = best.values.copy(), list(best.free)
    for name, rounds in ((TORQUE, (1.0,)), (COUNTS, COUNT_SCALES)):
        near = [each for each in rounds if abs(start[name] / each - 1.0) < SAME_SCALE]
        if near and name in free:
            start[name] = near[0]
            free.remove(name)
    again = _Fit(fit.pieces, start, free, best.expected).solved()
    return again if again.rms < max(1.1 * best.rms, ENCODER_NOISE) else best


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces of a record, simulated side by side."""

    record: RunRecord
    first: NDArray[np.int64]
    """First sample of each piece, shape (s,)."""
    length: int
    led: Matrix
    """Place and speed of the hand in each sample, led by the recorded positions, by a position of 1 rad and by its force,
    shape (n, 2, 3)."""

    @classmethod
    def of(cls, record: RunRecord) -> "_Pieces":
        """Return the pieces of a record that begin in motion."""
        length, y = max(FEWEST_SAMPLES, round(PIECE / record.period)), record.positions
        width = max(2, round(MOVING_TIME / record.period))
        moving = np.zeros(len(y), bool)
        moving[width:-width] = np.abs(y[2 * width :] - y[: -2 * width]) >= MOVING_COUNTS * record.resolution
        unusable = np.concatenate([[0], np.cumsum(~record.usable)])
        first, at, last = list[int](), max(width, record.enabled + 1, HISTORY + round(LONGEST_DELAY) + 2), len(y) - length
        while at <= last:
            free = unusable[at + length] == unusable[at - width]
            if moving[at] and free:
                first.append(at)
            at += length if moving[at] and free else max(1, width // 2)
        spread = np.unique(np.linspace(0, len(first) - 1, min(len(first), MOST_PIECES)).astype(int)) if first else []
        return cls(record, np.array(first, np.int64)[spread], length, _led(record))

    def part(self, chosen: NDArray[np.bool_]) -> "_Pieces":
        return replace(self, first=self.first[chosen])

    @property
    def seen(self) -> Matrix:
        """Recorded angles, shape (s, l)."""
        found: Matrix = self.record.positions[self.first[:, np.newaxis] + np.arange(self.length)]
        return found

    def begun(self, scale: float) -> tuple[Matrix, Matrix]:
        """Return first angles and speeds by a parabola through the samples around."""
        width = max(3, round(MOVING_TIME / self.record.period))
        around = np.arange(-width, width + 1)
        y = self.record.positions[self.first[:, np.newaxis] + around] / scale
        angle, speed, _ = np.polynomial.polynomial.polyfit(self.record.period * around, y.T, 2)
        return angle, speed

    def predicted(self, values: Matrix, angle: Matrix, speed: Matrix) -> Matrix:
        """Return the predicted records, shape (p, s, l), of values (p, 9) from first angles and speeds (p, s)."""
        z, forces, hand = self._start(values, angle, speed)
        spans, side, u = self._spans(values, hand), np.sign(speed), self.record.torques
        load, coulomb = values[:, LOAD, np.newaxis], values[:, FRICTION, np.newaxis]
        out = np.empty((*angle.shape, self.length))
        for step in range(self.length):
            out[:, :, step], at = z[:, 0], self.first + step
            z[:, 6] = forces[:, at]
            for slip, stick, seconds, ago in spans:
                z[:, 5], z[:, 7] = u[at - ago], load - coulomb * side
                moved, stuck = slip @ z, side == 0.0
                if stuck.any():
                    moved = np.where(stuck[:, np.newaxis], stick @ z, moved)
                pull = moved[:, 2] + hand.stiffness * moved[:, 3] + hand.damping * moved[:, 4] + load
                side = np.where(stuck & (np.abs(pull) > coulomb), np.sign(pull), side)
                if (back := ~stuck & (moved[:, 1] * side < 0.0)).any():
                    side = _turned(z, moved, back, side, pull, coulomb, seconds, values[:, INERTIA, np.newaxis])
                z[:, :5] = moved
        return out * values[:, COUNTS, np.newaxis, np.newaxis] + values[:, ZERO, np.newaxis, np.newaxis]

    def _start(self, values: Matrix, angle: Matrix, speed: Matrix) -> tuple[Matrix, Matrix, HoldingHand]:
        """Return the states at the begin of the pieces, the forces of the hand, (p, n), and the hand."""
        period, u, first, n = self.record.period, self.record.torques, self.first, len(self.record.positions)
        whole, part = _delays(values, period)
        left = np.exp(-period / values[:, LAG])[:, np.newaxis]
        weights = left ** np.arange(HISTORY)
        before = weights @ u[first - whole - 2 - np.arange(HISTORY)[:, np.newaxis]] / weights.sum(1, keepdims=True)
        last, waned = u[first - whole - 1], np.exp((part - period) / values[:, LAG])[:, np.newaxis]
        z = np.zeros((len(values), 8, len(first)))
        z[:, 0], z[:, 1] = angle, speed
        z[:, 2] = values[:, TORQUE, np.newaxis] * (last + (before - last) * waned)
        if self.record.hand is None:
            return z, np.zeros((len(values), n)), HoldingHand(1.0, 0.0, 0.0)
        starts = {start: _mean_force(self.record, start) for start in values[:, START]}
        for row, (start, zero, scale) in enumerate(values[:, [START, ZERO, COUNTS]]):
            for state, (places, one, pushed) in enumerate(np.moveaxis(self.led, 0, -1)):
                late = np.interp(first - start / period, np.arange(n), pushed)
                z[row, 3 + state] = (places[first] - zero * one[first]) / scale + late
        z[:, 3] -= angle
        return z, np.stack([starts[start] for start in values[:, START]]), self.record.hand

    def _spans(self, values: Matrix, hand: HoldingHand) -> list[tuple[Matrix, Matrix, Matrix, int]]:
        """Return the spans of a period: slipping and sticking, (p, 5, 8), seconds (p, 1), and the age of the set-point."""
        k, d, m = hand.stiffness, hand.damping, hand.inertia
        inertia, lag = values[:, INERTIA], values[:, LAG]
        a = np.zeros((len(values), 8, 8))
        a[:, 0, 1] = a[:, 3, 4] = 1.0
        a[:, 1, 1], a[:, 1, 2], a[:, 1, 7] = -(values[:, DAMPING] + d) / inertia, 1.0 / inertia, 1.0 / inertia
        a[:, 1, 3], a[:, 1, 4], a[:, 3, 1] = k / inertia, d / inertia, -1.0
        a[:, 2, 2], a[:, 2, 5] = -1.0 / lag, values[:, TORQUE] / lag
        a[:, 4, [1, 3, 4, 6]] = d / m, -k / m, -d / m, 1.0 / m
        rest, period = a.copy(), self.record.period
        rest[:, :2] = 0.0
        (whole, part), spans = _delays(values, period), []
        for seconds, ago in ((part, whole + 1), (period - part, whole)):
            count = max(1, math.ceil(seconds[0] / LONGEST_SPAN - 1e-9))
            times = (seconds / count)[:, np.newaxis, np.newaxis]
            spans += [(expm(a * times)[:, :5], expm(rest * times)[:, :5], times[:, 0], ago)] * count
        return spans


def _delays(values: Matrix, period: float) -> tuple[int, Matrix]:
    """Return the whole periods of the delay, those of the first values, and the rest of each [s]."""
    delays = values[:, BOTH] - values[:, LAG]
    whole = int(delays[0] // period)
    return whole, delays - whole * period


def _turned(
    z: Matrix, moved: Matrix, back: NDArray[np.bool_], side: Matrix, pull: Matrix, coulomb: Matrix, seconds: Matrix,
    inertia: Matrix,
) -> Matrix:  # fmt: skip
    """Change the states that reverse inside a span, in place, and return the new directions; 0 where one sticks."""
    before = z[:, 1]
    share = np.where(back, before / np.where(back, before - moved[:, 1], 1.0), 0.0)
    turns = back & (np.abs(pull) > coulomb)
    side = np.where(turns, np.sign(pull), np.where(back, 0.0, side))
    left = (1.0 - share) * seconds
    speed = np.where(turns, left * (pull - coulomb * side) / inertia, 0.0)
    angle = z[:, 0] + 0.5 * before * share * seconds + 0.5 * speed * left
    moved[:, 0], moved[:, 1] = np.where(back, angle, moved[:, 0]), np.where(back, speed, moved[:, 1])
    return side


def _mean_force(record: RunRecord, start: float) -> Matrix:
    """Return the mean force of the hand in each period, shape (n,), when it starts so long after `enabled` [s]."""
    times = record.period * (np.arange(len(record.positions) + 1) - record.enabled) - start
    mean: Matrix = np.diff(record.hand.impulse(times)) / record.period if record.hand else np.zeros(len(times) - 1)
    return mean


def _led(record: RunRecord) -> Matrix:
    """Return `_Pieces.led`."""
    hand, period = record.hand, record.period
    if hand is None:
        return np.zeros((0, 2, 3))
    a = np.zeros((5, 5))
    a[0, 1] = a[2, 3] = 1.0
    a[1] = np.array([-hand.stiffness, -hand.damping, hand.stiffness, hand.damping, 1.0]) / hand.inertia
    step = expm(a * period)[:2]
    places = np.stack([record.positions, np.ones(len(record.positions)), np.zeros(len(record.positions))])
    slopes = np.diff(places, append=places[:, -1:]) / period
    forces = np.zeros_like(places)
    forces[2] = _mean_force(record, 0.0)
    drive = np.einsum("ij,jkn->nik", step[:, 2:], np.stack([places, slopes, forces]))
    course, state = np.zeros_like(drive), np.zeros((2, 3))
    for number in range(len(drive)):
        course[number] = state
        state = step[:, :2] @ state + drive[number]
    return course


class _Fit:
    """Least squares over pieces; `free` are the values that it may change."""

    def __init__(
        self, pieces: _Pieces, start: Matrix, free: Sequence[int], expected: tuple[Matrix, Matrix] | None = None
    ) -> None:
        self.pieces, self.values, self.free = pieces, start.copy(), list(free)
        record, self.seen = pieces.record, pieces.seen
        self.angle, self.speed = pieces.begun(float(start[COUNTS]))
        self.top = max(float(np.abs(self.speed).max(initial=0.0)), 1e-9)
        torque, period = float(np.sqrt(np.mean(record.torques**2))) or 1e-6, record.period
        self.scales = np.array([start[INERTIA], torque / self.top, torque, period, period, torque, period, record.resolution, 1.0, start[COUNTS]])
        none = math.inf
        self.low = np.array([1e-3 * start[INERTIA], 0.0, 0.0, SHORTEST_LAG, SHORTEST_LAG, -none, 0.0, -record.resolution, 0.05, 0.02])
        self.high = np.array(
            [1e3 * start[INERTIA], none, none, LONGEST_DELAY * period, LONGEST_LAG, none, 1.5 * period, record.resolution, 20.0, 50.0]
        )
        spreads = np.array([none, none, none, period, start[LAG], torque, 0.3 * period, 0.5 * record.resolution, 0.5, none])
        self.expected = expected or (start.copy(), spreads)
        self.cost = none
        self.slopes = np.zeros((0, 0))
        self.scores = np.zeros((0, 0))

    @property
    def rms(self) -> float:
        """Root mean square of the error [counts]."""
        return math.sqrt(float(np.mean(self.errors(self.values, self.angle, self.speed) ** 2)))

    def errors(self, values: Matrix, angle: Matrix, speed: Matrix) -> Matrix:
        """Return the errors of a single set of values [counts], shape (s, l)."""
        found = self.pieces.predicted(values[np.newaxis], angle[np.newaxis], speed[np.newaxis])[0]
        off: Matrix = (found - self.seen) / self.pieces.record.resolution
        return off

    def total(self, errors: Matrix, values: Matrix) -> float:
        """Return the sum of squares; what is expected of values counts as one observation each."""
        centre, spread = self.expected
        return float(np.sum(errors**2) + np.sum(((values - centre) / spread)[self.free] ** 2) / 12.0)

    def solved(self) -> "_Fit":
        """Descend to the least sum of squares."""
        if INERTIA in self.free:
            self._begin()
            # Delay and lag at first as stated: from far away, the valley of damping and delay is long.
            free, self.free = self.free, [name for name in self.free if name not in (BOTH, LAG)]
            self._descend()
            self.free = free
        self._descend()
        return self

    def _descend(self) -> None:
        self.cost, damping = self.total(self.errors(self.values, self.angle, self.speed), self.values), 1e-3
        for _ in range(MOST_STEPS):
            before = self.cost
            damping = self._step(damping)
            if before - self.cost < LEAST_GAIN * before:
                break

    def _begin(self) -> None:
        """Begin with the share of the inertia that explains most."""
        values = np.repeat(self.values[np.newaxis], len(FIRST_SHARES), 0)
        values[:, INERTIA] *= FIRST_SHARES
        shape = (len(values), len(self.angle))
        found = self.pieces.predicted(values, np.broadcast_to(self.angle, shape), np.broadcast_to(self.speed, shape))
        self.values = values[int(np.argmin(np.sum((found - self.seen) ** 2, axis=(1, 2))))]

    def _step(self, damping: float) -> float:
        """Do one step, if any goes down, and return the damping of the next."""
        errors, slopes, local = self._derivatives()
        basis, corner = np.linalg.qr(local)
        corner = corner + 1e-9 * np.eye(2) * np.abs(corner).max(axis=(1, 2), keepdims=True)
        inner = np.einsum("slk,asl->ask", basis, slopes)
        slopes -= np.einsum("slk,ask->asl", basis, inner)
        wrong = np.einsum("slk,sl->sk", basis, errors)
        centre, spread = ((each / self.scales)[self.free] for each in self.expected)
        vector, weight = (self.values / self.scales)[self.free], 1.0 / (12.0 * spread**2)
        self.scores = np.einsum("asl,sl->sa", slopes, errors - np.einsum("slk,sk->sl", basis, wrong))
        self.slopes = np.einsum("asl,bsl->ab", slopes, slopes) + np.diag(weight)
        gradient = self.scores.sum(0) + weight * (vector - centre)
        while damping < 1e8:
            values = self._moved(gradient, damping)
            went = ((values - self.values) / self.scales)[self.free]
            rest = np.linalg.solve(corner, -(wrong + np.einsum("a,ask->sk", went, inner))[..., np.newaxis])[..., 0]
            rest = np.clip(rest / (1.0 + damping), -50.0, 50.0) * self._local_steps()
            angle, speed = self.angle + rest[:, 0], self.speed + rest[:, 1]
            cost = self.total(self.errors(values, angle, speed), values)
            if cost < self.cost:
                self.values, self.angle, self.speed, self.cost = values, angle, speed, cost
                return max(0.2 * damping, 1e-9)
            damping *= 6.0
        return damping

    def _local_steps(self) -> Matrix:
        """Return the steps of first angle and speed in derivatives, shape (2,)."""
        return np.array([0.5 * self.pieces.record.resolution / self.values[COUNTS], 5e-3 * self.top])

    def _derivatives(self) -> tuple[Matrix, Matrix, Matrix]:
        """Return errors (s, l), their derivatives by the free values (a, s, l), and by first angle and speed (s, l, 2)."""
        count = len(self.free)
        values = np.repeat(self.values[np.newaxis], count + 3, 0)
        angle, speed = (np.repeat(each[np.newaxis], count + 3, 0) for each in (self.angle, self.speed))
        for row, name in enumerate(self.free):
            values[row, name] += SMALL * self.scales[name]
        values = np.roll(values, 1, axis=0)
        steps = self._local_steps()
        angle[-2] += steps[0]
        speed[-1] += steps[1]
        found = self.pieces.predicted(values, angle, speed) / self.pieces.record.resolution
        moved = found[1:] - found[0]
        errors = found[0] - self.seen / self.pieces.record.resolution
        return errors, moved[:count] / SMALL, np.moveaxis(moved[count:], 0, -1)

    def _moved(self, gradient: Matrix, damping: float) -> Matrix:
        """Return the values after a damped step of those that no bound holds; scales change by a factor of 2 at most."""
        values, free = self.values.copy(), np.array(self.free, int)
        low, high = self.low[free], self.high[free]
        at_end = ((values[free] <= low) & (gradient > 0.0)) | ((values[free] >= high) & (gradient < 0.0))
        inner = np.flatnonzero(~at_end)
        if len(inner):
            square = self.slopes[np.ix_(inner, inner)]
            square = square + damping * np.diag(np.diag(square) + 1e-300)
            step = np.linalg.lstsq(square, gradient[inner], rcond=None)[0]
            values[free[inner]] -= step * self.scales[free[inner]]
        for name in (INERTIA, TORQUE, COUNTS):
            values[name] = min(max(values[name], 0.5 * self.values[name]), 2.0 * self.values[name])
        values = np.clip(values, self.low, self.high)
        values[LAG] = min(values[LAG], values[BOTH])
        return values

    # What the solution says.

    def told(self, check: float) -> RunFit:
        """Return the values with their intervals, and the reasons of those that the record does not tell."""
        rms, record = self.rms, self.pieces.record
        inverse = np.linalg.pinv(self.slopes, rcond=1e-14)
        spread = self.scores.T @ self.scores
        covariance = np.maximum(np.diag(inverse @ spread @ inverse), np.diag(inverse) * max(rms**2, 1.0 / 12.0))
        deviations = dict(zip(self.free, np.sqrt(covariance) * self.scales[self.free], strict=True))
        top, estimates = self.top, dict[str, Estimate]()
        for name in TOLD:
            place, value = NAMES.index(name), float(self.values[NAMES.index(name)])
            least = LEAST_TIME if place in (BOTH, LAG) else LEAST_SHARE * abs(value)
            half = max(WIDTH * deviations.get(place, 0.0), least)
            low = -math.inf if name == "load" else 0.0
            estimates[name] = Estimate(value, max(value - half, low), value + half, UNITS.get(name, ""))
        estimates |= {"delay": estimates["delay_and_lag"]}
        values = {name: replace(each, reason=reason_of(name, estimates, top)) for name, each in estimates.items()
                  if name in UNITS and name != "delay"}  # fmt: skip
        values |= {name: estimates[name] for name in ("torque_scale", "count_scale")}
        seconds = len(self.pieces.first) * self.pieces.length * record.period
        return RunFit(values, rms, check, top, seconds, tuple(_warnings(rms)))


def _warnings(rms: float) -> Iterator[str]:
    if rms > 3.0 * ENCODER_NOISE:
        yield (
            f"the model leaves {rounded(rms)} counts unexplained: cogging, play, a weight on a lever, Stribeck friction, an "
            "elastic coupling or another hand are not in it"
        )

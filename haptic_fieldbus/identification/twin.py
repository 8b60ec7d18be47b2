"""Fit of a bench to an ordinary run, in which a hand of stated model, or no hand, moves the handle.

Theory. The shaft of `shaft` is held by a hand: a mass m, which a spring k and a damper d join to the handle, with the
force f on it. With the stretch δ of the spring and the speed ν of the mass,

    J·ω' = τ + g − c·sign ω − b·ω + k·δ + d·(ν − ω)        T·τ' = s·u − τ
    δ' = ν − ω                                             m·ν' = f − k·δ − d·(ν − ω)

with s, torque given over torque asked. The recorded position is the angle times true counts over stated counts. Both
scales are 1 unless the record contradicts it. Only a hand of stated force and stiffness tells them: without a hand, a
record is the same for all benches with the same ratios of inertia, damping, friction and torque. The lag T is that of
the profile, since an ordinary run tells only its sum with the delay.

The record is cut into pieces that begin in motion, each with a first angle and speed of its own (multiple shooting:
Bock 1981, doi:10.1007/978-3-642-68220-9_8). All pieces and all derivatives are simulated side by side. The linear
motion is exact; a reversal inside a span of 1 ms is found by a straight line. First angles and speeds are eliminated
from each step of Levenberg and Marquardt (variable projection: Golub and Pereyra 1973, doi:10.1137/0710036).

The covariance takes pieces as independent, and samples of one piece as correlated in an unknown way (Liang and Zeger
1986, doi:10.1093/biomet/73.1.13). What the profile tells about the delay is a weak observation beside the record.
"""

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.identification.estimates import Estimate, estimate_of, with_reasons
from haptic_fieldbus.identification.fit import ENCODER_NOISE, LONGEST_DELAY, WIDTH, free_step
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.numerics.linear import Matrix, expm

Samples = NDArray[np.int64]
INERTIA, DAMPING, FRICTION, BOTH, LAG, LOAD, START, ZERO, TORQUE, COUNTS = range(10)
"""Places of the values: `BOTH` is delay and lag together, `START` the start of the hand after `enabled` [s], `ZERO` the
place of the encoder's zero within a count [rad], `TORQUE` and `COUNTS` the scales."""
TOLD = {"inertia": INERTIA, "viscous_damping": DAMPING, "coulomb_friction": FRICTION, "delay_and_lag": BOTH,
        "load": LOAD, "torque_scale": TORQUE, "count_scale": COUNTS}  # fmt: skip
"""Values that a fit tells."""
PIECE, FEWEST_SAMPLES, FEWEST_PIECES, MOST_PIECES = 0.5, 24, 4, 60
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
FIRST_SHARES = (1.0, 0.1, 0.3, 3.0, 10.0)
"""Shares of the stated inertia from which a fit may begin."""
COUNT_SCALES, FEW_PIECES, SAME_SCALE = (1.0, 0.25, 4.0), 20, 0.02
"""Scales of the counts from which a fit may begin, about the number of pieces that choose one of them, and the share
within which a scale is one of these."""
ROUNDING, CONTRADICTED = 1.0 / 12.0, 40.0
"""Variance of an encoder [counts²], and the fall of the sum of squares, in variances, from which a record contradicts
that both scales are 1: chance alone gives 2, and about 10 in 1 of 100; samples of one piece vary together."""
KNOWN_SCALE = 0.05
"""Largest half of the interval of a scale that a record tells, as a share of it."""
ONLY_A_HAND, ACT_ALIKE = "only a hand of known force tells it", "the torque of the scene and the bench act alike"
TOO_WIDE = "its interval is too wide, so the stated hand may be wrong"
NOT_EXPLAINED, UNEXPLAINED = 20.0, "another bench or hand moved the handle: the model does not explain the motion"
"""Error that tells more of the model than of its values [counts], and the reason of a value that it leaves open."""
SCALES = ("torque_scale", "count_scale")
LEAST_SHARE, LEAST_TIME = 0.01, 2e-5
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

    def impulse(self, times: Matrix) -> Matrix:
        """Return the integral of the force up to each time [N·m·s]."""
        omega, total, end = self.angular_frequency, np.zeros(len(times)), math.inf
        for start, force, slope in reversed(self.pieces):
            t = np.clip(times - start, 0.0, end - start)
            if omega:
                total += force / omega * np.sin(omega * t) + slope / omega**2 * (1.0 - np.cos(omega * t))
            else:
                total += force * t + 0.5 * slope * t * t
            end = start
        return total


NOBODY = HoldingHand(1.0, 0.0, 0.0)
"""A hand without stiffness and force."""


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
    hand: HoldingHand = NOBODY
    """`NOBODY`: nobody holds the handle in the usable samples."""
    enabled: int = 0
    """Sample in whose period the hand starts."""

    def mean_force(self, start: float) -> Matrix:
        """Return the mean force of the hand in each period when it starts so long after `enabled` [s], shape (n,)."""
        times: Matrix = self.period * (np.arange(len(self.positions) + 1.0) - self.enabled) - start
        return np.diff(self.hand.impulse(times)) / self.period


@dataclass(frozen=True)
class RunFit:
    """The bench that explains a run best."""

    values: Mapping[str, Estimate]
    """Values with intervals of 95 %; a value with a reason is not told by the record."""
    residual: float
    """Root mean square of the error [counts]."""
    predicted: float | None
    """The same in the pieces that were not used [counts]; None: all were used, since there are few."""
    top_speed: float
    """[rad/s]"""
    seconds: float
    """Length of the pieces that were used [s]."""


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
    is_held = record.hand is not NOBODY
    free = [each for each in range(TORQUE if is_held else START) if each != LAG]
    fit, reasons = _Fit(used, values, free).solved(), {"torque_scale": ONLY_A_HAND}
    if is_held:
        fit, reasons = _scaled(fit, values)
    told = fit.told()
    named = {name: replace(told[name], reason=reason) for name, reason in reasons.items()}
    check = _Fit(unused, fit.values, []).solved().rms if rest.any() else None
    return RunFit(told | named, fit.rms, check, fit.top, fit.seen.size * record.period)


def _scaled(fit: "_Fit", values: Matrix) -> tuple["_Fit", dict[str, str]]:
    """Return the fit with the scales that the record tells, and why it does not tell one."""
    # What explains the record needs no other counts: those of a slip leave far more than rounding.
    freed = fit.freed(TORQUE) if fit.rms < ENCODER_NOISE else _with_scales(fit, values)
    scaled = _rounded(freed, fit, values)
    if (fit.cost - scaled.cost) / max(scaled.rms**2, ROUNDING) > CONTRADICTED:
        if any(_is_wide(scaled, name) for name in SCALES):
            return fit, dict.fromkeys(SCALES, TOO_WIDE)
        fit = scaled
    alike = fit.values[TORQUE] == 1.0 and _is_wide(freed, "torque_scale")
    return fit, {"torque_scale": ACT_ALIKE} if alike else {}


def _is_wide(fit: "_Fit", name: str) -> bool:
    """Return whether the interval of a scale is too wide to be told."""
    told = fit.told()[name]
    return told.half_width > KNOWN_SCALE * told.value


def _with_scales(fit: "_Fit", values: Matrix) -> "_Fit":
    """Return the fit with scales of torque and counts."""
    few = fit.pieces.part(np.arange(len(fit.pieces.first)) % (1 + len(fit.pieces.first) // FEW_PIECES) == 0)
    free, starts = [*fit.free, TORQUE, COUNTS], [np.append(values[:COUNTS], scale) for scale in COUNT_SCALES]
    begun = min((_Fit(few, start, free).solved() for start in starts), key=lambda each: each.cost)
    return _Fit(fit.pieces, begun.values, free, values).solved()


def _rounded(freed: "_Fit", fit: "_Fit", values: Matrix) -> "_Fit":
    """Return the fit in which a scale within `SAME_SCALE` of a round number is that number, if it explains as much."""
    start, free = freed.values.copy(), freed.free
    for name, rounds in ((TORQUE, COUNT_SCALES[:1]), (COUNTS, COUNT_SCALES)):
        for near in (each for each in rounds if abs(start[name] / each - 1.0) < SAME_SCALE):
            start[name], free = near, [each for each in free if each != name]
    same = free == fit.free and start[COUNTS] == 1.0
    again = fit if same else freed if free == freed.free else _Fit(fit.pieces, start, free, values).solved()
    return again if again.rms < max(1.1 * freed.rms, ENCODER_NOISE) else freed


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces of a record, simulated side by side."""

    record: RunRecord
    first: Samples
    """First sample of each piece, shape (s,)."""
    length: int
    led: Matrix
    """`_led` of the record."""

    @classmethod
    def of(cls, record: RunRecord) -> "_Pieces":
        """Return the pieces of a record that begin in motion."""
        length, y = max(FEWEST_SAMPLES, round(PIECE / record.period)), record.positions
        width, unusable = max(2, round(MOVING_TIME / record.period)), np.append(0, np.cumsum(~record.usable))
        moving = np.zeros(len(y), bool)
        moving[width:-width] = np.abs(y[2 * width :] - y[: -2 * width]) >= MOVING_COUNTS * record.resolution
        first, at = list[int](), max(2 * width, record.enabled + 1, HISTORY + round(LONGEST_DELAY) + 2)
        while at <= len(y) - length:
            begins = moving[at] and unusable[at + length] == unusable[at - width]
            first += [at] * bool(begins)
            at += length if begins else max(1, width // 2)
        chosen = np.linspace(0, len(first) - 1, min(len(first), MOST_PIECES)).round().astype(int)
        return cls(record, np.array(first, np.int64)[chosen], length, _led(record))

    def part(self, chosen: NDArray[np.bool_]) -> "_Pieces":
        return replace(self, first=self.first[chosen])

    @property
    def samples(self) -> Samples:
        """Samples of the pieces, shape (s, l)."""
        return self.first[:, np.newaxis] + np.arange(self.length)

    def begun(self, scale: float) -> tuple[Matrix, Matrix]:
        """Return first angles and speeds by a parabola through the samples around."""
        width = max(3, round(MOVING_TIME / self.record.period))
        around = np.arange(-width, width + 1)
        y = self.record.positions[self.first[:, np.newaxis] + around] / scale
        angle, speed, _ = np.polynomial.polynomial.polyfit(self.record.period * around, y.T, 2)
        return angle, speed

    def predicted(self, values: Matrix, angle: Matrix, speed: Matrix) -> Matrix:
        """Return the predicted records, shape (p, s, l), of values (p, 10) from first angles and speeds (p, s)."""
        hand, (z, forces) = self.record.hand, self._start(values, angle, speed)
        spans, side, u = self._spans(values, hand), np.sign(speed), self.record.torques
        inertia, coulomb, load = (values[:, place, np.newaxis] for place in (INERTIA, FRICTION, LOAD))
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
                slips = np.where(np.abs(pull) > coulomb, np.sign(pull), 0.0)
                back = ~stuck & (moved[:, 1] * side < 0.0)
                side = np.where(stuck | back, slips, side)
                if back.any():
                    _turn(z, moved, back, seconds, side * (np.abs(pull) - coulomb) / inertia)
                z[:, :5] = moved
        return out * values[:, COUNTS, np.newaxis, np.newaxis] + values[:, ZERO, np.newaxis, np.newaxis]

    def _start(self, values: Matrix, angle: Matrix, speed: Matrix) -> tuple[Matrix, Matrix]:
        """Return the states at the begin of the pieces, shape (p, 8, s), and the forces of the hand, (p, n)."""
        record, first = self.record, self.first
        (whole, part), lag = _delays(values, record.period), values[:, LAG, np.newaxis]
        weights = np.exp(-record.period / lag * np.arange(HISTORY))
        earlier = record.torques[first - whole - 2 - np.arange(HISTORY)[:, np.newaxis]]
        before, last = weights @ earlier / weights.sum(1, keepdims=True), record.torques[first - whole - 1]
        z = np.zeros((len(values), 8, len(first)))
        z[:, 0], z[:, 1] = angle, speed
        waned = np.exp((part[:, np.newaxis] - record.period) / lag)
        z[:, 2] = values[:, TORQUE, np.newaxis] * (last + (before - last) * waned)
        forces = {start: record.mean_force(start) for start in values[:, START]}
        for row, (start, zero, scale) in enumerate(values[:, [START, ZERO, COUNTS]]):
            for state, (places, one, pushed) in enumerate(np.moveaxis(self.led, 0, -1)):
                late = np.interp(first - start / record.period, np.arange(len(pushed)), pushed)
                z[row, 3 + state] = (places[first] - zero * one[first]) / scale + late
        z[:, 3] -= angle
        return z, np.stack([forces[start] for start in values[:, START]])

    def _spans(self, values: Matrix, hand: HoldingHand) -> list[tuple[Matrix, Matrix, Matrix, int]]:
        """Return the spans of a period: slipping and sticking (p, 5, 8), seconds (p, 1), age of the set-point."""
        k, d, m, inertia, lag = hand.stiffness, hand.damping, hand.inertia, values[:, INERTIA], values[:, LAG]
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


def _turn(z: Matrix, moved: Matrix, back: NDArray[np.bool_], seconds: Matrix, acceleration: Matrix) -> None:
    """Change in place the states that reverse inside a span; one without `acceleration` sticks from there on."""
    before = z[:, 1]
    share = np.where(back, before / np.where(back, before - moved[:, 1], 1.0), 0.0)
    left = (1.0 - share) * seconds
    angle = z[:, 0] + 0.5 * before * share * seconds + 0.5 * acceleration * left**2
    moved[:, 0], moved[:, 1] = np.where(back, angle, moved[:, 0]), np.where(back, acceleration * left, moved[:, 1])


def _led(record: RunRecord) -> Matrix:
    """Return place and speed of the hand in each sample, shape (n, 2, 3).

    They are led by the recorded positions, by a position of 1 rad, and by the force of the hand.
    """
    hand, positions = record.hand, record.positions
    a = np.zeros((5, 5))
    a[0, 1] = a[2, 3] = 1.0
    a[1] = np.array([-hand.stiffness, -hand.damping, hand.stiffness, hand.damping, 1.0]) / hand.inertia
    step = expm(a * record.period)[:2]
    # Up to the first other count the shaft is where the hand was at its start, and not a part of a count beside it.
    begun = (np.cumsum(positions != positions[record.enabled]) > 0).astype(float)
    none = np.zeros(len(positions))
    places, forces = np.stack([positions, begun, none]), np.stack([none, none, record.mean_force(0.0)])
    slopes = np.diff(places, append=places[:, -1:]) / record.period
    drive = np.einsum("ij,jkn->nik", step[:, 2:], np.stack([places, slopes, forces]))
    states = accumulate(drive[:-1], lambda state, led: step[:, :2] @ state + led, initial=np.zeros((2, 3)))
    return np.array(list(states))


class _Fit:
    """Least squares over pieces; `free` are the values that it may change, `expected` what is weakly known before."""

    def __init__(self, pieces: _Pieces, start: Matrix, free: Sequence[int], expected: Matrix | None = None) -> None:
        self.pieces, self.values, self.free = pieces, start.copy(), list(free)
        self.expected = start if expected is None else expected
        record, self.seen = pieces.record, pieces.record.positions[pieces.samples]
        # Samples with the same count, one after the other, tell as much as one of them.
        begins = np.flatnonzero(np.diff(record.positions, prepend=np.nan))
        alike = np.diff(begins, append=len(record.positions))
        self.weights = 1.0 / np.sqrt(np.repeat(alike, alike)[pieces.samples]) / record.resolution
        self.angle, self.speed = pieces.begun(float(start[COUNTS]))
        self.top = max(float(np.abs(self.speed).max(initial=0.0)), 1e-9)
        torque, period, none = float(np.sqrt(np.mean(record.torques**2))) or 1e-6, record.period, math.inf
        count, inertia, lag = record.resolution, float(start[INERTIA]), float(start[LAG])
        # Of each value: scale, lowest and highest value, and standard deviation of what is expected.
        self.scales, self.low, self.high, self.spreads = np.array([
            (inertia, 1e-3 * inertia, 1e3 * inertia, none), (torque / self.top, 0.0, none, none),
            (torque, 0.0, none, none), (period, lag, lag + LONGEST_DELAY * period, period), (period, lag, lag, none),
            (torque, -none, none, torque), (period, 0.0, 1.5 * period, 0.3 * period),
            (count, -count, count, 0.5 * count), (1.0, 0.05, 20.0, 0.5), (start[COUNTS], 0.02, 50.0, none),
        ]).T  # fmt: skip
        self.cost, self.slopes, self.scores = none, np.zeros((0, 0)), np.zeros((0, 0))

    @property
    def rms(self) -> float:
        """Root mean square of the error [counts]."""
        errors = self.errors(self.values[np.newaxis], self.angle[np.newaxis], self.speed[np.newaxis])
        return math.sqrt(float(np.sum(errors**2) / np.sum((self.weights * self.pieces.record.resolution) ** 2)))

    def errors(self, values: Matrix, angle: Matrix, speed: Matrix) -> Matrix:
        """Return the weighted errors of sets of values [counts], shape (p, s, l)."""
        errors: Matrix = (self.pieces.predicted(values, angle, speed) - self.seen) * self.weights
        return errors

    def total(self, values: Matrix, angle: Matrix, speed: Matrix) -> float:
        """Return the sum of squares of a set of values; an error of an encoder has a variance of 1/12."""
        before = ((values - self.expected) / self.spreads)[self.free]
        errors = self.errors(values[np.newaxis], angle[np.newaxis], speed[np.newaxis])
        return float(np.sum(errors**2) + ROUNDING * (before @ before))

    def solved(self) -> "_Fit":
        """Descend to the least sum of squares."""
        if INERTIA in self.free:
            starts = [np.append(share * self.values[INERTIA], self.values[1:]) for share in FIRST_SHARES]
            self.values = min(starts, key=lambda each: self.total(each, self.angle, self.speed))
            # The delay at first as expected: from far away, the valley of damping and delay is long.
            free, self.free = self.free, [name for name in self.free if name != BOTH]
            self._descend()
            self.free = free
        self._descend()
        return self

    def freed(self, name: int) -> "_Fit":
        """Return the fit that goes on from this one with a further free value."""
        more = copy(self)
        more.free = [*self.free, name]
        more._descend()
        return more

    def _descend(self) -> None:
        self.cost, damping = self.total(self.values, self.angle, self.speed), 1e-3
        for _ in range(MOST_STEPS):
            before = self.cost
            damping = self._step(damping)
            if before - self.cost < LEAST_GAIN * before:
                return

    def _step(self, damping: float) -> float:
        """Do one step, if any goes down, and return the damping of the next."""
        errors, slopes, local, steps = self._derivatives()
        basis, corner = np.linalg.qr(local)
        corner = corner + 1e-9 * np.eye(2) * np.abs(corner).max(axis=(1, 2), keepdims=True)
        inner, wrong = np.einsum("slk,asl->ask", basis, slopes), np.einsum("slk,sl->sk", basis, errors)
        slopes -= np.einsum("slk,ask->asl", basis, inner)
        scales, weight = self.scales[self.free], ROUNDING * (self.scales / self.spreads)[self.free] ** 2
        self.scores = np.einsum("asl,sl->sa", slopes, errors - np.einsum("slk,sk->sl", basis, wrong))
        self.slopes = np.einsum("asl,bsl->ab", slopes, slopes) + np.diag(weight)
        gradient = self.scores.sum(0) + weight * (self.values - self.expected)[self.free] / scales
        while damping < 1e8:
            values = self._moved(gradient, damping)
            went = (values - self.values)[self.free] / scales
            rest = np.linalg.solve(corner, -(wrong + np.einsum("a,ask->sk", went, inner))[..., np.newaxis])[..., 0]
            rest = np.clip(rest / (1.0 + damping), -50.0, 50.0) * steps
            angle, speed = self.angle + rest[:, 0], self.speed + rest[:, 1]
            if (cost := self.total(values, angle, speed)) < self.cost:
                self.values, self.angle, self.speed, self.cost = values, angle, speed, cost
                return max(0.2 * damping, 1e-9)
            damping *= 6.0
        return damping

    def _derivatives(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """Return errors (s, l), derivatives by free values (a, s, l) and by first states (s, l, 2), and their steps."""
        count = len(self.free)
        steps = np.array([0.5 * self.pieces.record.resolution / self.values[COUNTS], 5e-3 * self.top])
        values, angle, speed = (np.stack([each] * (count + 3)) for each in (self.values, self.angle, self.speed))
        values[range(1, count + 1), self.free] += SMALL * self.scales[self.free]
        angle[-2] += steps[0]
        speed[-1] += steps[1]
        found = self.errors(values, angle, speed)
        moved = found[1:] - found[0]
        return found[0], moved[:count] / SMALL, np.moveaxis(moved[count:], 0, -1), steps

    def _moved(self, gradient: Matrix, damping: float) -> Matrix:
        """Return the values after a damped step of those that no bound holds; scales change by 2 at most."""
        values, free = self.values.copy(), self.free
        step = free_step(values[free], self.low[free], self.high[free], gradient, self.slopes, damping)
        values[free] -= step * self.scales[free]
        for name in (INERTIA, TORQUE, COUNTS):
            values[name] = np.clip(values[name], 0.5 * self.values[name], 2.0 * self.values[name])
        return np.clip(values, self.low, self.high)

    def told(self) -> dict[str, Estimate]:
        """Return the values with their intervals, and the reasons of those that the record does not tell."""
        inverse, values = np.linalg.pinv(self.slopes, rcond=1e-14), dict[str, Estimate]()
        sandwich = inverse @ self.scores.T @ self.scores @ inverse
        # Where values act alike, rounding can make a variance negative.
        variances = np.maximum(np.abs(np.diag(sandwich)), np.abs(np.diag(inverse)) * max(self.rms**2, ROUNDING))
        deviations = dict(zip(self.free, np.sqrt(variances) * self.scales[self.free], strict=True))
        for name, place in TOLD.items():
            value = float(self.values[place])
            least = LEAST_TIME if place == BOTH else LEAST_SHARE * abs(value)
            values[name] = estimate_of(name, value, max(WIDTH * float(deviations.get(place, 0.0)), least))
        found = with_reasons(values, self.top)
        if self.rms < NOT_EXPLAINED:
            return found
        return {name: replace(each, reason=each.reason and UNEXPLAINED) for name, each in found.items()}

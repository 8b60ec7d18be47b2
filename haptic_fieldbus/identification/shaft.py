"""The shaft of a bench as a sampled system: positions that follow from torques, by exact discretisation.

Theory. Between two instants the motor torque τ, the speed ω and the angle θ follow

    T·τ' = u − τ          J·ω' = τ + g − c·s − b·ω          θ' = ω

with the inertia J, the viscous damping b, the Coulomb friction c against the direction s, a constant load g and the lag
T of the torque loop. The set-point u_k that is computed from sample k acts from t_k + d to t_{k+1} + d. Over a span h
with constant u and s the solution is, with a = b/J, A = exp(−a·h), E = exp(−h/T) and P = (1 − A)/a,

    ω(h) = A·ω + (u + g − c·s)/J·P + (τ − u)/J·(A − E)/(1/T − a)

and θ(h) is its integral. A shaft that comes to rest sticks while |τ + g| ≤ c. The instants of reversal and breakaway
are found inside the span, so friction is in the model and not in the residual.

Two further torques are held over short times. Stribeck friction adds s₀·exp(−(ω/ω₀)²) to c, and s₀ at rest. Where it
changes within a period, it is held over up to eight parts of it, with ω in the middle of each. Waves
Σ α·cos(n·θ) + β·sin(n·θ) are torques that depend on the place, as of cogging or of a weight on a lever; they add to g
their mean over the way of a period.

An open integration drifts: a torque error of a thousandth moves the angle without end. After each sample the model is
therefore led back slowly to the record, by a double pole at `LEADING` [1/s]; what the record shows faster than this is
predicted (Ljung, System Identification, 2nd ed. 1999, 3.2 and 7.2: a predictor of fixed gain). At the true values the
residual is the noise of the encoder, whatever the gain.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter
from typing import Any

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix

LEADING = 6.0
"""Double pole that leads the model back to the record [1/s]."""
PARTS, FALLEN = {0.15: 2, 0.5: 4, math.inf: 8}, 2.5
"""Parts of a period in which Stribeck friction is followed, by the largest change of the speed in a period, and from
which speed on it is 0; both speeds as multiples of that of the friction."""
SMALL_STATE = 1e-7
"""Step of a difference by a state, of its largest value."""
MOSTLY_AT_REST = 0.6
"""Largest share of samples at rest of a record for which slopes are taken period by period."""
MOST_EVENTS = 8
"""Reversals and breakaways that are followed in one span."""
Spans = list[tuple[float, int]]
"""Pieces of a period with constant set-point: length [s], and how many set-points before its own act in the period
before, 0 or 1."""
_HALVINGS = 60
REST_SHARE = 1e-10
"""Speed that counts as rest, as a share of those at both ends of a span."""


@dataclass(frozen=True)
class ShaftModel:
    """Values of a bench at the motor shaft, SI."""

    inertia: float
    """[kg·m²]"""
    damping: float
    """Viscous damping [N·m·s/rad]."""
    coulomb: float
    """Coulomb friction [N·m]."""
    delay: float
    """Time from the latch of a sample until the set-point computed from it acts [s]."""
    lag: float
    """Time constant of the torque loop [s]."""
    load: float = 0.0
    """Constant torque that acts from outside, such as a weight [N·m]."""
    stribeck: float = 0.0
    """Friction at rest beyond Coulomb friction [N·m]."""
    stribeck_speed: float = 1.0
    """Speed at which it has fallen to 1/e [rad/s]."""
    waves: tuple[tuple[float, float, float], ...] = ()
    """Torques over the angle: number of periods per radian, times 2π, and torques of cosine and sine [N·m]."""

    def torque_at(self, angle: Any, way: Any = 0.0, functions: Any = math) -> Any:
        """Return load and waves at an angle [rad], as the mean over a `way` around it [N·m]; arrays take `numpy`."""
        total = self.load
        for order, cosine, sine in self.waves:
            half, turn = 0.5 * order * way + 1e-30, order * angle
            total = total + functions.sin(half) / half * (cosine * functions.cos(turn) + sine * functions.sin(turn))
        return total

    def friction_at(self, speed: Any, functions: Any = math) -> Any:
        """Return Coulomb and Stribeck friction at a speed [N·m]; arrays take `numpy`."""
        return self.coulomb + self.stribeck * functions.exp(-((speed / self.stribeck_speed) ** 2))


@dataclass(frozen=True, eq=False)
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

    def torques_under(self, width: int, delay: float) -> Matrix:
        """Return the mean torque under a triangle of half a `width` around each sample between the first and last ones.

        `width` is in periods, and so is the `delay` of the set-points.
        """
        triangle = np.concatenate([np.arange(1, width + 1), np.arange(width - 1, 0, -1)]) / width**2
        # A set-point acts from its sample on, so its middle is half a period later.
        samples = np.arange(len(self.positions))
        acting = np.interp(samples - 0.5 - delay, samples, self.torques)
        return np.convolve(acting, triangle, "valid")[1:]

    def part(self, first: int, last: int | None = None) -> "ShaftRecord":
        """Return the samples from `first` up to `last`, without it."""
        return replace(self, positions=self.positions[first:last], torques=self.torques[first:last])

    @property
    def first_speed(self) -> float:
        """Return the speed at the first sample [rad/s]; 0 where the shaft rests.

        It is not known well, and no parameter: near rest, a shaft that sticks does not depend on it smoothly.
        """
        width = max(6, round(0.02 / self.period))
        begin = np.array(self.positions[:width])
        moves = np.ptp(begin) > 2.5 * self.resolution
        return float(np.polyfit(self.period * np.arange(width), begin, 2)[1]) if moves else 0.0

    @property
    def rest_share(self) -> float:
        """Return the share of the samples from which the shaft moves by at most a count in 10 ms, or in a period."""
        width = max(1, round(0.01 / self.period))
        ways = np.abs(np.subtract(self.positions[width:], self.positions[:-width]))
        return float(np.mean(ways < 1.5 * self.resolution))

    @property
    def top_speed(self) -> float:
        """Return the largest speed, of means over 10 ms or a period [rad/s]."""
        width = max(1, round(0.01 / self.period))
        ways = np.subtract(self.positions[width:], self.positions[:-width])
        return float(np.abs(ways).max(initial=0.0)) / (width * self.period)


class HeldSpan:
    """The motion over a fixed time with constant set-point and direction of friction."""

    def __init__(self, model: ShaftModel, seconds: float) -> None:
        h, a, rate = seconds, model.damping / model.inertia, 1.0 / model.lag
        if abs(rate - a) < 1e-6 * rate:  # the two modes coincide; the solution is continuous there
            rate *= 1.0 + 2e-6
        self.torque_left = math.exp(-h * rate)
        self.speed_left = math.exp(-a * h)
        # (1 − exp(−x))/x and (x − 1 + exp(−x))/x², without the difference of nearly equal numbers.
        x = a * h
        first = -math.expm1(-x) / x if x > 1e-12 else 1.0
        second = (1.0 - first) / x if x > 1e-4 else 0.5 - x / 6.0
        self.way = h * first
        self.speed_of_force = h * first / model.inertia
        self.way_of_force = h * h * second / model.inertia
        self.speed_of_torque = (self.speed_left - self.torque_left) / (rate - a) / model.inertia
        self.way_of_torque = (self.way + math.expm1(-h * rate) / rate) / (rate - a) / model.inertia


span_values = attrgetter("speed_left", "way", "speed_of_force", "speed_of_torque", "way_of_force", "way_of_torque",
                         "torque_left")  # fmt: skip
"""Return what a span does to the speed, to the angle and to the torque, in the order of `_Periods`."""


def predicted_motion(
    model: ShaftModel, record: ShaftRecord, leading: float = LEADING, speed: float | None = None
) -> tuple[Matrix, Matrix]:
    """Return the predicted position [rad] and speed [rad/s] of each sample, shapes (n,).

    With `leading` 0 it is an open integration from the first position. `speed` is the first speed [rad/s]; None: that
    of the record.
    """
    states, _, _ = _path(model, record, leading, record.first_speed if speed is None else speed)
    return states[:, 0], states[:, 1]


def predicted_slopes(models: Sequence[ShaftModel], record: ShaftRecord, leading: float = LEADING) -> Matrix:
    """Return by how much the positions [rad] that further models predict differ from those of the first, shape (n, m).

    To first order in their distance: on the motion of the first model, the differences that another state and another
    model make in one period are taken for all periods side by side, and then added up. Of a record that is mostly at
    rest whole predictions are compared, since a breakaway that comes or not has no slope.
    """
    if record.rest_share > MOSTLY_AT_REST:
        here, *others = (predicted_motion(each, record, leading)[0] for each in models)
        return np.stack(others, axis=1) - here[:, np.newaxis]
    states, parts, is_smooth = _path(models[0], record, leading, record.first_speed)
    first, *further = (_Periods(each, record, leading) for each in models)
    events = np.flatnonzero(is_smooth == 0).tolist()

    def after(periods: _Periods, begins: Matrix) -> Matrix:
        found = periods.smooth_steps(begins, parts)
        for k in events:
            found[k] = periods.step(k, *begins[k].tolist(), int(parts[k]))[:3]
        return found

    ends, small = after(first, states), SMALL_STATE * np.maximum(np.abs(states[:, :3]).max(axis=0), 1e-300)
    turned = [(after(first, states + each) - ends) / each.sum() for each in np.eye(3, 4) * small[:, np.newaxis]]
    by_state, by_model = np.stack(turned, axis=2), np.stack([after(each, states) - ends for each in further], axis=2)
    apart, slopes = np.zeros((3, len(further))), np.empty((len(states), len(further)))
    for out, turning, pushed in zip(slopes, by_state, by_model, strict=True):
        out[:] = apart[0]
        apart = turning.dot(apart)
        apart += pushed
    return slopes


@lru_cache(maxsize=8)  # the slopes of a model follow its prediction, for each of a few records
def _path(model: ShaftModel, record: ShaftRecord, leading: float, speed: float) -> tuple[Matrix, Matrix, Matrix]:
    """Return (angle, speed, torque, side) at each sample, which pieces follow, and whether no event is in them."""
    shaft, step = _Shaft(model, record.positions[0], speed), _Periods(model, record, leading).step
    found, followed = list[tuple[float, ...]](), list[list[int]]()
    angle, torque, side = shaft.angle, shaft.torque, shaft.side
    for k in range(len(record.positions)):
        found.append((angle, speed, torque, side))
        angle, speed, torque, side, *pieces = step(k, angle, speed, torque, side)
        followed.append(pieces)
    parts, is_smooth = np.array(followed).T
    return np.array(found, float), parts, is_smooth


class _Periods:
    """The motion of a shaft from each sample to the next."""

    def __init__(self, model: ShaftModel, record: ShaftRecord, leading: float) -> None:
        self.model, self.record, period = model, record, record.period
        self.acting, spans = acting_torques(model, record)
        known = PARTS.items() if model.stribeck else ()
        self.pieces = [_pieces(model, spans, parts) for parts in (1, *(parts for _, parts in known))]
        """Pieces of a period: undivided, then divided."""
        self.shares = [-math.inf, *(share * model.stribeck_speed for share, _ in known)]
        """Largest changes of the speed for each of them."""
        # Gains of the double pole; of the angle and of the speed.
        self.near, self.pull = 1.0 - math.exp(-2.0 * leading * period), leading * leading * period
        self.step = self._stepping()

    def _stepping(self) -> Callable[..., tuple[float, float, float, int, int, bool]]:
        """Return the function that moves the shaft by one period, through the events in it.

        It takes the number of a sample, angle, speed, torque and side, and which pieces to follow, if they are
        known. It returns these four, which pieces were followed, and whether no event was in them.
        """
        model, period, positions, acting = self.model, self.record.period, self.record.positions, self.acting
        near, pull, shares, all_pieces = self.near, self.pull, self.shares, self.pieces
        waves, stribeck, coulomb, slowness = model.waves, model.stribeck, model.coulomb, 1.0 / model.stribeck_speed
        falling, per_torque, constant = FALLEN * model.stribeck_speed, period / model.inertia, model.load
        shaft, exp, sticking = _Shaft(model, 0.0, 0.0), math.exp, model.coulomb + model.stribeck

        def step(
            k: int, angle: float, speed: float, torque: float, side: int, parts: int | None = None
        ) -> tuple[float, float, float, int, int, bool]:
            error, is_smooth, load, friction = positions[k] - angle, True, constant, coulomb
            angle += near * error
            if side:
                speed += pull * error
            if waves:
                load = model.torque_at(angle + 0.5 * speed * period, speed * period)
            if stribeck:
                if parts is None:
                    # Friction that changes within the period is followed in parts of it: the more, the more it changes.
                    begin, end, parts = torque + load, acting[k + 1] + load, 0
                    if side:
                        change = per_torque * max(abs(begin - coulomb * side), abs(end - coulomb * side))
                    else:
                        change = per_torque * max(abs(begin) - coulomb, abs(end) - coulomb, 0.0)
                    if abs(speed) < falling + change:
                        parts = bisect_left(shares, change)
                friction = coulomb + stribeck * exp(-((speed * slowness) ** 2))
            for (left, way, by_force, by_torque, far, beside, after), seconds, ahead in all_pieces[parts or 0]:
                target = acting[k + ahead]
                behind = torque - target
                if parts:
                    # In the middle of the part, as far as the friction of the part before tells it.
                    middle = speed + 0.5 * by_force * (torque + load - friction * side)
                    friction = coulomb + stribeck * exp(-((middle * slowness) ** 2))
                # What happens to a shaft that slips on, or sticks on; anything else is followed event by event.
                if side:
                    force = target + load - friction * side
                    new = left * speed + force * by_force + behind * by_torque
                    if new * side > 0.0 and speed * side >= 0.0:
                        angle += way * speed + force * far + behind * beside
                        speed, torque = new, target + behind * after
                        continue
                elif abs(target + behind * after + load) <= sticking:
                    torque = target + behind * after
                    continue
                shaft.angle, shaft.speed, shaft.torque, shaft.side = angle, speed, torque, side
                shaft.load, shaft.friction, is_smooth = load, friction, False
                shaft.move(seconds, target)
                angle, speed, torque, side = shaft.angle, shaft.speed, shaft.torque, shaft.side
            return angle, speed, torque, side, parts or 0, is_smooth

        return step

    def smooth_steps(self, begins: Matrix, parts: Matrix) -> Matrix:
        """Return what `step` returns for each sample, as if there were no events: angle, speed and torque, (n, 3)."""
        period, acting, (angle, speed, torque, side) = self.record.period, np.array(self.acting), begins.T
        slips, error = np.abs(side), np.array(self.record.positions) - angle
        angle, speed = angle + self.near * error, speed + slips * self.pull * error
        load = self.model.torque_at(angle + 0.5 * speed * period, speed * period, np)
        friction, ends = self.model.friction_at(speed, np), np.empty((len(begins), 3))
        columns = np.stack(np.broadcast_arrays(angle, speed, torque, side, slips, load, friction))
        for number, pieces in enumerate(self.pieces):
            at = np.flatnonzero(parts == number)
            angle, speed, torque, side, slips, load, friction = columns[:, at]
            for (left, way, by_force, by_torque, far, beside, after), _, ahead in pieces:
                target = acting[at + ahead]
                behind = torque - target
                if number:
                    middle = speed + 0.5 * by_force * (torque + load - friction * side)
                    friction = self.model.friction_at(middle, np)
                force = target + load - friction * side
                angle = angle + slips * (way * speed + force * far + behind * beside)
                speed = slips * (left * speed + force * by_force + behind * by_torque)
                torque = target + behind * after
            ends[at] = np.stack([angle, speed, torque], axis=1)
        return ends


def _pieces(model: ShaftModel, spans: Spans, parts: int) -> list[tuple[tuple[float, ...], float, int]]:
    """Return the pieces of a period, divided into parts: what a part does, its length [s], and set-points ahead."""
    divided = [(seconds / parts, ahead) for seconds, ahead in spans for _ in range(parts)]
    return [(span_values(HeldSpan(model, seconds)), seconds, ahead) for seconds, ahead in divided]


def acting_torques(model: ShaftModel, record: ShaftRecord) -> tuple[list[float], Spans]:
    """Return set-points in the order in which they act, and the spans of a period; zeros stand before the record."""
    whole, part = divmod(model.delay, record.period)
    acting = [*[0.0] * (int(whole) + 1), *record.torques]
    return acting, [(part, 0), (record.period - part, 1)] if part > 1e-12 else [(record.period, 1)]


class _Shaft:
    """State of the shaft, moved event by event."""

    def __init__(self, model: ShaftModel, angle: float, speed: float) -> None:
        self.model, self.angle, self.speed, self.torque = model, angle, speed, 0.0
        self.load, self.friction = model.torque_at(angle), model.friction_at(speed)
        self.breakaway = model.coulomb + model.stribeck
        self.side = self._start()
        """Direction of slipping: 1, −1, or 0 while the shaft sticks."""

    def _start(self) -> int:
        pull = self.torque + self.load
        sticks = not self.speed and abs(pull) <= self.breakaway
        return 0 if sticks else int(math.copysign(1.0, self.speed or pull))

    def _after(self, span: HeldSpan, target: float) -> tuple[float, float]:
        """Return angle and speed of the slipping shaft after a span."""
        force, behind = target + self.load - self.friction * self.side, self.torque - target
        angle = self.angle + span.way * self.speed + force * span.way_of_force + behind * span.way_of_torque
        return angle, span.speed_left * self.speed + force * span.speed_of_force + behind * span.speed_of_torque

    def move(self, seconds: float, target: float) -> None:
        """Move by a span, through the reversals and breakaways inside it."""
        left = seconds
        for _ in range(MOST_EVENTS):
            if self.side and self.speed * self.side < 0.0:
                self.side = -self.side
            until = self._reversal(left, target) if self.side else self._breakaway(left, target)
            self._go(min(until, left), target)
            left -= until
            if left <= 0.0:
                return
            self.speed = 0.0
            # After a breakaway it slips, whatever rounding says.
            self.side = self._start() if self.side else int(math.copysign(1.0, self.torque + self.load))
        self._go(left, target)

    def _go(self, seconds: float, target: float) -> None:
        span = HeldSpan(self.model, seconds)
        if self.side:
            self.angle, self.speed = self._after(span, target)
        self.torque = target + (self.torque - target) * span.torque_left

    def _reversal(self, left: float, target: float) -> float:
        """Return the time until the slipping shaft stops; infinite if it does not within `left` [s]."""
        low, high, at_low = 0.0, left, self.speed * self.side
        at_high = self._after(HeldSpan(self.model, left), target)[1] * self.side
        if at_high > 0.0:
            return math.inf
        still = REST_SHARE * max(at_low, -at_high)
        for number in range(_HALVINGS):
            # By the chord, and now and then by halves, which a curved motion needs.
            chord = at_low > 0.0 and number % 3 < 2
            middle = (low * at_high - high * at_low) / (at_high - at_low) if chord else 0.5 * (low + high)
            at = self._after(HeldSpan(self.model, middle), target)[1] * self.side
            if at > 0.0:
                low, at_low = middle, at
            else:
                high, at_high = middle, at
            if abs(at) <= still:
                return middle
        return high

    def _breakaway(self, left: float, target: float) -> float:
        """Return the time until the torque moves the sticking shaft; infinite if it does not within `left` [s]."""
        if abs(target + self.load) <= self.breakaway:
            return math.inf
        edge = math.copysign(self.breakaway, target + self.load) - self.load
        share = (edge - target) / (self.torque - target) if self.torque != target else 0.0
        after = -self.model.lag * math.log(share) if 0.0 < share < 1.0 else 0.0 if share >= 1.0 else math.inf
        # Past the edge by rounding's worth, so that the shaft slips.
        return after * (1.0 + 1e-12) + 1e-15 if after < left else math.inf

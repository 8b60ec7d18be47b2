"""The shaft of a bench as a sampled system: positions that follow from torques, by exact discretisation.

Theory. Between two instants the motor torque τ, the speed ω and the angle θ follow

    T·τ' = u − τ          J·ω' = τ + g − c·s − b·ω          θ' = ω

with the inertia J, the viscous damping b, the Coulomb friction c against the direction s, a constant load g and the lag
T of the torque loop. The set-point u_k that is computed from sample k acts from t_k + d to t_{k+1} + d. Over a span h
with constant u and s the solution is, with a = b/J, A = exp(−a·h), E = exp(−h/T) and P = (1 − A)/a,

    ω(h) = A·ω + (u + g − c·s)/J·P + (τ − u)/J·(A − E)/(1/T − a)

and θ(h) is its integral. A shaft that comes to rest sticks while |τ + g| ≤ c. The instants of reversal and breakaway
are found inside the span, so friction is in the model and not in the residual.

An open integration drifts: a torque error of a thousandth moves the angle without end. After each sample the model is
therefore led back slowly to the record, by a double pole at `LEADING` [1/s]; what the record shows faster than this is
predicted (Ljung, System Identification, 2nd ed. 1999, 3.2 and 7.2: a predictor of fixed gain). At the true values the
residual is the noise of the encoder, whatever the gain.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix

LEADING = 6.0
"""Double pole that leads the model back to the record [1/s]."""
MOST_EVENTS = 8
"""Reversals and breakaways that are followed in one span."""
_HALVINGS = 40


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


def predicted_positions(
    model: ShaftModel,
    positions: Sequence[float],
    torques: Sequence[float],
    period: float,
    speed: float = 0.0,
    leading: float = LEADING,
) -> Matrix:
    """Return the predicted position of each sample [rad], shape (n,).

    `positions` [rad] are samples at multiples of the `period` [s], `torques` [N·m] the set-points computed from them,
    `speed` [rad/s] the first speed. With `leading` 0 it is an open integration from the first position.
    """
    shaft = _Shaft(model, positions[0], speed)
    whole, part = divmod(model.delay, period)
    pieces = [
        (HeldSpan(model, part), part, int(whole) + 1),
        (HeldSpan(model, period - part), period - part, int(whole)),
    ]
    if not part > 1e-12:
        del pieces[0]
    # Gains of the double pole; of the angle and of the speed.
    near, pull = 1.0 - math.exp(-2.0 * leading * period), leading * leading * period
    out, move, count = [0.0] * len(positions), shaft.move, len(torques)
    for k in range(len(positions)):
        out[k] = shaft.angle
        error = positions[k] - shaft.angle
        shaft.angle += near * error
        if shaft.side:
            shaft.speed += pull * error
        for span, seconds, ago in pieces:
            at = k - ago
            move(span, seconds, torques[at] if 0 <= at < count else 0.0)
    return np.array(out)


class _Shaft:
    """State of the shaft, moved span by span."""

    def __init__(self, model: ShaftModel, angle: float, speed: float) -> None:
        self.model, self.angle, self.speed, self.torque = model, angle, speed, 0.0
        self.side = self._start(speed)
        """Direction of slipping: 1, −1, or 0 while the shaft sticks."""

    def _start(self, speed: float) -> int:
        if speed:
            return 1 if speed > 0.0 else -1
        pull = self.torque + self.model.load
        return 0 if abs(pull) <= self.model.coulomb else 1 if pull > 0.0 else -1

    def move(self, span: HeldSpan, seconds: float, target: float) -> None:
        """Move by a span; its constants are used as they are where nothing happens inside it."""
        side = self.side
        if side:
            before = self.speed
            speed = self._speed_after(span, target)
            if speed * side > 0.0 and before * side >= 0.0:
                self.angle = self._angle_after(span, target)
                self.speed = speed
                self.torque = target + (self.torque - target) * span.torque_left
                return
        elif abs(target + (self.torque - target) * span.torque_left + self.model.load) <= self.model.coulomb:
            self.torque = target + (self.torque - target) * span.torque_left
            return
        self._through_events(seconds, target)

    def _speed_after(self, span: HeldSpan, target: float) -> float:
        force = target + self.model.load - self.model.coulomb * self.side
        return (
            span.speed_left * self.speed + force * span.speed_of_force + (self.torque - target) * span.speed_of_torque
        )

    def _angle_after(self, span: HeldSpan, target: float) -> float:
        force = target + self.model.load - self.model.coulomb * self.side
        return (
            self.angle + span.way * self.speed + force * span.way_of_force + (self.torque - target) * span.way_of_torque
        )

    def _through_events(self, seconds: float, target: float) -> None:
        """Move through the reversals and breakaways inside a span."""
        left = seconds
        for _ in range(MOST_EVENTS):
            if self.side and self.speed * self.side < 0.0:
                self.side = -self.side
            until = self._reversal(left, target) if self.side else self._breakaway(left, target)
            self._go(min(until, left), target)
            left -= until
            if left <= 0.0:
                return
            if self.side:
                self.speed = 0.0
            self.side = self._start(0.0) if self.side else 1 if self.torque + self.model.load > 0.0 else -1
        self._go(left, target)

    def _go(self, seconds: float, target: float) -> None:
        span = HeldSpan(self.model, seconds)
        if self.side:
            self.angle, self.speed = self._angle_after(span, target), self._speed_after(span, target)
        self.torque = target + (self.torque - target) * span.torque_left

    def _reversal(self, left: float, target: float) -> float:
        """Return the time until the slipping shaft stops; infinite if it does not within `left` [s]."""
        if self._speed_after(HeldSpan(self.model, left), target) * self.side > 0.0:
            return math.inf
        low, high = 0.0, left
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            slips = self._speed_after(HeldSpan(self.model, middle), target) * self.side > 0.0
            low, high = (middle, high) if slips else (low, middle)
        return high

    def _breakaway(self, left: float, target: float) -> float:
        """Return the time until the torque moves the sticking shaft; infinite if it does not within `left` [s]."""
        model = self.model
        if abs(target + model.load) <= model.coulomb:
            return math.inf
        edge = math.copysign(model.coulomb, target + model.load) - model.load
        share = (edge - target) / (self.torque - target) if self.torque != target else 0.0
        after = -model.lag * math.log(share) if 0.0 < share < 1.0 else 0.0 if share >= 1.0 else math.inf
        # Past the edge by rounding's worth, so that the shaft slips.
        return after * (1.0 + 1e-12) + 1e-15 if after < left else math.inf

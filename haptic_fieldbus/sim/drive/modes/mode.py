"""The interface of a mode of operation, and the bits of the statusword that belong to the mode.

Theory (CiA 402-2, controlword and statusword). A mode works while the drive is in *operation enabled*: `start` is
called on entering, `act` whenever objects were received, `tick` at the control ticks while `ticking` is True. Its bits
are in `status`. Bit 8 of the controlword, halt, exists in the profile modes and in homing. The cyclic synchronous modes
use no bit of the controlword of their own, so they do not halt.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from haptic_fieldbus.sim.drive.stage import Stage

# Ramps of the profile modes: motions of piecewise constant acceleration, computed in closed form at their start.
# Theory (CiA 402-2, 6086h = 0, linear ramp). A change of speed uses the acceleration where speed grows and the
# deceleration where it falls, and both in turn through zero. Over a distance d from speed v, accelerating and then
# decelerating reaches the peak p with p² = (2·a·b·d + b·v²)/(a + b), acceleration a and deceleration b. If the profile
# velocity is less than p, the motion keeps it between the two. A motion that cannot stop before the target, or that
# moves away from it, is stopped first.

Leg = tuple[float, float]
"""Duration [s] and acceleration [unit/s²]."""


@dataclass(frozen=True)
class RampPiece:
    """A piece of constant acceleration, from `start` [s] on."""

    start: float
    position: float
    velocity: float
    acceleration: float


class RampMotion:
    """Consecutive pieces from time 0 and position 0; the last one has constant speed and no end."""

    def __init__(self, pieces: Sequence[RampPiece]) -> None:
        self._pieces = tuple(pieces)
        self.end = self._pieces[-1].start
        """End of the last change of speed [s]."""
        self._now = 0

    def at(self, time: float) -> tuple[float, float, float]:
        """Return position, velocity and acceleration at `time` [s], which must not be earlier than in the last call."""
        pieces = self._pieces
        # Times only grow, so the search continues from the last piece.
        while self._now + 1 < len(pieces) and pieces[self._now + 1].start <= time:
            self._now += 1
        piece = pieces[self._now]
        h = time - piece.start
        velocity = piece.velocity + piece.acceleration * h
        return piece.position + (piece.velocity + 0.5 * piece.acceleration * h) * h, velocity, piece.acceleration


def to_velocity(velocity: float, target: float, acceleration: float, deceleration: float) -> RampMotion:
    """Return the motion from one speed to another."""
    return _motion(velocity, _speed_legs(velocity, target, acceleration, deceleration), None, target)


def to_distance(velocity: float, distance: float, speed: float, acceleration: float, deceleration: float) -> RampMotion:
    """Return the motion to rest at a distance, not faster than `speed`; with `speed` 0 only to rest."""
    if speed <= 0.0:
        return to_velocity(velocity, 0.0, acceleration, deceleration)
    stop = velocity * abs(velocity) / (2 * deceleration)
    overshoots = velocity * (distance - stop) < 0.0
    legs = _speed_legs(velocity, 0.0, acceleration, deceleration) if overshoots else []
    rest, velocity_then = (distance - stop, 0.0) if overshoots else (distance, abs(velocity))
    direction = math.copysign(1.0, rest)
    legs += [(time, direction * a) for time, a in _way(velocity_then, abs(rest), speed, acceleration, deceleration)]
    return _motion(velocity, legs, distance, 0.0)


def _way(v: float, distance: float, speed: float, a: float, b: float) -> list[Leg]:
    """Return the legs to rest over a distance ≥ v²/2b, with all quantities counted forward."""
    # Faster than allowed: slow down to `speed`, keep it, then stop.
    if v > speed:
        return [((v - speed) / b, -b), ((distance - v * v / (2 * b)) / speed, 0.0), (speed / b, -b)]
    peak = min(speed, math.sqrt((2 * a * b * distance + b * v * v) / (a + b)))
    cruise = distance - (peak * peak - v * v) / (2 * a) - peak * peak / (2 * b)
    return [((peak - v) / a, a), (cruise / peak if peak > 0.0 else 0.0, 0.0), (peak / b, -b)]


def _speed_legs(velocity: float, target: float, acceleration: float, deceleration: float) -> list[Leg]:
    if velocity * target < 0.0:
        first = _speed_legs(velocity, 0.0, acceleration, deceleration)
        return [*first, *_speed_legs(0.0, target, acceleration, deceleration)]
    rate = acceleration if abs(target) > abs(velocity) else deceleration
    change = target - velocity
    return [(abs(change) / rate, math.copysign(rate, change))]


def _motion(velocity: float, legs: Iterable[Leg], position: float | None, target: float) -> RampMotion:
    """Return the motion of consecutive legs, whose end is placed exactly at `position` (if given) and `target`."""
    time = at = 0.0
    pieces = []
    for duration, acceleration in legs:
        if duration > 0.0:
            pieces.append(RampPiece(time, at, velocity, acceleration))
            at += (velocity + 0.5 * acceleration * duration) * duration
            velocity += acceleration * duration
            time += duration
    # The sums of the legs are off by rounding; the end must be the target itself.
    return RampMotion((*pieces, RampPiece(time, at if position is None else position, target, 0.0)))


TARGET_REACHED, INTERNAL_LIMIT, BIT_12, FOLLOWING_ERROR = 0x0400, 0x0800, 0x1000, 0x2000
"""Bits 10, 11, 12 and 13 of the statusword.

Bit 12 is *drive follows the command value*, *set-point acknowledge*, *speed* or *homing attained*, by the mode. Bit 13
is *homing error* in homing mode.
"""
FOLLOWS_COMMAND = BIT_12
NEW_SET_POINT = 0x0010
"""Bit 4 of the controlword, also *homing operation start*."""
_MS = 1_000_000


class Mode:
    """A mode of operation; this base class is mode 0, no mode assigned, without torque."""

    halts = False
    """Whether bit 8 of the controlword halts the mode."""
    standing = TARGET_REACHED
    """Bits that show standstill while the mode is halted."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.status = 0
        self.ticking = False

    def start(self, t_ns: int) -> None:
        """Begin, or continue after a halt, from the present motion."""
        self.act(t_ns)

    def act(self, t_ns: int) -> None:
        """Act on received objects."""
        self.stage.torque(0.0, t_ns)

    def tick(self, t_ns: int) -> None:
        """Run one control tick."""

    def leave(self) -> None:
        """End, because another mode follows or *operation enabled* is left."""

    def act_disabled(self, t_ns: int) -> None:
        """Act on objects received outside *operation enabled*."""


class ConditionTimer:
    """Duration of a condition, for the windows and time-outs of the standard (6066h, 6068h, …)."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def restart(self) -> None:
        """Start anew, as if the condition had just failed."""
        self._since_ns = None

    def __call__(self, condition: bool, t_ns: int, time_ms: int) -> bool:
        """Note the condition at `t_ns`; return whether it has held for `time_ms` without interruption."""
        if not condition:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = t_ns
        return t_ns - self._since_ns >= time_ms * _MS

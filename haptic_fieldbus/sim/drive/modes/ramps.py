"""Ramps of the profile modes: motions of piecewise constant acceleration, computed in closed form at their start.

Theory (CiA 402-2, 6086h = 0, linear ramp). A change of speed uses the acceleration where speed grows and the
deceleration where it falls, and both in turn through zero. Over a distance d from speed v, accelerating and then
decelerating reaches the peak p with p² = (2·a·b·d + b·v²)/(a + b), acceleration a and deceleration b. If the profile
velocity is less than p, the motion keeps it between the two. A motion that cannot stop before the target, or that moves
away from it, is stopped first.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

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
    legs: list[Leg] = []
    stop = velocity * abs(velocity) / (2 * deceleration)
    rest = distance
    if velocity * (distance - stop) < 0.0:
        legs += _speed_legs(velocity, 0.0, acceleration, deceleration)
        rest, velocity_then = distance - stop, 0.0
    else:
        velocity_then = abs(velocity)
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

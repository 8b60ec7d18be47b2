"""The position modes: profile position (1) and cyclic synchronous position (8).

Theory (CiA 402-2). Profile position: a rising edge of bit 4 hands over a set-point: 607Ah with 6081h, 6083h and 6084h;
with bit 6, relative to the previous target (60F2h = 0). Bit 12 of the statusword, *set-point acknowledge*, answers it.
With bit 5 the set-point replaces the present positioning at once; otherwise it is executed after the present
positioning. One set-point can wait. Bit 12 falls when bit 4 has fallen and no set-point waits. While one waits, a
further edge is a set-point only with bit 5. Bit 10 is set when |target − actual| has been within 6067h for 6068h. Bit
9, *change on set-point*, is optional and ignored.

Cyclic: every new target (607Ah + 60B0h) is reached linearly within the interpolation time 60C2h, so the demand lags by
that time; 60B1h and 60B2h feed speed and torque forward. Without 60B1h a speed v causes a following error v/k, with the
gain k of the position loop (see `stage`). The value of 607Ah on entering the mode is a target like any other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.sim.drive.modes import mode
from haptic_fieldbus.sim.drive.objects import NO_LIMIT, Objects
from haptic_fieldbus.sim.drive.stage import Stage
from haptic_fieldbus.sim.drive.units import HALF, WRAP, fit

# The following error, in the modes that follow a position demand.
#
# Theory (CiA 402-2, 6065h, 6066h, 60F4h): a following error occurs when the difference of position demand and actual
# value has been outside the window for the time-out. Bit 13 of the statusword shows it until the difference is inside
# the window again. A window of FFFF FFFFh switches the control off. The standard leaves further reactions to the
# manufacturer: here a fault, if the settings ask for it.


class FollowingError:
    """Monitoring and display of the following error; `failed` is called with the time when one occurs."""

    def __init__(self, stage: Stage, objects: Objects, failed: Callable[[int], None]) -> None:
        self._stage, self._failed = stage, failed
        self._demand, self._error = objects.row(0x6062), objects.row(0x60F4)
        self._window, self._time_out = objects.row(0x6065), objects.row(0x6066)
        self._outside = mode.ConditionTimer()
        self._occurred = False

    def restart(self) -> None:
        """Start with no error, as when the demand is the actual value."""
        self._outside.restart()
        self._occurred = False

    def check(self, angle: float, t_ns: int) -> int:
        """Show demand [rad] and error at a tick; return the bit of the statusword, 0 without a following error."""
        unit = self._stage.units.angle
        error = fit((angle - self._stage.angle()) / unit)
        self._demand.value = wrap(angle / unit)
        self._error.value = error
        window = self._window.value
        outside = window != NO_LIMIT and abs(error) > window
        occurred = self._outside(outside, t_ns, self._time_out.value)
        # Reported once for each occurrence, at its start.
        if occurred and not self._occurred:
            self._failed(t_ns)
        self._occurred = occurred
        return mode.FOLLOWING_ERROR if occurred else 0


def wrap(position: float) -> int:
    """Return a position rounded and wrapped to 32 bits."""
    return (math.floor(position + 0.5) + HALF) % WRAP - HALF


def nearest_turn(target: float, position: float) -> float:
    """Return the position that equals `target` modulo 2³² and is nearest to `position`, which has no end."""
    return position + (target - position + HALF) % WRAP - HALF


ACKNOWLEDGE = mode.BIT_12
_IMMEDIATELY, _RELATIVE = 0x0020, 0x0040


@dataclass(frozen=True)
class SetPoint:
    """A set-point as it was handed over: position units, rad/s, rad/s²."""

    target: int
    relative: bool
    speed: float
    acceleration: float
    deceleration: float


class ProfilePosition(mode.Mode):
    """Profile position mode."""

    halts = True

    def __init__(self, stage: Stage, objects: Objects, failed: Callable[[int], None]) -> None:
        super().__init__(stage)
        self.ticking = True
        row = objects.row
        self._controlword, self._position = objects.controlword, row(0x607A)
        self._speed, self._acceleration, self._deceleration = row(0x6081), row(0x6083), row(0x6084)
        self._window, self._window_time = row(0x6067), row(0x6068)
        self._following = FollowingError(stage, objects, failed)
        self._reached = mode.ConditionTimer()
        self._active: SetPoint | None = None
        self._waiting: SetPoint | None = None
        self._edge = False
        self._target: float | None = None
        self._begin(mode.to_velocity(0.0, 0.0, 1.0, 1.0), 0.0, 0)

    def start(self, t_ns: int) -> None:
        """Come to rest; after a halt, execute the halted set-point from the present position."""
        stage, halted = self.stage, self._active
        velocity, ramp = stage.servo.plant.velocity, stage.ramp(self._deceleration)
        self._begin(mode.to_velocity(velocity, 0.0, ramp, ramp), stage.angle(), t_ns)
        self._following.restart()
        if halted is not None and self._target is not None:
            self._go(halted, self._target, t_ns)
        self.act(t_ns)

    def leave(self) -> None:
        """Discard the present and the waiting set-point on leaving the mode or *operation enabled*."""
        self._active = self._waiting = self._target = None
        self._edge = False
        self.status = 0

    def act(self, t_ns: int) -> None:
        """Run the handshake of bits 4 and 12."""
        word = self._controlword.value
        edge = bool(word & mode.NEW_SET_POINT)
        if edge and not self._edge:
            self._hand_over(word, t_ns)
        elif not edge and self._waiting is None:
            self.status &= ~ACKNOWLEDGE
        self._edge = edge

    def _hand_over(self, word: int, t_ns: int) -> None:
        ramp = self.stage.ramp
        point = SetPoint(
            self._position.value, bool(word & _RELATIVE),
            self._speed.value * abs(self.stage.units.speed), ramp(self._acceleration), ramp(self._deceleration),
        )  # fmt: skip
        if word & _IMMEDIATELY or self._active is None:
            self._waiting = None
            self._go(point, self._goal(point), t_ns)
        elif self._waiting is None:
            self._waiting = point
        else:
            return
        self.status |= ACKNOWLEDGE

    def _goal(self, point: SetPoint) -> float:
        """Return the target angle of a set-point [rad]."""
        unit = self.stage.units.angle
        if point.relative:
            return (self._target if self._target is not None else self.stage.angle()) + point.target * unit
        # Positions wrap at 32 bits; the shorter way round is taken.
        return nearest_turn(point.target, self.stage.angle() / unit) * unit

    def _go(self, point: SetPoint, goal: float, t_ns: int) -> None:
        angle, velocity, _ = self._motion.at((t_ns - self._begin_ns) * 1e-9)
        angle += self._origin
        speed = self.stage.slow(point.speed)
        motion = mode.to_distance(velocity, goal - angle, speed, point.acceleration, point.deceleration)
        self._begin(motion, angle, t_ns)
        self._limited = speed != point.speed
        self._active, self._target = point, goal

    def _begin(self, motion: mode.RampMotion, origin: float, t_ns: int) -> None:
        self._motion, self._origin, self._begin_ns = motion, origin, t_ns
        self._limited = False
        self._reached.restart()
        self.status &= ~mode.TARGET_REACHED

    def tick(self, t_ns: int) -> None:
        time = (t_ns - self._begin_ns) * 1e-9
        angle, velocity, acceleration = self._motion.at(time)
        angle += self._origin
        stage = self.stage
        stage.position(angle, velocity, acceleration, t_ns)
        error = self._following.check(angle, t_ns)
        window, left = self._window.value, abs(round((angle - stage.angle()) / stage.units.angle))
        near = window == NO_LIMIT or left <= window
        reached = time >= self._motion.end and self._reached(near, t_ns, self._window_time.value)
        limited = stage.limited or self._limited
        self.status = (
            self.status & ACKNOWLEDGE | error
            | (mode.TARGET_REACHED if reached else 0) | (mode.INTERNAL_LIMIT if limited else 0)
        )  # fmt: skip
        if reached:
            self._complete(t_ns)

    def _complete(self, t_ns: int) -> None:
        """Finish the positioning and start the waiting set-point."""
        point, self._active, self._waiting = self._waiting, None, None
        if point is not None:
            self._go(point, self._goal(point), t_ns)
            # Bit 4 has fallen already: the acknowledgement of the waiting set-point ends now.
            if not self._edge:
                self.status &= ~ACKNOWLEDGE


class CyclicPosition(mode.Mode):
    """Cyclic synchronous position mode."""

    def __init__(self, stage: Stage, objects: Objects, failed: Callable[[int], None]) -> None:
        super().__init__(stage)
        self.ticking = True
        row = objects.row
        self._target, self._offset = row(0x607A), row(0x60B0)
        self._velocity_offset, self._torque_offset = row(0x60B1), row(0x60B2)
        self._time, self._exponent = row(0x60C2, 1), row(0x60C2, 2)
        self._following = FollowingError(stage, objects, failed)
        self._seen: int | None = None
        self._from = self._to = 0.0
        self._begin_ns, self._span_ns = 0, 1

    def start(self, t_ns: int) -> None:
        self._from = self._to = self.stage.angle()
        # None: the target on entering is taken even when it is the one seen before.
        self._seen, self._begin_ns = None, t_ns
        self._following.restart()
        self.status = mode.FOLLOWS_COMMAND
        self.act(t_ns)

    def act(self, t_ns: int) -> None:
        wanted = self._target.value + self._offset.value
        if wanted == self._seen:
            return
        unit = self.stage.units.angle
        self._from = self._demand(t_ns)
        self._to = nearest_turn(wanted, self._from / unit) * unit
        self._seen, self._begin_ns = wanted, t_ns
        # 60C2h: a number and its power of ten, in seconds.
        self._span_ns = max(1, round(self._time.value * 10.0 ** (self._exponent.value + 9)))

    def _demand(self, t_ns: int) -> float:
        share = min(1.0, (t_ns - self._begin_ns) / self._span_ns)
        return self._from + share * (self._to - self._from)

    def tick(self, t_ns: int) -> None:
        stage = self.stage
        angle = self._demand(t_ns)
        forward, offset = self._velocity_offset.value * stage.units.speed, self._torque_offset.value * stage.permille
        stage.position(angle, forward, 0.0, t_ns, offset)
        error = self._following.check(angle, t_ns)
        self.status = mode.FOLLOWS_COMMAND | error | (mode.INTERNAL_LIMIT if stage.limited else 0)

"""Homing mode (6), by the methods that take the current position: 37, and 35, which 37 has replaced.

Theory (CiA 402-2, homing mode). A rising edge of bit 4 starts homing; these methods finish at once. The zero position
is the home position plus the home offset 607Ch, so the position actual value here becomes −607Ch, to the nearest count
(some drives show +607Ch). Bits 13, 12, 10: 001 not started or interrupted, 011 completed. Method 37 does not need
*operation enabled*; outside that state its bits do not show the homing. The speeds 6099h are not used. While enabled,
the mode holds the motor at rest by the speed loop.
"""

from haptic_fieldbus.sim.drive.modes.mode import (
    BIT_12,
    INTERNAL_LIMIT,
    NEW_SET_POINT,
    TARGET_REACHED,
    Mode,
    to_velocity,
)
from haptic_fieldbus.sim.drive.objects import CURRENT_POSITION, Objects
from haptic_fieldbus.sim.drive.stage import Stage

ATTAINED = BIT_12


class Homing(Mode):
    """Homing on the current position."""

    halts = True

    def __init__(self, stage: Stage, objects: Objects) -> None:
        super().__init__(stage)
        self.ticking = True
        self._controlword, self._method, self._offset = objects.controlword, objects.row(0x6098), objects.row(0x607C)
        self._deceleration = objects.row(0x6084)
        self._edge = False
        # At rest until `start` replaces it; the rates must not be 0.
        self._motion, self._begin_ns = to_velocity(0.0, 0.0, 1.0, 1.0), 0
        self.status = TARGET_REACHED

    def start(self, t_ns: int) -> None:
        ramp = self.stage.ramp(self._deceleration)
        self._motion = to_velocity(self.stage.servo.plant.velocity, 0.0, ramp, ramp)
        self._begin_ns = t_ns
        self.act(t_ns)

    def leave(self) -> None:
        """Forget a completed homing."""
        self._edge = False
        self.status = TARGET_REACHED

    def act(self, t_ns: int) -> None:
        edge = bool(self._controlword.value & NEW_SET_POINT)
        if edge and not self._edge:
            self._home(t_ns)
            self.status |= TARGET_REACHED | ATTAINED
        self._edge = edge

    def act_disabled(self, t_ns: int) -> None:
        edge = bool(self._controlword.value & NEW_SET_POINT)
        if edge and not self._edge and self._method.value == CURRENT_POSITION[-1]:
            self._home(t_ns)
        self._edge = edge

    def _home(self, t_ns: int) -> None:
        servo = self.stage.servo
        servo.advance(t_ns)
        servo.jump(self.stage.units.counts(-self._offset.value) - servo.counts())

    def tick(self, t_ns: int) -> None:
        _, velocity, acceleration = self._motion.at((t_ns - self._begin_ns) * 1e-9)
        stage = self.stage
        stage.speed(velocity, acceleration, t_ns)
        self.status = self.status & ~INTERNAL_LIMIT | (INTERNAL_LIMIT if stage.limited else 0)

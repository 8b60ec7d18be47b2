"""The velocity modes: profile velocity (3) and cyclic synchronous velocity (9).

Theory (CiA 402-2). Profile velocity: the demand goes to 60FFh, limited by 607Fh and 6080h, with 6083h where speed grows
and 6084h where it falls. Bit 10 is set when |target − actual| has been within 606Dh for 606Eh. Bit 12 (*speed*:
standstill) falls when the actual speed has exceeded 606Fh for 6070h, and rises as soon as it is below.

Cyclic: the demand is 60FFh + 60B1h at once. A step of the demand is followed as a first-order lag of time constant 2/a
(see `stage`), which the speed loop can follow without overshoot; 60B2h is added to the torque.
"""

import math

from haptic_fieldbus.sim.drive.modes.mode import (
    BIT_12,
    FOLLOWS_COMMAND,
    INTERNAL_LIMIT,
    TARGET_REACHED,
    ConditionTimer,
    Mode,
    to_velocity,
)
from haptic_fieldbus.sim.drive.objects import Objects
from haptic_fieldbus.sim.drive.stage import Stage

STANDSTILL = BIT_12


class ProfileVelocity(Mode):
    """Profile velocity mode."""

    halts = True
    standing = TARGET_REACHED | STANDSTILL

    def __init__(self, stage: Stage, objects: Objects) -> None:
        super().__init__(stage)
        self.ticking = True
        row = objects.row
        self._target, self._demand = row(0x60FF), row(0x606B)
        self._acceleration, self._deceleration = row(0x6083), row(0x6084)
        self._window, self._window_time = row(0x606D), row(0x606E)
        self._threshold, self._threshold_time = row(0x606F), row(0x6070)
        self._reached, self._moving = ConditionTimer(), ConditionTimer()
        self._planned: tuple[float, float, float] | None = None
        self._start(0.0, 0)

    def start(self, t_ns: int) -> None:
        self._start(self.stage.servo.plant.velocity, t_ns)
        self.act(t_ns)

    def _start(self, velocity: float, t_ns: int) -> None:
        self._motion, self._begin_ns = to_velocity(velocity, velocity, 1.0, 1.0), t_ns
        self._planned = None
        self._reached.restart()
        self._moving.restart()
        self.status = 0

    def act(self, t_ns: int) -> None:
        stage = self.stage
        goal = stage.slow(self._target.value * stage.units.speed)
        plan = (goal, stage.ramp(self._acceleration), stage.ramp(self._deceleration))
        if plan != self._planned:
            # A new plan continues from the present demand, not from the actual speed, so that the demand has no step.
            _, velocity, _ = self._motion.at((t_ns - self._begin_ns) * 1e-9)
            self._motion, self._begin_ns, self._planned = to_velocity(velocity, *plan), t_ns, plan
            self._reached.restart()
            self.status &= ~TARGET_REACHED

    def tick(self, t_ns: int) -> None:
        stage = self.stage
        _, velocity, acceleration = self._motion.at((t_ns - self._begin_ns) * 1e-9)
        stage.speed(velocity, acceleration, t_ns)
        actual = stage.units.velocity(stage.servo.plant.velocity)
        self._demand.value = stage.units.velocity(velocity)
        near = abs(self._target.value - actual) <= self._window.value
        reached = self._reached(near, t_ns, self._window_time.value)
        moving = self._moving(abs(actual) > self._threshold.value, t_ns, self._threshold_time.value)
        limited = stage.limited or stage.slow(wanted := self._target.value * stage.units.speed) != wanted
        self.status = (
            (TARGET_REACHED if reached else 0) | (0 if moving else STANDSTILL) | (INTERNAL_LIMIT if limited else 0)
        )


class CyclicVelocity(Mode):
    """Cyclic synchronous velocity mode."""

    def __init__(self, stage: Stage, objects: Objects) -> None:
        super().__init__(stage)
        self.ticking = True
        row = objects.row
        self._target, self._offset, self._torque_offset = row(0x60FF), row(0x60B1), row(0x60B2)
        self._demand = row(0x606B)
        self._reference = 0.0
        self._t_ns = 0

    def start(self, t_ns: int) -> None:
        self._reference, self._t_ns = self.stage.servo.plant.velocity, t_ns
        self.status = FOLLOWS_COMMAND

    def act(self, t_ns: int) -> None:
        """Do nothing: the next tick reads the target."""

    def tick(self, t_ns: int) -> None:
        stage = self.stage
        wanted = (self._target.value + self._offset.value) * stage.units.speed
        goal = stage.slow(wanted)
        rate = 0.5 * stage.gains.bandwidth
        # The exact solution of the lag over the time since the last tick.
        self._reference = goal - (goal - self._reference) * math.exp(-rate * (t_ns - self._t_ns) * 1e-9)
        self._t_ns = t_ns
        offset = self._torque_offset.value * stage.permille
        stage.speed(self._reference, rate * (goal - self._reference), t_ns, offset)
        self._demand.value = stage.units.velocity(goal)
        limited = stage.limited or goal != wanted
        self.status = FOLLOWS_COMMAND | (INTERNAL_LIMIT if limited else 0)

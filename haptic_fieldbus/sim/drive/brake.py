"""Slowing down by the motor, for quick stop, halt, fault reaction, *shutdown* and *disable operation*.

Theory (CiA 402-2, 605Ah to 605Eh). In every mode, the demand of the speed loop goes to zero by the slow down ramp 6084h
or the quick stop ramp 6085h, or at once: then torque goes to its limit, *slow down on the current limit*. The model has
no voltage limit; a stop on it is one on the current limit. The shaft counts as at rest when it is slower than `REST`
after the ramp. A hand that keeps pushing cannot prevent the end of a stop that ends: it ends at the latest `LONGEST_NS`
after the ramp. Until another command takes over, the motor is held at rest.
"""

from enum import Enum

from haptic_fieldbus.sim.drive.dictionary import Entry
from haptic_fieldbus.sim.drive.modes.ramps import to_velocity
from haptic_fieldbus.sim.drive.stage import NO_RAMP, Stage

REST = 0.2
"""Greatest speed of a shaft at rest [rad/s]."""
LONGEST_NS = 1_000_000_000
"""Longest time from the end of the ramp to the end of a stop."""


class Way(Enum):
    """How to slow down; the value is the option code of 605Ah to 605Eh."""

    SLOW_DOWN_RAMP = 1
    QUICK_STOP_RAMP = 2
    CURRENT_LIMIT = 3
    VOLTAGE_LIMIT = 4


def way_of(code: int) -> Way:
    """Return the way of an option code from 1 to 8; the quick stops that stay in their state have codes four higher."""
    return Way((code - 1) % len(Way) + 1)


class Brake:
    """One slowing down, which begins at `begin_ns` with this ramp; None: at once."""

    def __init__(self, stage: Stage, ramp: Entry | None, begin_ns: int) -> None:
        self._stage = stage
        self._begin_ns = begin_ns
        rate = stage.ramp(ramp) if ramp is not None else NO_RAMP
        self._motion = to_velocity(stage.servo.plant.velocity, 0.0, rate, rate)
        self._end_ns = begin_ns + round(self._motion.end * 1e9)

    def tick(self, t_ns: int) -> None:
        """Run the speed loop for one control tick."""
        _, velocity, acceleration = self._motion.at((t_ns - self._begin_ns) * 1e-9)
        self._stage.speed(velocity, acceleration, t_ns)

    def at_rest(self, t_ns: int) -> bool:
        """Return whether the ramp is over and the shaft at rest."""
        return t_ns >= self._end_ns and abs(self._stage.servo.plant.velocity) < REST

    def finished(self, t_ns: int) -> bool:
        """Return whether the shaft is at rest, or `LONGEST_NS` have passed since the ramp."""
        return self.at_rest(t_ns) or t_ns >= self._end_ns + LONGEST_NS

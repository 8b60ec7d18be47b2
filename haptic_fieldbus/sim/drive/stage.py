"""The power stage as the modes of operation see it: torque within the limits, speed and position loops behind it.

Theory. Torque: what is asked for is bounded by the smallest of 6072h, 6073h and 60E0h (60E1h downwards); the rated
current makes the rated torque, so a current limit [‰] is a torque limit [‰].
Speed: a PI controller on the true speed at the control ticks, with feed-forward of inertia and damping. With gain J·a
and integral gain J·a²/4 the shaft J·ω' = τ has a double pole at −a/2; a is a quarter of 1/(tick + lag of the torque
loop), so hold and lag cost little of that damping, whatever the rig. The integral stands still while torque is limited.
Position: a P controller of a/8 around it, poles at −0.12·a and (−0.44 ± 0.25j)·a. A constant load leaves no error. The
standard prescribes none of this (60F6h, 60F9h and 60FBh are manufacturer-specific).
"""

import math
from dataclasses import dataclass

from haptic_fieldbus.sim.drive.dictionary import Entry
from haptic_fieldbus.sim.drive.object_table import NO_LIMIT
from haptic_fieldbus.sim.drive.objects import PERMILLE, Objects
from haptic_fieldbus.sim.drive.servo import Servo
from haptic_fieldbus.sim.drive.units import Units

_LAGS = 4
_HIGHEST_PERMILLE = 32767
"""6074h is an INTEGER16."""
_RPM = 2 * math.pi / 60
NO_RAMP = 1e12
"""[rad/s²]; what a ramp of 0 stands for."""


@dataclass(frozen=True)
class Gains:
    """Of the loops at the motor shaft; inertia [kg·m²], damping [N·m·s/rad], bandwidth a [1/s]."""

    inertia: float
    damping: float
    bandwidth: float

    @property
    def position(self) -> float:
        """[1/s]"""
        return self.bandwidth / 8


def gains(inertia: float, damping: float, lag: float, tick: float) -> Gains:
    """Well damped for any rig; torque loop's lag and control tick [s]."""
    return Gains(inertia, damping, 1 / (_LAGS * (tick + lag)))


class Stage:
    """Between a mode and the servo; everything at the motor shaft, SI."""

    def __init__(self, servo: Servo, objects: Objects, units: Units, loop: Gains) -> None:
        self.servo = servo
        self.units = units
        self.gains = loop
        self.limited = False
        """Whether torque or speed is less than was asked for."""
        self._limits: tuple[Entry, Entry, Entry, Entry] = objects.torque_limits
        self._seen: tuple[int, ...] = ()
        self._low = self._high = 0.0
        self._permille = objects.rated_torque * PERMILLE
        self._demand = objects.row(0x6074)
        self._max_motor_speed = objects.row(0x6080)
        self._max_profile_velocity = objects.row(0x607F)
        self._looping = False
        self._integral = 0.0
        self._t_ns = 0
        self._position, self._velocity = objects.position, objects.velocity
        self._actual, self._current = objects.actual_torque, objects.row(0x6078)
        self._per_step, self._per_permille = 1 / objects.torque_unit, 1 / self._permille

    # Torque.

    @property
    def permille(self) -> float:
        """One ‰ of rated torque [N·m]."""
        return self._permille

    @property
    def commanded(self) -> float:
        """The torque that was last let through [N·m]."""
        return self._demand.value * self._permille

    def limit(self, torque: float) -> float:
        """What of a torque is allowed [N·m]."""
        first, second, third, fourth = self._limits
        seen = (first.value, second.value, third.value, fourth.value)
        if seen != self._seen:
            self._seen = seen
            common = min(first.value, second.value, _HIGHEST_PERMILLE)
            self._high = min(common, third.value) * self._permille
            self._low = -min(common, fourth.value) * self._permille
        return self._high if torque > self._high else self._low if torque < self._low else torque

    def torque(self, wanted: float, t_ns: int) -> None:
        """Hand a torque to the servo, limited [N·m]."""
        torque = self.limit(wanted)
        self.limited = torque != wanted
        self._looping = False
        self._demand.value = round(torque * self._per_permille)
        self.servo.command(torque, t_ns)

    def cut(self, t_ns: int) -> None:
        """No torque at once."""
        self.limited = self._looping = False
        self._demand.value = 0
        self.servo.cut(t_ns)

    def show(self) -> None:
        """The actual values of position, velocity, torque and current."""
        servo, units = self.servo, self.units
        counts = servo.counts()
        self._position.value = counts if units.plain else units.position(counts)
        self._velocity.value = units.velocity(servo.plant.velocity)
        torque, actual = self.servo.plant.torque, self._actual
        value = round(torque * self._per_step)
        actual.value = value if actual.low <= value <= actual.high else actual.low if value < 0 else actual.high
        permille = round(torque * self._per_permille)
        self._current.value = max(-_HIGHEST_PERMILLE, min(_HIGHEST_PERMILLE, permille))

    # Loops.

    def speed(self, reference: float, acceleration: float, t_ns: int, offset: float = 0.0) -> None:
        """One tick of the speed loop; reference [rad/s], its slope, a torque on top [N·m].

        After torque of another source it begins anew.
        """
        if not self._looping:
            self._integral, self._t_ns = 0.0, t_ns
        gains, error = self.gains, reference - self.servo.plant.velocity
        gain = gains.inertia * gains.bandwidth
        wanted = gain * error + self._integral + gains.inertia * acceleration + gains.damping * reference + offset
        self.torque(wanted, t_ns)
        self._looping = True
        if not self.limited or wanted * error < 0.0:
            self._integral += 0.25 * gain * gains.bandwidth * error * (t_ns - self._t_ns) * 1e-9
        self._t_ns = t_ns

    def position(self, angle: float, velocity: float, acceleration: float, t_ns: int, offset: float = 0.0) -> None:
        """One tick of the position loop; angle [rad] as the encoder counts it, what feeds forward, torque on top."""
        wanted = velocity + self.gains.position * (angle - self.angle())
        reference = self.slow(wanted)
        self.speed(reference, acceleration, t_ns, offset)
        self.limited |= reference != wanted

    def angle(self) -> float:
        """The shaft's angle as the encoder has counted it, not rounded [rad]."""
        return self.servo.fine_counts() / self.units.counts_per_radian

    # Limits and ramps.

    def slow(self, velocity: float) -> float:
        """What of a speed is allowed [rad/s]."""
        limit = self.speed_limit()
        return max(-limit, min(limit, velocity))

    def speed_limit(self) -> float:
        """The smaller one of 607Fh and 6080h [rad/s]."""
        motor, profile = self._max_motor_speed.value, self._max_profile_velocity.value
        allowed = motor * _RPM if motor != NO_LIMIT else math.inf
        return min(allowed, profile * abs(self.units.speed)) if profile != NO_LIMIT else allowed

    def ramp(self, entry: Entry) -> float:
        """An acceleration of the object dictionary [rad/s²]."""
        return entry.value * abs(self.units.angle) if entry.value else NO_RAMP

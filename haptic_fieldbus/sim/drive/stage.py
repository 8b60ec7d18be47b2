"""The power stage for the modes of operation: torque within the limits, with a speed and a position loop.

Theory. Torque: the demand is bounded by the smallest of 6072h, 6073h and 60E0h (60E1h downwards). Rated current makes
rated torque, so a current limit [‰] is a torque limit [‰]. A 60E1h that may be negative is the lowest torque itself.

Speed: a PI controller on the true speed at the control ticks, with feed-forward of inertia and damping. With gain J·a
and integral gain J·a²/4 the shaft J·ω' = τ has a double pole at −a/2. a is a quarter of 1/(tick + lag of the torque
loop), so hold and lag reduce this damping little, for any rig. The integral does not wind up while torque is limited.

Position: a P controller of gain a/8 around it, with poles at −0.12·a and (−0.44 ± 0.25j)·a. A constant load leaves no
error. The standard prescribes none of this (60F6h, 60F9h and 60FBh are manufacturer-specific).
"""

import math
from dataclasses import dataclass

from haptic_fieldbus.sim.drive.dictionary import Entry
from haptic_fieldbus.sim.drive.objects import NO_LIMIT, Objects
from haptic_fieldbus.sim.drive.servo import Servo
from haptic_fieldbus.sim.drive.units import HIGHEST, LOWEST, Units
from haptic_fieldbus.sim.mechanics.motion import SPEED, TORQUE

LAGS = 4
"""Ratio of the time constant 1/a of the loops to hold and lag (see above), well damped for any rig."""
_HIGHEST_PERMILLE = 32767
"""Largest value of 6074h, an INTEGER16."""
_RPM = 2 * math.pi / 60
NO_RAMP = 1e12
"""Acceleration for a ramp of 0, which means no limit [rad/s²]."""


@dataclass(frozen=True)
class Gains:
    """Gains of the loops at the motor shaft: inertia [kg·m²], damping [N·m·s/rad], bandwidth a [1/s]."""

    inertia: float
    damping: float
    bandwidth: float

    @property
    def position(self) -> float:
        """Return the gain of the position loop [1/s]."""
        return self.bandwidth / 8


class Stage:
    """The interface between a mode and the servo; all quantities at the motor shaft, SI."""

    def __init__(self, servo: Servo, objects: Objects, units: Units, loop: Gains) -> None:
        self.servo = servo
        self.units = units
        self.gains = loop
        self.limited = False
        """Whether the last torque or speed was less than requested."""
        row = objects.row
        self._limits = row(0x6072), row(0x6073), row(0x60E0), row(0x60E1)
        self._seen: tuple[int, ...] = ()
        self._low = self._high = 0.0
        self.permille = objects.permille
        """One ‰ of rated torque, or of the torque at rated current [N·m]."""
        self._demand_unit = objects.demand_unit
        self._demand = row(0x6074)
        self._max_motor_speed, self._max_profile_velocity = row(0x6080), row(0x607F)
        self._looping = False
        self._integral = 0.0
        self._t_ns = 0
        self._position, self._velocity = objects.position, objects.velocity
        self._actual, self._current = objects.actual_torque, row(0x6078)
        self._per_step, self._per_permille = 1 / objects.actual_unit, 1 / self.permille

    # Torque.

    @property
    def commanded(self) -> float:
        """Return the last permitted torque [N·m], to the nearest step of the torque demand."""
        return self._demand.value * self._demand_unit

    def limit(self, torque: float) -> float:
        """Return the permitted part of a torque [N·m]."""
        first, second, third, fourth = self._limits
        seen = (first.value, second.value, third.value, fourth.value)
        # The limits rarely change, and this is called in every period.
        if seen != self._seen:
            self._seen = seen
            common = min(first.value, second.value, _HIGHEST_PERMILLE)
            self._high = min(common, third.value) * self.permille
            self._low = max(-common, fourth.value if fourth.low < 0 else -fourth.value) * self.permille
        return self._high if torque > self._high else self._low if torque < self._low else torque

    def torque(self, wanted: float, t_ns: int) -> None:
        """Command a torque [N·m] within the limits."""
        torque = self.limit(wanted)
        self.limited = torque != wanted
        self._looping = False
        self._demand.value = round(torque / self._demand_unit)
        self.servo.command(torque, t_ns)

    def cut(self, t_ns: int) -> None:
        """End the torque at once."""
        self.limited = self._looping = False
        self._demand.value = 0
        self.servo.cut(t_ns)

    def show(self) -> None:
        """Update the actual values of position, velocity, torque and current."""
        servo, units, actual = self.servo, self.units, self._actual
        counts, state = servo.counts(), servo.plant.state
        self._position.value = counts if units.plain else units.position(counts)
        value = round(state[SPEED] * servo.encoder_factor / units.speed)
        self._velocity.value = value if LOWEST <= value <= HIGHEST else LOWEST if value < 0 else HIGHEST
        # The drive measures its current: a motor of another torque, or of the other direction, does not show there.
        torque = state[TORQUE] * servo.torque_sign / servo.torque_scale
        value = round(torque * self._per_step)
        actual.value = value if actual.low <= value <= actual.high else actual.low if value < 0 else actual.high
        value = round(torque * self._per_permille)
        if not -_HIGHEST_PERMILLE <= value <= _HIGHEST_PERMILLE:
            value = -_HIGHEST_PERMILLE if value < 0 else _HIGHEST_PERMILLE
        self._current.value = value

    # Loops.

    def speed(self, reference: float, acceleration: float, t_ns: int, offset: float = 0.0) -> None:
        """Run one tick of the speed loop: reference [rad/s], its slope [rad/s²], and an additional torque [N·m].

        The integral starts at 0 when the last torque did not come from this loop.
        """
        if not self._looping:
            self._integral, self._t_ns = 0.0, t_ns
        gains, error = self.gains, reference - self.servo.plant.velocity
        gain = gains.inertia * gains.bandwidth
        wanted = gain * error + self._integral + gains.inertia * acceleration + gains.damping * reference + offset
        self.torque(wanted, t_ns)
        # Set after `torque`, which clears it.
        self._looping = True
        # Anti-windup: while limited, the integral may only change in the direction that ends the limitation.
        if not self.limited or wanted * error < 0.0:
            self._integral += 0.25 * gain * gains.bandwidth * error * (t_ns - self._t_ns) * 1e-9
        self._t_ns = t_ns

    def position(self, angle: float, velocity: float, acceleration: float, t_ns: int, offset: float = 0.0) -> None:
        """Run one tick of the position loop.

        `angle` [rad] is on the scale of `Stage.angle`. `velocity` [rad/s] and `acceleration` [rad/s²] are fed forward,
        `offset` is an additional torque [N·m].
        """
        wanted = velocity + self.gains.position * (angle - self.angle())
        reference = self.slow(wanted)
        self.speed(reference, acceleration, t_ns, offset)
        self.limited |= reference != wanted

    def angle(self) -> float:
        """Return the shaft angle as the encoder has counted it, without rounding [rad]."""
        return self.servo.fine_counts() / self.units.counts_per_radian

    # Limits and ramps.

    def slow(self, velocity: float) -> float:
        """Return the permitted part of a speed [rad/s], by the smaller one of 607Fh and 6080h that limits."""
        motor, profile = self._max_motor_speed.value, self._max_profile_velocity.value
        limit = min(
            motor * _RPM if motor != NO_LIMIT else math.inf,
            profile * abs(self.units.speed) if profile != NO_LIMIT else math.inf,
        )
        return max(-limit, min(limit, velocity))

    def ramp(self, entry: Entry) -> float:
        """Return an acceleration of the object dictionary in rad/s²; NO_RAMP for 0."""
        return entry.value * abs(self.units.angle) if entry.value else NO_RAMP

"""A constant force: the constant force effect of USB PID, with its envelope.

F = `magnitude`, positive towards positive x, from `start_delay` on and for `duration`; 0 before and after. The envelope
moves it from the attack level and to the fade level, which have the magnitude's sign. (USB Device Class Definition for
Physical Interface Devices 1.0: magnitude, start delay, duration, attack level and time, fade level and time.)

It is active: it gives power up to |F|max·|v|, that is at most |F|max times the way of the handle, sampled as in
continuous time. While it neither begins nor ends it is conservative, U = −F·x, and a held constant is exact.
"""

from dataclasses import dataclass
from math import copysign
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.waves import Envelope, played
from haptic_fieldbus.scenes.element import STRICT, AnyEffort, Duration, Effort, Law, NonNegativeDuration
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Constant:
    """`magnitude` [N or N·m], with levels [N or N·m] and times [s]; without a `duration` it does not end."""

    axis: str
    magnitude: AnyEffort
    start_delay: NonNegativeDuration = 0.0
    duration: Duration | None = None
    attack_level: Effort = 0.0
    attack_time: NonNegativeDuration = 0.0
    fade_level: Effort = 0.0
    fade_time: NonNegativeDuration = 0.0
    name: str = "constant"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        _ = self.envelope  # which refuses times that do not fit

    @property
    def envelope(self) -> Envelope:
        return Envelope(
            abs(self.magnitude), self.duration, self.attack_level, self.attack_time, self.fade_level, self.fade_time
        )

    @property
    def needs(self) -> tuple[Signal, ...]:
        """The time only when the force changes."""
        always = self.envelope.is_flat and not self.start_delay and self.duration is None
        return () if always else (Signal.ELAPSED_NS,)

    @property
    def force(self) -> Law:
        magnitude = self.magnitude
        if not self.needs:
            return lambda: magnitude
        if self.envelope.is_flat:
            return played(lambda elapsed: magnitude, self.start_delay, self.duration)
        amplitude, sign = self.envelope.amplitude(), copysign(1.0, magnitude)
        return played(lambda elapsed: sign * amplitude(elapsed), self.start_delay, self.duration)

    def linearised(self) -> StateSpace:
        """Nothing that moves the handle changes it."""
        return gain([[0.0, 0.0]])

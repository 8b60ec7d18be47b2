"""A constant force: the constant force effect of USB PID, with its envelope.

F = `magnitude`, positive towards positive x, from `start_delay` on for `duration`; F = 0 before and after. The envelope
moves |F| from the attack level to the magnitude, and at the end to the fade level; both levels take the sign of the
magnitude. (USB Device Class Definition for Physical Interface Devices 1.0: magnitude, start delay, duration, attack
level and time, fade level and time.)

The element is active: it gives power up to |F|max·|v|, so at most |F|max times the distance that the handle moves,
sampled as in continuous time. Between its start and its end a force without envelope is conservative, U = −F·x, and the
hold of a constant causes no error.
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
    """A force `magnitude` [N or N·m] with an envelope of levels [N or N·m] and times [s].

    Without `duration` the force does not end.
    """

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
        _ = self.envelope  # raises ValueError when levels and times do not fit

    @property
    def envelope(self) -> Envelope:
        return Envelope(
            abs(self.magnitude), self.duration, self.attack_level, self.attack_time, self.fade_level, self.fade_time
        )

    @property
    def needs(self) -> tuple[Signal, ...]:
        """The elapsed time, or no signal when the force never changes."""
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

    @property
    def strongest(self) -> float:
        """Largest force that it gives by itself [N or N·m]."""
        return self.envelope.peak

    def linearised(self) -> StateSpace:
        """Return a gain of 0: the force does not depend on the motion of the handle."""
        return gain([[0.0, 0.0]])

"""A force that changes on a straight line: the ramp force effect of USB PID.

F goes from `start` to `end` within `duration`, positive towards positive x; 0 before `start_delay` and after the end.
The envelope scales it: `attack_level` and `fade_level` are the levels at its beginning and end of what is 1 between.
(USB Device Class Definition for Physical Interface Devices 1.0: ramp start, ramp end, start delay, duration, attack
level and time, fade level and time.)

It is active: it gives power up to |F|max·|v| with |F|max = max(|start|, |end|) times the largest level, that is at most
|F|max times the way of the handle, sampled as in continuous time.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.waves import Envelope, nanoseconds, played
from haptic_fieldbus.scenes.element import STRICT, AnyEffort, Duration, Law, NonNegativeDuration, Ratio
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Ramp:
    """From the force `start` to the force `end` [N or N·m] within `duration`, after `start_delay` [s].

    Levels of the envelope are shares of the force, its times in s.
    """

    axis: str
    start: AnyEffort
    end: AnyEffort
    duration: Duration
    start_delay: NonNegativeDuration = 0.0
    attack_level: Ratio = 0.0
    attack_time: NonNegativeDuration = 0.0
    fade_level: Ratio = 0.0
    fade_time: NonNegativeDuration = 0.0
    name: str = "ramp"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        _ = self.envelope  # which refuses times that do not fit

    @property
    def envelope(self) -> Envelope:
        return Envelope(1.0, self.duration, self.attack_level, self.attack_time, self.fade_level, self.fade_time)

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.ELAPSED_NS,)

    @property
    def force(self) -> Law:
        start, change, span = self.start, self.end - self.start, max(1, nanoseconds(self.duration))
        if self.envelope.is_flat:
            return played(lambda elapsed: start + change * (elapsed / span), self.start_delay, self.duration)
        level = self.envelope.amplitude()
        return played(
            lambda elapsed: level(elapsed) * (start + change * (elapsed / span)), self.start_delay, self.duration
        )

    def linearised(self) -> StateSpace:
        """Nothing that moves the handle changes it."""
        return gain([[0.0, 0.0]])

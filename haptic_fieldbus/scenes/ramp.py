"""A force that changes linearly in time: the ramp force effect of USB PID.

F goes from `start` to `end` within `duration`, positive towards positive x; F = 0 before `start_delay` and after the
end. The envelope multiplies it by a level: `attack_level` at the beginning, `fade_level` at the end, 1 between. (USB
Device Class Definition for Physical Interface Devices 1.0: ramp start, ramp end, start delay, duration, attack level
and time, fade level and time.)

The element is active: it gives power up to |F|max·|v| with |F|max = max(|start|, |end|) times the largest level, so at
most |F|max times the distance that the handle moves, sampled as in continuous time.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.waves import Envelope, nanoseconds, played
from haptic_fieldbus.scenes.element import STRICT, AnyEffort, Duration, Law, NonNegativeDuration, Ratio
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Ramp:
    """A force from `start` to `end` [N or N·m] within `duration`, after `start_delay` [s].

    The levels of the envelope are shares of the force; its times are in s.
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
    needs: ClassVar[tuple[Signal, ...]] = (Signal.ELAPSED_NS,)

    def __post_init__(self) -> None:
        _ = self.envelope  # raises ValueError when levels and times do not fit

    @property
    def envelope(self) -> Envelope:
        return Envelope(1.0, self.duration, self.attack_level, self.attack_time, self.fade_level, self.fade_time)

    @property
    def force(self) -> Law:
        # At least 1 ns, so that a shorter duration does not divide by zero.
        start, change, span = self.start, self.end - self.start, max(1, nanoseconds(self.duration))
        if self.envelope.is_flat:
            return played(lambda elapsed: start + change * (elapsed / span), self.start_delay, self.duration)
        level = self.envelope.amplitude()
        return played(
            lambda elapsed: level(elapsed) * (start + change * (elapsed / span)), self.start_delay, self.duration
        )

    @property
    def strongest(self) -> float:
        """Largest force that it gives by itself [N or N·m]."""
        return max(abs(self.start), abs(self.end)) * self.envelope.peak

    def linearised(self) -> StateSpace:
        """Return a gain of 0: the force does not depend on the motion of the handle."""
        return gain([[0.0, 0.0]])

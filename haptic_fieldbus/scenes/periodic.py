"""A wave: the periodic effects of USB PID, sine, square, triangle, sawtooth up and sawtooth down.

F = offset + A(t)·w(f·t + φ), positive towards positive x, where w is the waveform from −1 to 1 with period 1 and A the
magnitude or its envelope. Time t begins with the effect; F = 0 before `start_delay` and after `duration`. (USB Device
Class Definition for Physical Interface Devices 1.0: magnitude, offset, phase, period, start delay, duration, attack
level and time, fade level and time. Here the phase is a share of a period, and the frequency replaces the period.)

The element is active: it gives power up to |F|max·|v| with |F|max = |offset| + the largest amplitude, so at most |F|max
times the distance that the handle moves, sampled as in continuous time. The phase is exact at any time
(`numerics.waves`). A wave above half the rate of the loop is felt as its alias.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.waves import WAVEFORMS, Envelope, InTime, played, turns
from haptic_fieldbus.scenes.element import (
    STRICT,
    AnyEffort,
    AnyRatio,
    Duration,
    Effort,
    Frequency,
    Law,
    NonNegativeDuration,
    PositiveEffort,
)
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Periodic:
    """A `waveform` of `magnitude` [N or N·m] and `frequency` [Hz] about `offset` [N or N·m].

    `phase` is the start of the wave as a share of its period. Levels are in N or N·m, times in s. Without `duration`
    the wave does not end.
    """

    axis: str
    magnitude: PositiveEffort
    frequency: Frequency
    waveform: Literal["sine", "square", "triangle", "saw_up", "saw_down"] = "sine"
    offset: AnyEffort = 0.0
    phase: AnyRatio = 0.0
    start_delay: NonNegativeDuration = 0.0
    duration: Duration | None = None
    attack_level: Effort = 0.0
    attack_time: NonNegativeDuration = 0.0
    fade_level: Effort = 0.0
    fade_time: NonNegativeDuration = 0.0
    name: str = "periodic"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.ELAPSED_NS,)

    def __post_init__(self) -> None:
        _ = self.envelope  # raises ValueError when levels and times do not fit

    @property
    def envelope(self) -> Envelope:
        return Envelope(
            self.magnitude, self.duration, self.attack_level, self.attack_time, self.fade_level, self.fade_time
        )

    @property
    def force(self) -> Law:
        return played(self._wave(), self.start_delay, self.duration)

    def _wave(self) -> InTime:
        turn, form, offset = turns(self.frequency, self.phase), WAVEFORMS[self.waveform], self.offset
        if self.envelope.is_flat:
            magnitude = self.magnitude
            return lambda elapsed: offset + magnitude * form(turn(elapsed))
        amplitude = self.envelope.amplitude()
        return lambda elapsed: offset + amplitude(elapsed) * form(turn(elapsed))

    @property
    def strongest(self) -> float:
        """Largest force that it gives by itself [N or N·m]."""
        return abs(self.offset) + self.envelope.peak

    def linearised(self) -> StateSpace:
        """Return a gain of 0: the force does not depend on the motion of the handle."""
        return gain([[0.0, 0.0]])

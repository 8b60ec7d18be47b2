"""Effects in time: where in its period a wave is, its form, its envelope, and when it plays.

Time is a whole number of nanoseconds and a frequency is the exact rational number that its float stands for, so the
turn t·f + φ modulo 1 is found in whole numbers: after thirty years it is as exact as in the first period.

The terms are those of the USB Device Class Definition for Physical Interface Devices (PID) 1.0. Where on its form an
effect begins for a phase of 0 follows DirectInput (Microsoft, "Periodic Effects"):

| waveform | 0    | ¼       | ½    | ¾       |
|----------|------|---------|------|---------|
| sine     | 0    | 1       | 0    | −1      |
| square   | 1    | 1       | −1   | −1      |
| triangle | 1    | 0       | −1   | 0       |
| saw_up   | −1   | −½      | 0    | ½       |
| saw_down | 1    | ½       | 0    | −½      |

The envelope moves the amplitude on a straight line from the attack level to the magnitude within the attack time, and
from the magnitude to the fade level within the fade time, at whose end the effect ends.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from haptic_fieldbus.numerals import exactly

InTime = Callable[[int], float]
"""Elapsed time [ns] → a number."""

SECOND = 1_000_000_000
"""[ns]"""
WAVEFORMS: dict[str, Callable[[float], float]] = {
    "sine": lambda turn: math.sin(2.0 * math.pi * turn),
    "square": lambda turn: 1.0 if turn < 0.5 else -1.0,
    "triangle": lambda turn: abs(4.0 * turn - 2.0) - 1.0,
    "saw_up": lambda turn: 2.0 * turn - 1.0,
    "saw_down": lambda turn: 1.0 - 2.0 * turn,
}
"""Turn from 0 to 1 → −1 to 1."""


def nanoseconds(seconds: float) -> int:
    """The nearest whole number of them."""
    return round(Fraction(seconds) * SECOND)


def turns(frequency: float, phase: float) -> InTime:
    """The turn of a wave from 0 to 1, correctly rounded; frequency in Hz, phase as a share of a period."""
    rate, start = Fraction(frequency) / SECOND, Fraction(phase)
    whole = math.lcm(rate.denominator, start.denominator)
    step, first = int(rate * whole), int(start * whole) % whole
    return lambda elapsed: (elapsed * step + first) % whole / whole


@dataclass(frozen=True)
class Envelope:
    """How the amplitude of an effect changes while it plays; levels in the unit of the magnitude, times in s."""

    magnitude: float
    duration: float | None = None
    attack_level: float = 0.0
    attack_time: float = 0.0
    fade_level: float = 0.0
    fade_time: float = 0.0

    def __post_init__(self) -> None:
        if self.attack_level and not self.attack_time:
            raise ValueError(f"attack_level {exactly(self.attack_level)}: expected an attack_time too")
        if self.fade_level and not self.fade_time:
            raise ValueError(f"fade_level {exactly(self.fade_level)}: expected a fade_time too")
        if self.fade_time and self.duration is None:
            raise ValueError(
                f"fade_time {exactly(self.fade_time)}: expected a duration too, as the fade ends with the effect"
            )
        if self.duration is not None and self.attack_time + self.fade_time > self.duration:
            raise ValueError(
                f"attack_time {exactly(self.attack_time)} and fade_time {exactly(self.fade_time)}: expected to fit "
                f"into the duration {exactly(self.duration)}"
            )

    @property
    def is_flat(self) -> bool:
        return not (self.attack_time or self.fade_time)

    @property
    def peak(self) -> float:
        """The largest amplitude."""
        return max(self.magnitude, self.attack_level, self.fade_level)

    def amplitude(self) -> InTime:
        """The amplitude at a time since the effect began."""
        magnitude, attack_level, fade_level = self.magnitude, self.attack_level, self.fade_level
        attack, fade = nanoseconds(self.attack_time), nanoseconds(self.fade_time)
        end = math.inf if self.duration is None else nanoseconds(self.duration)
        fade_begin = end - fade if fade else math.inf

        def amplitude(elapsed: int) -> float:
            if elapsed < attack:
                return attack_level + (magnitude - attack_level) * (elapsed / attack)
            if elapsed > fade_begin:
                return fade_level + (magnitude - fade_level) * ((end - elapsed) / fade)
            return magnitude

        return amplitude


def played(effect: InTime, start_delay: float, duration: float | None) -> InTime:
    """The effect with its own time, from the delay on and for its duration; 0 before and after [s]."""
    if not start_delay and duration is None:
        return effect
    begin = nanoseconds(start_delay)
    end = math.inf if duration is None else begin + nanoseconds(duration)
    return lambda elapsed: effect(elapsed - begin) if begin <= elapsed < end else 0.0

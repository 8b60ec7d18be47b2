"""Effects in time: the position of a wave in its period, its form, its envelope, and the time in which it plays.

Time is a whole number of nanoseconds, and a frequency is the exact rational number that its float represents. The turn
t·f + φ modulo 1 is therefore computed in whole numbers: after thirty years it is as exact as in the first period.

The terms are those of the USB Device Class Definition for Physical Interface Devices (PID) 1.0. The value of a form at
a turn, and thus the beginning of an effect with a phase of 0, follows DirectInput (Microsoft, "Periodic Effects"):

| waveform | 0    | ¼       | ½    | ¾       |
|----------|------|---------|------|---------|
| sine     | 0    | 1       | 0    | −1      |
| square   | 1    | 1       | −1   | −1      |
| triangle | 1    | 0       | −1   | 0       |
| saw_up   | −1   | −½      | 0    | ½       |
| saw_down | 1    | ½       | 0    | −½      |

The envelope changes the amplitude linearly from the attack level to the magnitude within the attack time, and from the
magnitude to the fade level within the fade time. The effect ends with the fade time.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from haptic_fieldbus.numerals import exactly

InTime = Callable[[int], float]
"""Function of the elapsed time [ns]."""

SECOND = 1_000_000_000
"""[ns]"""
WAVEFORMS: dict[str, Callable[[float], float]] = {
    "sine": lambda turn: math.sin(2.0 * math.pi * turn),
    "square": lambda turn: 1.0 if turn < 0.5 else -1.0,
    "triangle": lambda turn: abs(4.0 * turn - 2.0) - 1.0,
    "saw_up": lambda turn: 2.0 * turn - 1.0,
    "saw_down": lambda turn: 1.0 - 2.0 * turn,
}
"""Forms by name; each maps the turn, from 0 to 1, to a value from −1 to 1."""


def nanoseconds(seconds: float) -> int:
    """Return a time [s] as the nearest whole number of nanoseconds."""
    return round(Fraction(seconds) * SECOND)


def turns(frequency: float, phase: float) -> InTime:
    """Return the turn of a wave, from 0 to 1 and correctly rounded; frequency in Hz, phase as a share of a period."""
    # Both fractions over one common denominator: time and phase then add as whole numbers, and one division rounds.
    rate, start = Fraction(frequency) / SECOND, Fraction(phase)
    whole = math.lcm(rate.denominator, start.denominator)
    step, first = int(rate * whole), int(start * whole) % whole
    return lambda elapsed: (elapsed * step + first) % whole / whole


@dataclass(frozen=True)
class Envelope:
    """Amplitude of an effect while it plays; levels in the unit of the magnitude, times in s.

    Raises ValueError for levels without their times, a fade without a duration, and times that exceed the duration.
    """

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
        # To half of a nanosecond, because in floats 0.1 + 0.2 is above 0.3.
        if self.duration is not None and self.attack_time + self.fade_time > self.duration + 0.5 / SECOND:
            raise ValueError(
                f"attack_time {exactly(self.attack_time)} and fade_time {exactly(self.fade_time)}: expected to fit "
                f"into the duration {exactly(self.duration)}"
            )

    @property
    def is_flat(self) -> bool:
        return not (self.attack_time or self.fade_time)

    @property
    def peak(self) -> float:
        """Largest amplitude."""
        return max(self.magnitude, self.attack_level, self.fade_level)

    def amplitude(self) -> InTime:
        """Return the amplitude as a function of the time since the effect began."""
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
    """Return the effect shifted by `start_delay` [s] and limited to `duration` [s]; it is 0 before and after.

    None as the duration sets no limit.
    """
    if not start_delay and duration is None:
        return effect
    begin = nanoseconds(start_delay)
    # Without a duration the end is ∞, with which whole numbers of nanoseconds compare exactly.
    end = math.inf if duration is None else begin + nanoseconds(duration)
    return lambda elapsed: effect(elapsed - begin) if begin <= elapsed < end else 0.0

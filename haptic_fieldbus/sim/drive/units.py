"""The factor group: conversion between encoder counts, position and velocity units, and the shaft in SI.

Theory (CiA 402-2, 607Eh, 608Fh, 6091h, 6092h). Position [position units] = counts · feed constant / (encoder resolution
· gear ratio). A velocity unit is one position unit a second, or the drive's own unit whatever the factors (60A9h, r/min
and parts of it). An acceleration unit is a position unit per second squared. Bit 7 of the polarity reverses positions,
bit 6 velocities. In a drive without feed constant, positions are counts at the driving shaft: the feed constant is its
encoder resolution.
"""

import math
from collections.abc import Mapping

from haptic_fieldbus.sim.drive.dictionary import Dictionary, Entry

WRAP, HALF = 1 << 32, 1 << 31
"""Of a position, which turns over."""
_LOWEST, _HIGHEST = -0x8000_0000, 0x7FFF_FFFF
"""Of what is bounded: a velocity, an error."""
_POSITION_POLARITY, _VELOCITY_POLARITY = 0x80, 0x40

_RESOLUTION, _GEAR, _FEED = 0x608F, 0x6091, 0x6092


def fit(value: float) -> int:
    """Return a value rounded and bounded to an INTEGER32."""
    return max(_LOWEST, min(_HIGHEST, round(value)))


class Units:
    """The factors of the objects; call `update` after a change."""

    plain: bool
    """Whether a position unit is a count."""
    angle: float
    """One position unit at the motor shaft [rad], with its sign."""
    speed: float
    """One velocity unit [rad/s], with its sign."""

    def __init__(
        self,
        counts_per_radian: float,
        table: Mapping[tuple[int, int], Entry],
        dictionary: Dictionary,
        velocity_unit: float | None = None,
    ) -> None:
        """Take the factors from `table`, by index and sub-index.

        `velocity_unit` [rad/s] is the drive's own unit of velocity, None when it follows from the factors.
        """
        self.counts_per_radian = counts_per_radian
        self._velocity_unit = velocity_unit
        self._polarity = table[0x607E, 0]
        pairs = ((table[index, 1], table[index, 2]) for index in (_RESOLUTION, _GEAR, _FEED))
        self._resolution, self._gear, self._feed = pairs
        self._dictionary = dictionary
        self.update()

    def update(self) -> None:
        """Take over the values of the objects; a factor of 0 counts as 1."""
        feed_constant = self._feed if _FEED in self._dictionary else self._resolution
        (counts, turns), (motor, shaft), (feed, per) = (
            (pair[0].value or 1, pair[1].value or 1) for pair in (self._resolution, self._gear, feed_constant)
        )
        polarity = self._polarity.value
        self._numerator = feed * turns * shaft * (-1 if polarity & _POSITION_POLARITY else 1)
        self._denominator = per * counts * motor
        self.plain = self._numerator == self._denominator
        per_radian = self._numerator / self._denominator * self.counts_per_radian
        self.angle = 1 / per_radian
        self.speed = math.copysign(self._velocity_unit or self.angle, -1 if polarity & _VELOCITY_POLARITY else 1)

    def position(self, counts: int) -> int:
        """Return counts as position units, rounded and wrapped to 32 bits."""
        # Rounding to the nearest in integers: floor(x + 1/2), without the rounding of a float.
        numerator = 2 * counts * self._numerator + self._denominator
        return (numerator // (2 * self._denominator) + HALF) % WRAP - HALF

    def counts(self, position: int) -> int:
        """Return the count nearest to a position in position units."""
        return round(position * self._denominator / self._numerator)

    def velocity(self, speed: float) -> int:
        """Return a speed of the shaft [rad/s] in velocity units, bounded to an INTEGER32."""
        return fit(speed / self.speed)

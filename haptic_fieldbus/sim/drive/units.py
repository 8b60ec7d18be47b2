"""The factor group: conversion between encoder counts, position and velocity units, and the shaft in SI.

Theory (CiA 402-2, 607Eh, 608Fh, 6091h, 6092h, 60A8h, 60A9h). Position [position units] = counts · feed constant /
(encoder resolution · gear ratio). A velocity unit is one position unit a second, or the drive's own unit whatever the
factors. A drive with 60A8h or 60A9h uses the units that these objects name. If 60A8h is an angle, the feed constant is
the number of its units in a revolution; 60A9h refers to the motor. A drive without 60A8h, or with 0 in it, may have an
angle of its own as the unit. An acceleration unit is a position unit per second squared. Bit 7 of the polarity reverses
positions, bit 6 velocities. In a drive without feed constant, positions are counts at the driving shaft: the feed
constant is its encoder resolution.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import InitVar, dataclass, field
from fractions import Fraction

from haptic_fieldbus.sim.drive.dictionary import Dictionary, Entry, only_if

WRAP, HALF = 1 << 32, 1 << 31
"""Range and half range of a position, which wraps."""
LOWEST, HIGHEST = -0x8000_0000, 0x7FFF_FFFF
"""Limits of bounded values: velocity, error."""
_POSITION_POLARITY, _VELOCITY_POLARITY = 0x80, 0x40

_RESOLUTION, _GEAR, _FEED = 0x608F, 0x6091, 0x6092
_POSITION_UNIT, _VELOCITY_UNIT = 0x60A8, 0x60A9
# CiA 303-2: notation of units. Numerators that are angles, as revolutions; denominators, as seconds.
_COUNTS = 0xB5
_REVOLUTIONS = {0xB4: Fraction(1), 0x41: Fraction(1, 360), 0x10: Fraction(1 / (2 * math.pi))}
_SECONDS = {0x03: 1, 0x47: 60}


def revolutions_of(code: int) -> Fraction | None:
    """Return the position unit of a value of 60A8h [rev]; None for counts and for unknown units."""
    numerator = _REVOLUTIONS.get(code >> 16 & 0xFF)
    return None if numerator is None or code & 0xFFFF else numerator * _power_of_ten(code)


def velocity_of(code: int, counts_per_radian: float) -> float | None:
    """Return the velocity unit of a value of 60A9h [rad/s of the motor]; None for an unknown unit."""
    numerator, seconds = code >> 16 & 0xFF, _SECONDS.get(code >> 8 & 0xFF)
    if seconds is None or code & 0xFF:
        return None
    if numerator == _COUNTS:
        return float(_power_of_ten(code)) / counts_per_radian / seconds
    angle = _REVOLUTIONS.get(numerator)
    return None if angle is None else float(angle * _power_of_ten(code)) * 2 * math.pi / seconds


def _power_of_ten(code: int) -> Fraction:
    """Return the prefix of a unit, which is the exponent of ten as an INTEGER8."""
    exponent = code >> 24 & 0xFF
    return Fraction(10) ** (exponent - 256 if exponent > 127 else exponent)


def fit(value: float) -> int:
    """Return a value rounded and bounded to an INTEGER32."""
    rounded = round(value)
    return rounded if LOWEST <= rounded <= HIGHEST else LOWEST if rounded < 0 else HIGHEST


@dataclass(eq=False)
class Units:
    """The factors of the objects; call `update` after a change."""

    counts_per_radian: float
    table: InitVar[Mapping[tuple[int, int], Entry]]
    """The factors by index and sub-index."""
    _dictionary: Dictionary
    _velocity_unit: float | None = None
    """The drive's own unit of velocity [rad/s], None when it follows from the factors."""
    _position_unit: Fraction | None = None
    """The drive's own unit of position [rev], None when it follows from the factors."""
    plain: bool = field(init=False)
    """Whether a position unit is a count."""
    angle: float = field(init=False)
    """One position unit at the motor shaft [rad], with its sign."""
    speed: float = field(init=False)
    """One velocity unit [rad/s], with its sign."""

    def __post_init__(self, table: Mapping[tuple[int, int], Entry]) -> None:
        self._polarity = table[0x607E, 0]
        pairs = ((table[index, 1], table[index, 2]) for index in (_RESOLUTION, _GEAR, _FEED))
        self._resolution, self._gear, self._feed = pairs
        self.update()

    def follow(self) -> None:
        """Use 60A8h and 60A9h from now on, if the dictionary has them; they then refuse unknown units."""
        known: dict[int, Callable[[int], bool]] = {
            _POSITION_UNIT: lambda code: code == _COUNTS << 16 or revolutions_of(code & 0xFFFF_FFFF) is not None,
            _VELOCITY_UNIT: lambda code: velocity_of(code & 0xFFFF_FFFF, self.counts_per_radian) is not None,
        }
        for index, accepts in known.items():
            if index in self._dictionary:
                entry = self._dictionary.find(index)
                entry.accept, entry.changed = only_if(accepts), self.update
        self.update()

    def update(self) -> None:
        """Take over the values of the objects; a factor of 0 counts as 1."""
        feed_constant = self._feed if _FEED in self._dictionary else self._resolution
        (counts, turns), (motor, shaft), (feed, per) = (
            (pair[0].value or 1, pair[1].value or 1) for pair in (self._resolution, self._gear, feed_constant)
        )
        polarity = self._polarity.value
        code = self._dictionary.value(_POSITION_UNIT) & 0xFFFF_FFFF
        if (unit := revolutions_of(code) if code else self._position_unit) is not None:
            feed, per = unit.denominator, unit.numerator
        self._numerator = feed * turns * shaft * (-1 if polarity & _POSITION_POLARITY else 1)
        self._denominator = per * counts * motor
        self.plain = self._numerator == self._denominator
        per_radian = self._numerator / self._denominator * self.counts_per_radian
        self.angle = 1 / per_radian
        own = velocity_of(self._dictionary.value(_VELOCITY_UNIT) & 0xFFFF_FFFF, self.counts_per_radian)
        own = own or self._velocity_unit
        self.speed = math.copysign(own or self.angle, -1 if polarity & _VELOCITY_POLARITY else 1)

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

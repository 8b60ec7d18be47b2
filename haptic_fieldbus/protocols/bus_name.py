"""A bus as users write it, `sim` or `socketcan:can0@500000`, parsed by its protocol."""

import re
from dataclasses import dataclass
from fractions import Fraction

from haptic_fieldbus.drive.rig import BusSection

_BIT_RATE = re.compile(r"([0-9]{1,12}(?:\.[0-9]{1,12})?)([kM]?)(?:bit/s)?")
_FACTORS = {"": 1, "k": 10**3, "M": 10**6}


@dataclass(frozen=True)
class BusName:
    """The text that a user wrote, and the bus of a rig that it stands for."""

    text: str
    section: BusSection
    assumed: str = ""
    """Sentence about a value that the text leaves open and that was assumed; empty when there is none."""

    @property
    def simulated(self) -> bool:
        """True when the bus is simulated."""
        return self.section.simulated


def bit_rate(text: str) -> int | None:
    """Return a bit rate [bit/s] as a bus name has it after its @, `500000`, `500k` or `1M`; None for another text."""
    match = _BIT_RATE.fullmatch(text)
    rate = Fraction(match[1]) * _FACTORS[match[2]] if match else Fraction(1, 2)
    return int(rate) if rate.denominator == 1 else None

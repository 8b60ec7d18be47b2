"""The identity of a drive, and digests: what decides whether a proof or a note belongs to the drive that is there.

A proof of a guard and a note about a torque limit are read again on another day, when another drive may be at the same
node. Only a serial number tells two drives of one model apart. A drive that was never given one tells 0, or all ones as
memory that was never programmed does; both are no number here. Of a drive without a serial number nothing is kept that
could permit more.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, fields

from haptic_fieldbus.drive.objects import DataType

_DIGITS = 16
"""Hexadecimal digits of a digest: enough to find a change, not to keep out a forger, who could change the program."""


@dataclass(frozen=True)
class Identity:
    """Numbers that a drive tells of itself (1018h, or registers); None: it tells none."""

    vendor: int | None = None
    product: int | None = None
    revision: int | None = None
    """Of the hardware or the firmware; after an update it is another one."""
    serial: int | None = None

    def file_name(self, place: str) -> str | None:
        """Return a name that no other drive has; None without a serial number.

        The revision is no part of it, because a drive stays the same after an update. Where vendor or product is not
        known, another one may give the same serial number, so that the place of the drive is a part of the name.
        """
        if self.serial is None:
            return None
        name = "-".join(f"{each or 0:08x}" for each in (self.vendor, self.product, self.serial))
        return name if self.vendor and self.product else f"{name}-{digest_of((place,))}"

    def difference(self, other: "Identity") -> str:
        """Return the name of the first number in which two drives differ, the serial number first; empty when none."""
        names = [each.name for each in fields(self)][::-1]
        return next((name for name in names if getattr(self, name) != getattr(other, name)), "")


def known_number(number: int | None, type: DataType = DataType.UINT32) -> int | None:
    """Return a number that a drive tells of itself; None for 0 and for all ones, which say that it was never given."""
    ones = (1 << 8 * type.size) - 1
    return None if number is None or number & ones in (0, ones) else number


def digest_of(texts: Iterable[str]) -> str:
    """Return a digest of texts in this order."""
    return hashlib.sha256(json.dumps(list(texts)).encode()).hexdigest()[:_DIGITS]

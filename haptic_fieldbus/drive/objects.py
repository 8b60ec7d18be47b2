"""Entries of a CANopen object dictionary: data types, names, encoding, notation.

References: CiA 301 4.2 (data types), CiA 402-2 (object names).
"""

import hashlib
import json
import struct
from collections.abc import Iterable
from dataclasses import dataclass, fields
from enum import Enum

_STRUCT_CODES = {"int8": "b", "int16": "h", "int32": "i", "uint8": "B", "uint16": "H", "uint32": "I"}


class DataType(Enum):
    """Basic data types; the value is the name in profile files."""

    INT8 = "int8"
    INT16 = "int16"
    INT32 = "int32"
    UINT8 = "uint8"
    UINT16 = "uint16"
    UINT32 = "uint32"

    def __init__(self, name: str) -> None:
        self.code = _STRUCT_CODES[name]
        """Character of the type in a `struct` format."""
        self._struct = struct.Struct("<" + self.code)
        self.size = self._struct.size
        """Size on the wire [octets]."""
        bits = 8 * self.size
        # In a `struct` format signed integers have small letters.
        self.limits = (-(1 << bits - 1), (1 << bits - 1) - 1) if self.code.islower() else (0, (1 << bits) - 1)
        """Smallest and largest value."""

    def pack(self, value: int) -> bytes:
        """Return the little-endian octets of a value; raises struct.error when it is out of range."""
        return self._struct.pack(value)

    def unpack(self, data: bytes) -> int:
        """Return the value of little-endian octets; raises struct.error when their number is wrong."""
        value: int = self._struct.unpack(data)[0]
        return value


class Order(Enum):
    """Order of the octets of a value on the wire; the value is the name in profile files."""

    LITTLE = "little"
    BIG = "big"
    BIG_LOW_WORD_FIRST = "big, low word first"


NAMES = {
    0x1000: "device type",
    0x1001: "error register",
    0x1005: "COB-ID SYNC message",
    0x100C: "guard time",
    0x100D: "life time factor",
    0x1016: "consumer heartbeat time",
    0x1017: "producer heartbeat time",
    0x1018: "identity object",
    0x1029: "error behaviour",
    0x6007: "abort connection option code",
    0x603F: "error code",
    0x6040: "controlword",
    0x6041: "statusword",
    0x605A: "quick stop option code",
    0x605E: "fault reaction option code",
    0x6060: "modes of operation",
    0x6061: "modes of operation display",
    0x6064: "position actual value",
    0x606C: "velocity actual value",
    0x6071: "target torque",
    0x6072: "max torque",
    0x6074: "torque demand",
    0x6076: "motor rated torque",
    0x6077: "torque actual value",
    0x60B2: "torque offset",
    0x60C2: "interpolation time period",
    0x60E0: "positive torque limit value",
    0x60E1: "negative torque limit value",
    0x6502: "supported drive modes",
}
"""Names of the objects that the package uses, by index."""

PDO_NAMES = {
    0x1400: "RPDO communication parameter",
    0x1600: "RPDO mapping parameter",
    0x1800: "TPDO communication parameter",
    0x1A00: "TPDO mapping parameter",
}
"""Names of the PDO objects, by the first index of each range of 512."""


@dataclass(frozen=True)
class ObjectEntry:
    """One entry of the object dictionary, with the unit of its value; empty when there is none."""

    object: int
    type: DataType
    subindex: int = 0
    unit: str = ""

    @property
    def name(self) -> str:
        """Name of the object in the standard, `object` when it is not listed here."""
        # The lower 9 bits number the 512 PDOs of a range.
        return NAMES.get(self.object) or PDO_NAMES.get(self.object & ~0x1FF, "object")

    @property
    def mapping(self) -> int:
        """Value of a PDO mapping entry: index, sub-index, length in bits (CiA 301, 7.5.2.36)."""
        return self.object << 16 | self.subindex << 8 | 8 * self.type.size

    @property
    def place(self) -> str:
        """Index and sub-index, as manuals write them."""
        return f"{self.object:04X}h:{self.subindex:02X}"

    def __str__(self) -> str:
        return f"{self.place} {self.name}"


# The identity of a drive, and digests: what decides whether a proof or a note belongs to the drive that is there.
#
# A proof of a guard and a note about a torque limit are read again on another day, when another drive may be at the
# same node. Only a serial number tells two drives of one model apart. A drive that was never given one tells 0, or all
# ones as memory that was never programmed does; both are no number here. Of a drive without a serial number nothing is
# kept that could permit more.

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

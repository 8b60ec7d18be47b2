"""Data types of CANopen by their index in the object dictionary, as an EDS names them.

Reference: CiA 301 4.2, table 44 (object dictionary data types) and 7.1 (encoding).
"""

from enum import IntEnum


class EdsType(IntEnum):
    """A basic data type; the value stands behind `DataType=`."""

    BOOLEAN = 0x01
    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    REAL32 = 0x08
    VISIBLE_STRING = 0x09
    OCTET_STRING = 0x0A
    UNICODE_STRING = 0x0B
    TIME_OF_DAY = 0x0C
    TIME_DIFFERENCE = 0x0D
    DOMAIN = 0x0F
    INTEGER24 = 0x10
    REAL64 = 0x11
    INTEGER40 = 0x12
    INTEGER48 = 0x13
    INTEGER56 = 0x14
    INTEGER64 = 0x15
    UNSIGNED24 = 0x16
    UNSIGNED40 = 0x18
    UNSIGNED48 = 0x19
    UNSIGNED56 = 0x1A
    UNSIGNED64 = 0x1B

    @property
    def size(self) -> int | None:
        """Number of octets in an SDO; None when it depends on the value."""
        return _SIZES.get(self)

    @property
    def signed(self) -> bool:
        return self.name.startswith("INTEGER")

    @property
    def is_integer(self) -> bool:
        """Whether values are whole numbers; times and BOOLEAN count as such."""
        return self.size is not None and self not in REALS

    @property
    def limits(self) -> tuple[int, int] | None:
        """The lowest and the highest whole number; None for a type whose values are none."""
        if not self.is_integer:
            return None
        if self is EdsType.BOOLEAN:
            return 0, 1
        bits = 8 * (self.size or 0)
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.signed else (0, (1 << bits) - 1)


REALS = (EdsType.REAL32, EdsType.REAL64)
TEXTS = (EdsType.VISIBLE_STRING, EdsType.UNICODE_STRING)
TIMES = (EdsType.TIME_OF_DAY, EdsType.TIME_DIFFERENCE)
OCTETS = (EdsType.OCTET_STRING, EdsType.DOMAIN)

_SIZES = {
    EdsType.BOOLEAN: 1,
    EdsType.REAL32: 4,
    EdsType.REAL64: 8,
    **dict.fromkeys(TIMES, 6),
} | {
    member: int(member.name.removeprefix("INTEGER").removeprefix("UNSIGNED")) // 8
    for member in EdsType
    if member.name.startswith(("INTEGER", "UNSIGNED"))
}

"""Names of the objects of the standards, as an EDS gives them in `ParameterName`.

Reference: CiA 301 4.2, 7.5 (communication profile area), CiA 402-2 (drive profile), object descriptions.
"""

from collections.abc import Mapping
from enum import IntEnum
from functools import cache
from pathlib import Path

# Data types of CANopen by their index in the object dictionary, as an EDS names them.
#
# Reference: CiA 301 4.2, table 44 (object dictionary data types) and 7.1 (encoding).


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

_SIZES = {EdsType.BOOLEAN: 1, EdsType.REAL32: 4, EdsType.REAL64: 8, **dict.fromkeys(TIMES, 6)} | {
    member: int(member.name.removeprefix("INTEGER").removeprefix("UNSIGNED")) // 8
    for member in EdsType
    if member.name.startswith(("INTEGER", "UNSIGNED"))
}


@cache
def object_names() -> dict[int, str]:
    """Return the names of the objects by index, from the file beside this one; those of PDOs are in `_RECORDS`."""
    lines = Path(__file__).with_name("object_names.txt").read_text(encoding="ascii").splitlines()
    return {int(index, 16): name for index, _, name in (line.partition(" ") for line in lines)}


# The parameters of the 512 PDOs of a direction fill a block of 200h objects.
_RECORDS = {
    0x1400: "RPDO communication parameter",
    0x1600: "RPDO mapping parameter",
    0x1800: "TPDO communication parameter",
    0x1A00: "TPDO mapping parameter",
}
_COMMUNICATION = {
    1: "COB-ID", 2: "Transmission type", 3: "Inhibit time",
    4: "Compatibility entry", 5: "Event timer", 6: "SYNC start value",
}  # fmt: skip
# Sub-indices of 1010h and 1011h.
_GROUPS = {1: "all", 2: "communication", 3: "application", 4: "manufacturer"}
_SUBINDICES: Mapping[int, Mapping[int, str]] = {
    0x1010: {number: f"Save {group} parameters" for number, group in _GROUPS.items()},
    0x1011: {number: f"Restore {group} default parameters" for number, group in _GROUPS.items()},
    0x1018: {1: "Vendor-ID", 2: "Product code", 3: "Revision number", 4: "Serial number"},
    0x1029: {1: "Communication error"},
    0x1200: {1: "COB-ID client to server (rx)", 2: "COB-ID server to client (tx)"},
    0x5FF1: {1: "Milliseconds after midnight", 2: "Days since 1984"},
    0x608F: {1: "Encoder increments", 2: "Motor revolutions"},
    0x6091: {1: "Motor shaft revolutions", 2: "Driving shaft revolutions"},
    0x6092: {1: "Feed", 2: "Shaft revolutions"},
    0x6099: {1: "Speed during search for switch", 2: "Speed during search for zero"},
    0x60C2: {1: "Interpolation time period value", 2: "Interpolation time index"},
}
_ARRAY_ELEMENTS = {0x1003: "Standard error field", 0x1016: "Consumer heartbeat time"}
HIGHEST = "Highest sub-index supported"


def parameter_name(index: int) -> str:
    """Return the name of an object, such as "Object 2000h" for one without a name here."""
    record = index & ~0x1FF
    if record in _RECORDS:
        return f"{_RECORDS[record]} {index - record + 1}"
    return object_names().get(index, f"Object {index:04X}h")


def member_name(index: int, subindex: int) -> str:
    """Return the name of a sub-index of a record or an array."""
    record = index & ~0x1FF
    if record in (0x1600, 0x1A00):
        return f"Application object {subindex}" if subindex else "Number of mapped application objects in PDO"
    if not subindex:
        return HIGHEST
    names = _COMMUNICATION if record in (0x1400, 0x1800) else _SUBINDICES.get(index, {})
    element = _ARRAY_ELEMENTS.get(index, parameter_name(index))
    return names.get(subindex, f"{element} {subindex}")

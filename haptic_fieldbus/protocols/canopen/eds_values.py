"""Values and findings of an EDS in the terms of a profile."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from haptic_fieldbus.drive.objects import NAMES, DataType
from haptic_fieldbus.drive.rig import COUNTS, COUNTS_PER_SECOND, TENTH_DEGREE
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType
from haptic_fieldbus.errors import Fault

# Units that a drive says it counts in: 60A8h *SI unit position* and 60A9h *SI unit velocity* (CiA 402-2, 303-2).

POSITION_UNIT_CODES = {0: COUNTS, 0x00B5_0000: COUNTS, 0xFF41_0000: TENTH_DEGREE}
"""Value of 60A8h → unit; 0 says nothing, and the octets are prefix and numerator (B5h counts, 41h degrees)."""
VELOCITY_UNIT_CODES = {
    0x00B4_4700: "rpm",
    0xFFB4_4700: "0.1 rpm",
    0xFEB4_4700: "0.01 rpm",
    0xFDB4_4700: "0.001 rpm",
    0x00B5_0300: COUNTS_PER_SECOND,
}
"""Value of 60A9h → unit; the octets are prefix, numerator (B4h revolutions, B5h counts), denominator (47h minutes, 03h
seconds)."""


# One value of a profile beside what the file of its drive shows.


@dataclass(frozen=True)
class Finding:
    """One value of a profile, and what the file has there; `fault` says what is wrong, empty when both agree."""

    key: str
    shows: str
    """What the file has, in words."""
    line: int | None = None
    """Line of the file."""
    fault: str = ""
    index: int | None = None
    """The object, by which a profile may explain a difference."""
    subindex: int = 0
    is_left_out: bool = False
    """True: the profile does not give the key, although the file has what it needs."""

    def as_fault(self) -> Fault:
        """Return the fault, with the line of the file."""
        return Fault(self.key, self.fault, self.line)


# Values, types and units that an EDS gives, in the terms of a profile.

RECEIVED, SENT = ("rw", "rww", "wo"), ("ro", "rw", "rwr", "const")
"""Access types with which an object may be mapped into an RPDO, and into a TPDO."""
WRITABLE, READABLE = ("rw", "rww", "rwr", "wo"), ("ro", "rw", "rww", "rwr", "const")
"""Access types with which an SDO may write an object, and read it."""
_TYPES: Mapping[EdsType | None, DataType] = {
    EdsType.INTEGER8: DataType.INT8,
    EdsType.INTEGER16: DataType.INT16,
    EdsType.INTEGER32: DataType.INT32,
    EdsType.UNSIGNED8: DataType.UINT8,
    EdsType.UNSIGNED16: DataType.UINT16,
    EdsType.UNSIGNED32: DataType.UINT32,
}
PER_AXIS = (0x6064, 0x606C, 0x6071, 0x6077)
"""Objects that some drives of several axes have in sub-indices, one for each axis."""
ANY_NODE = 1
"""Node-ID for which default values are evaluated; a default that does not follow the node-ID is the same for all."""


def data_type(entry: EdsEntry) -> DataType | None:
    """Return the type of an entry as profiles write it; None for a type that profiles do not have."""
    return _TYPES.get(entry.type)


def number_of(eds: Eds, index: int, subindex: int = 0) -> int | None:
    """Return the default value of an entry; None when there is none, or no number."""
    entry = eds.find(index, subindex)
    value = entry.value(ANY_NODE) if entry is not None else None
    return value if isinstance(value, int) else None


def axes_words(indices: Iterable[int]) -> str:
    """Return what to do about a node that has a value of each axis in a sub-index of its own."""
    named = ", ".join(f"{index:04X}h:01 and :02" for index in indices)
    return (
        f"several axes share this node, each in a sub-index of its own ({named}): write a profile for each axis, with "
        "subindex = 1, 2 … in position.actual, torque.target and torque.actual"
    )


def axes_in(eds: Eds) -> list[int]:
    """Return the objects that have a value of each of several axes in sub-indices."""
    return [
        index
        for index in PER_AXIS
        if all((entry := eds.find(index, each)) is not None and entry.type not in (None, EdsType.UNSIGNED8)
               for each in (1, 2))
    ]  # fmt: skip


def object_name(index: int) -> str:
    """Return index and name of an object, as messages write it."""
    return f"{index:04X}h {NAMES[index]}"


def is_mappable(entry: EdsEntry, access: tuple[str, ...]) -> bool:
    """Return whether a PDO of a direction may carry an entry; `access` is `RECEIVED` or `SENT`."""
    return entry.mappable and entry.access in access


def position_unit(eds: Eds) -> str | None:
    """Return the unit of 6064h by 60A8h, counts where it says nothing; None for a unit that is not known."""
    # The mask makes a default that is written with a sign unsigned.
    return POSITION_UNIT_CODES.get((number_of(eds, 0x60A8) or 0) & 0xFFFF_FFFF)


def velocity_unit(eds: Eds) -> str | None:
    """Return the unit of 606Ch by 60A9h, counts a second without it; None for a unit that is not known."""
    code = number_of(eds, 0x60A9)
    return COUNTS_PER_SECOND if code is None else VELOCITY_UNIT_CODES.get(code & 0xFFFF_FFFF)


def supported_modes(eds: Eds) -> int:
    """Return the supported drive modes, 6502h; 0 when the file has no value."""
    return number_of(eds, 0x6502) or 0


def identity(eds: Eds, subindex: int) -> int | None:
    """Return the vendor-ID (1) or the product code (2) by 1018h, else by [DeviceInfo]; None for none, and for 0."""
    device = eds.device
    return number_of(eds, 0x1018, subindex) or (device.vendor_number, device.product_number)[subindex - 1] or None

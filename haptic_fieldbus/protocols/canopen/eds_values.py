"""The standard objects that the master uses, and the values and findings of an EDS in the terms of a profile.

`OBJECTS` is the one table of these objects: key of the profile, index, types, use. Draft, sources, check and upload go
over its rows, so an object of the standards that a profile names is added here, as one row.
"""

from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY, dataclass
from enum import Enum

from haptic_fieldbus.drive.cia402 import Cia402Profile, MappedObject, OptionCode, WrittenObject
from haptic_fieldbus.drive.profile import NAMES, DataType, ObjectEntry
from haptic_fieldbus.drive.rig import COUNTS, COUNTS_PER_SECOND, PERMILLE, TENTH_DEGREE
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.signals import Signal

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
    """Description of the value in the file."""
    line: int | None = None
    """Line of the file."""
    fault: str = ""
    index: int | None = None
    """The object of the simulated drive, by which a profile may explain a difference."""
    subindex: int = 0
    is_left_out: bool = False
    """True: the profile does not give the key, although the file has what it needs."""


# The standard objects, and what the master does with each.


@dataclass(frozen=True)
class Way:
    """A way to reach an object: in words, with the access types that permit it, and the PDO that it takes."""

    words: str
    access: tuple[str, ...]
    direction: Direction | None = None


class Use(Way, Enum):
    """Use of an object by the master."""

    READ = "read by SDO", ("ro", "rw", "rww", "rwr", "const")
    WRITTEN = "written by SDO", ("rw", "rww", "rwr", "wo")
    RECEIVED = "received in a PDO", ("rw", "rww", "wo"), Direction.RPDO
    SENT = "sent in a PDO", ("ro", "rw", "rwr", "const"), Direction.TPDO

    def permits(self, entry: EdsEntry | None) -> bool:
        """Return whether an entry is there, with an access type for this use."""
        return entry is not None and entry.access in self.access


@dataclass(frozen=True)
class StandardObject:
    """An object of CiA 301 or CiA 402-2 that the master uses."""

    key: str
    """Key of the profile that names the object, or that depends on it; empty: no key does."""
    index: int
    types: tuple[EdsType, ...]
    """Types that the object may have, that of the standard first; empty: the object is uploaded only where a profile
    names it."""
    use: Use
    _: KW_ONLY
    subindex: int = 0
    unit: str = ""
    """Unit of the standard; an EDS names none."""
    is_needed: bool = False
    """True: no force can be rendered without it."""
    is_offered: bool = False
    """True: a profile that leaves the key out gives the reason, where the file has the object."""
    is_read_back: bool = False
    """True: the object must be readable too, because the value is read back after it is written."""
    value: int | None = None
    """Value that a draft gives, and that the master writes."""
    meaning: str = ""
    """Meaning of `value` by the standard."""
    values: str = ""
    """Key of the values that are written, where they stand under another key."""
    of_current: int | None = None
    """Object of the same meaning for a drive that takes a current."""

    @property
    def entry(self) -> ObjectEntry:
        """The object with the type of the standard."""
        return ObjectEntry(self.index, DATA_TYPES[self.types[0]], self.subindex)

    def found(self, eds: Eds) -> EdsEntry | None:
        """Return the entry of a file; None where the file does not have it."""
        return eds.find(self.index, self.subindex)

    def is_usable(self, eds: Eds) -> bool:
        """Return whether the file has the object with an access type for its use."""
        entry = self.found(eds)
        return self.use.permits(entry) and (not self.is_read_back or Use.READ.permits(entry))

    def named(self, profile: Cia402Profile) -> ObjectEntry | None:
        """Return the object that a profile names at the key; None where the profile names none."""
        if self.key == "torque.echo":
            return profile.entries().get(Signal.TARGET_ASKED)
        value = value_at(profile, self.key)
        if isinstance(value, MappedObject | OptionCode | WrittenObject):
            return value.entry
        # True stands for the object of the standard, a number is an index.
        index = self.index if value is True else value
        return ObjectEntry(index, self.entry.type, self.subindex) if isinstance(index, int) and index else None


def value_at(profile: object, key: str) -> object:
    """Return the value at a key such as `torque.target.unit`; None where a table of it is not there."""
    for name in key.split("."):
        profile = getattr(profile, name, None)
    return profile


_INTEGER8, _INTEGER16, _INTEGER32 = (EdsType.INTEGER8,), (EdsType.INTEGER16,), (EdsType.INTEGER32,)
_UNSIGNED8, _UNSIGNED16, _UNSIGNED32 = (EdsType.UNSIGNED8,), (EdsType.UNSIGNED16,), (EdsType.UNSIGNED32,)
_TORQUE = _INTEGER16 + _INTEGER32
USABLE = "drive.usable"
STEEPEST = 1_000_000
"""Torque slope [‰ of rated torque per s]: rated torque in 1 ms."""
OBJECTS = (
    StandardObject(USABLE, 0x6040, _UNSIGNED16, Use.RECEIVED, is_needed=True),
    StandardObject(USABLE, 0x6041, _UNSIGNED16, Use.SENT, is_needed=True),
    StandardObject(USABLE, 0x6060, _INTEGER8, Use.WRITTEN, is_needed=True),
    StandardObject(USABLE, 0x6061, _INTEGER8, Use.READ, is_needed=True),
    StandardObject("", 0x6502, _UNSIGNED32, Use.READ),
    StandardObject("torque.target", 0x6071, _TORQUE, Use.RECEIVED, unit=PERMILLE, is_needed=True),
    StandardObject("torque.actual", 0x6077, _TORQUE, Use.SENT, unit=PERMILLE, is_offered=True, of_current=0x6078),
    StandardObject("torque.demand", 0x6074, _TORQUE, Use.SENT, unit=PERMILLE, is_offered=True),
    StandardObject("torque.rated", 0x6076, _UNSIGNED32, Use.READ, unit="mN·m", is_offered=True),
    StandardObject("torque.rated_current", 0x6075, (), Use.READ),
    StandardObject("position.actual", 0x6064, _INTEGER32, Use.SENT, is_needed=True),
    StandardObject("velocity.actual", 0x606C, _INTEGER32, Use.SENT),
    StandardObject("position.actual.unit", 0x60A8, _UNSIGNED32, Use.READ),
    StandardObject("velocity.actual.unit", 0x60A9, _UNSIGNED32, Use.READ),
    StandardObject("torque.echo", 0x6071, (), Use.READ),
    StandardObject("torque.slope", 0x6087, _UNSIGNED32, Use.WRITTEN, is_read_back=True, value=STEEPEST),
    StandardObject("link_loss.heartbeat_consumer", 0x1016, _UNSIGNED32, Use.WRITTEN, subindex=1, is_offered=True),
    StandardObject("link_loss.life_guarding", 0x100C, _UNSIGNED16, Use.WRITTEN),
    StandardObject("link_loss.life_guarding", 0x100D, _UNSIGNED8, Use.WRITTEN),
    StandardObject("link_loss.abort_connection_option", 0x6007, _INTEGER16, Use.WRITTEN, is_offered=True,
                   value=2, meaning="2 is disable voltage: the shaft is free"),
    StandardObject("link_loss.fault_reaction_option", 0x605E, _INTEGER16, Use.WRITTEN, is_offered=True,
                   value=0, meaning="0 is disable drive function, no ramp"),
    StandardObject("sync.interpolation_time", 0x60C2, _UNSIGNED8, Use.WRITTEN, subindex=1, is_offered=True,
                   is_read_back=True, values="sync.values"),
    StandardObject("sync.interpolation_time", 0x60C2, _INTEGER8, Use.WRITTEN, subindex=2, is_read_back=True,
                   values="sync.powers"),
    StandardObject("sync.cycle_period", 0x1006, _UNSIGNED32, Use.WRITTEN, is_offered=True, is_read_back=True),
)  # fmt: skip
"""In the order of a profile."""
BY_KEY = {row.key: row for row in reversed(OBJECTS)}
"""The first row of each key."""

# Values, types and units that an EDS gives, in the terms of a profile.

DATA_TYPES: Mapping[EdsType, DataType] = {
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
    return DATA_TYPES.get(entry.type) if entry.type is not None else None


def number_of(eds: Eds, index: int, subindex: int = 0) -> int | None:
    """Return the default value of an entry; None when there is none, or no number."""
    entry = eds.find(index, subindex)
    value = entry.value(ANY_NODE) if entry is not None else None
    return value if isinstance(value, int) else None


def axes_words(indices: Iterable[int]) -> str:
    """Return what to do about a node that has a value of each axis in a sub-index of its own."""
    named = ", ".join(f"{index:04X}h:01 and :02" for index in indices)
    advice = "write one profile per axis, with subindex = 1, 2 … in position.actual, torque.target and torque.actual"
    return f"several axes share this node, each in its own sub-index ({named}): {advice}"


def axes_in(eds: Eds) -> list[int]:
    """Return the objects that have a value of each of several axes in sub-indices."""
    no_values = (None, EdsType.UNSIGNED8)
    found = {index: (eds.find(index, 1), eds.find(index, 2)) for index in PER_AXIS}
    return [index for index, axes in found.items() if all(each and each.type not in no_values for each in axes)]


def object_name(index: int) -> str:
    """Return index and name of an object, as messages write it."""
    return f"{index:04X}h {NAMES[index]}"


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

"""The object dictionary of a simulated drive: entries with access rules, and the abort codes of refused accesses.

Reference: CiA 301 4.2, 7.2.4.3.17 (abort codes), 7.4.7 (access).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import KW_ONLY, InitVar, dataclass, field
from enum import Enum, Flag

from haptic_fieldbus.drive.profile import DataType


class AbortCode(Enum):
    """SDO abort codes (CiA 301, table 22)."""

    TOGGLE_BIT = 0x0503_0000
    TIMEOUT = 0x0504_0000
    UNKNOWN_COMMAND = 0x0504_0001
    BLOCK_SIZE = 0x0504_0002
    SEQUENCE_NUMBER = 0x0504_0003
    CRC = 0x0504_0004
    OUT_OF_MEMORY = 0x0504_0005
    UNSUPPORTED_ACCESS = 0x0601_0000
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    NOT_MAPPABLE = 0x0604_0041
    MAPPING_TOO_LONG = 0x0604_0042
    PARAMETER_INCOMPATIBLE = 0x0604_0043
    LENGTH = 0x0607_0010
    TOO_LONG = 0x0607_0012
    TOO_SHORT = 0x0607_0013
    NO_SUBINDEX = 0x0609_0011
    INVALID_VALUE = 0x0609_0030
    VALUE_TOO_HIGH = 0x0609_0031
    VALUE_TOO_LOW = 0x0609_0032
    CANNOT_STORE = 0x0800_0020
    DEVICE_STATE = 0x0800_0022
    NO_DATA = 0x0800_0024


class AccessRefused(Exception):
    """Error of a refused access; `code` is the SDO abort code."""

    def __init__(self, code: AbortCode | int) -> None:
        self.code = code.value if isinstance(code, AbortCode) else code
        super().__init__(f"{self.code:08X}h")


class Access(Enum):
    RO = "ro"
    WO = "wo"
    RW = "rw"
    CONST = "const"


class Mappable(Flag):
    """Kinds of PDO into which an entry may be mapped."""

    NO = 0
    TPDO = 1
    RPDO = 2
    BOTH = 3


@dataclass(slots=True, eq=False)
class Entry:
    """One sub-index. `value` is the last value written by a client or the drive; octets and strings are in `text`.

    `accept` may refuse a write by raising Refused; for octets its argument is their number. `changed` is called after a
    write, `fetch` computes the value that is read. `default` and `default_text` are the power-on values; for a
    `numbered` entry they contain the node-ID ($NODEID of an EDS).
    """

    index: int
    subindex: int
    type: DataType | None
    """None: a string or a DOMAIN of the octets `text`."""
    value: int = 0
    access: Access = Access.RO
    _: KW_ONLY
    limits: InitVar[tuple[int, int] | None] = None
    """Limits of the value, None: those of the type; without a type of the number of octets, None: no octet."""
    mappable: Mappable = Mappable.NO
    accept: Callable[[int], None] | None = None
    text: bytes = b""
    numbered: bool = False
    changed: Callable[[], None] | None = field(default=None, init=False)
    fetch: Callable[[], int] | None = field(default=None, init=False)
    default: int = field(init=False)
    default_text: bytes = field(init=False)
    low: int = field(init=False)
    high: int = field(init=False)

    def __post_init__(self, limits: tuple[int, int] | None) -> None:
        self.default, self.default_text = self.value, self.text
        self.low, self.high = limits or (self.type.limits if self.type is not None else (0, 0))

    @property
    def bits(self) -> int:
        return 8 * self.type.size if self.type is not None else 8 * len(self.text)

    def read(self) -> bytes:
        """Return the octets of the value for a link; raises Refused when the entry is write-only."""
        if self.access is Access.WO:
            raise AccessRefused(AbortCode.WRITE_ONLY)
        if self.type is None:
            return self.text
        return self.type.pack(self.fetch() if self.fetch is not None else self.value)

    def begin_write(self, size: int | None) -> None:
        """Raise Refused for a download of `size` octets (None: not known yet) that cannot be accepted."""
        if self.access in (Access.RO, Access.CONST) or (self.type is None and not self.high):
            raise AccessRefused(AbortCode.READ_ONLY)
        if size is not None and size > self.capacity:
            raise AccessRefused(AbortCode.TOO_LONG)
        if size is not None and size < self.capacity and self.type is not None:
            raise AccessRefused(AbortCode.TOO_SHORT)

    @property
    def capacity(self) -> int:
        """Return the largest number of octets that can be written."""
        return self.type.size if self.type is not None else self.high

    def write(self, data: bytes) -> None:
        """Write octets that came by a link.

        Raises Refused for a read-only entry, a wrong length, a value out of limits, or when `accept` refuses.
        """
        self.begin_write(len(data))
        if self.type is None:
            if self.accept is not None:
                self.accept(len(data))
            self.text = data
        else:
            value = self.type.unpack(data)
            if not self.low <= value <= self.high:
                raise AccessRefused(AbortCode.VALUE_TOO_HIGH if value > self.high else AbortCode.VALUE_TOO_LOW)
            if self.accept is not None:
                self.accept(value)
            self.value = value
        if self.changed is not None:
            self.changed()

    def start_with(self, value: int) -> None:
        """Set the value, now and at power-on."""
        self.value = self.default = value

    def reset(self) -> None:
        """Restore the power-on value."""
        self.value, self.text = self.default, self.default_text


def only_if(allows: Callable[[int], bool], code: AbortCode = AbortCode.INVALID_VALUE) -> Callable[[int], None]:
    """Return an `accept` that refuses every value that is not allowed, with this abort code."""

    def accept(value: int) -> None:
        if not allows(value):
            raise AccessRefused(code)

    return accept


def one_of(values: Iterable[int], code: AbortCode = AbortCode.INVALID_VALUE) -> Callable[[int], None]:
    """Return an `accept` that refuses every other value, with this abort code."""
    return only_if(frozenset(values).__contains__, code)


class Dictionary:
    """All entries by index and sub-index."""

    def __init__(self, entries: Iterable[Entry] = ()) -> None:
        self._objects: dict[int, dict[int, Entry]] = {}
        for entry in entries:
            self.add(entry)

    def __iter__(self) -> Iterator[Entry]:
        for subentries in self._objects.values():
            yield from subentries.values()

    def __contains__(self, index: int) -> bool:
        return index in self._objects

    def add(self, entry: Entry) -> Entry:
        """Add an entry, replacing one with the same index and sub-index, and return it."""
        self._objects.setdefault(entry.index, {})[entry.subindex] = entry
        return entry

    def renumber(self, change: int) -> None:
        """Add `change` to the power-on values that contain the node-ID."""
        for entry in self:
            entry.default += change * entry.numbered

    def remove(self, index: int, subindex: int | None = None) -> None:
        """Remove an object, or one sub-index of it, that this model lacks; unknown ones are ignored."""
        subentries = self._objects.get(index, {})
        subentries.pop(-1 if subindex is None else subindex, None)
        if subindex is None or not subentries:
            self._objects.pop(index, None)

    def add_record(self, entries: Iterable[Entry]) -> None:
        """Add the sub-indices of one record, and sub-index 0 with the highest of them."""
        members = [self.add(entry) for entry in entries]
        highest = max(entry.subindex for entry in members)
        self.add(Entry(members[0].index, 0, DataType.UINT8, highest, Access.CONST))

    def find(self, index: int, subindex: int = 0) -> Entry:
        """Return the entry; raises Refused when the object or its sub-index does not exist."""
        if (subentries := self._objects.get(index)) is None:
            raise AccessRefused(AbortCode.NO_OBJECT)
        if (entry := subentries.get(subindex)) is None:
            raise AccessRefused(AbortCode.NO_SUBINDEX)
        return entry

    def value(self, index: int, subindex: int = 0) -> int:
        """Return the value of an entry for the drive itself, without access rules; 0 when there is no such entry."""
        entry = self._objects.get(index, {}).get(subindex)
        return entry.value if entry is not None else 0

    def restore(self, first: int, last: int) -> None:
        """Restore the power-on values of the objects from `first` to `last`."""
        for entry in self:
            if first <= entry.index <= last:
                entry.reset()

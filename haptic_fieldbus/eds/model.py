"""The content of an EDS or DCF as values: the result of reading, and the input of writing.

Reference: CiA 306-1, object description and device information; CiA 301 4.2, table 42 (object codes).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from haptic_fieldbus.eds.names import EdsType
from haptic_fieldbus.errors import Fault

ACCESS_TYPES = ("ro", "wo", "rw", "rwr", "rww", "const")
"""rwr and rww: readable and writable by SDO; as a mapped object rwr is only sent (TPDO), rww only received (RPDO)."""


@dataclass(frozen=True)
class NodeOffset:
    """A value that depends on the node-ID: `$NODEID+0x180`."""

    offset: int

    def at(self, node: int) -> int:
        """Return the value for a device with this node-ID."""
        return self.offset + node


EdsValue = int | float | str | bytes | NodeOffset
"""A value of an entry as the file gives it, before the node-ID is known."""


class ObjectCode(IntEnum):
    """The kind of an object (CiA 301 4.2, table 42); the value stands behind `ObjectType=`."""

    DOMAIN = 0x02
    DEFTYPE = 0x05
    DEFSTRUCT = 0x06
    VAR = 0x07
    ARRAY = 0x08
    RECORD = 0x09


@dataclass(frozen=True)
class EdsEntry:
    """One sub-index of an object; None where the file gives nothing usable."""

    index: int
    subindex: int
    name: str
    type: EdsType | None
    """None when it is missing, or no basic data type, so that only the device has its structure."""
    access: str
    """One of `ACCESS_TYPES`."""
    default: EdsValue | None = None
    parameter: EdsValue | None = None
    """Configured value (`ParameterValue`): of a DCF, or of a tool that wrote it into an EDS."""
    low: int | float | None = None
    high: int | float | None = None
    mappable: bool = False
    """Whether a PDO may carry the entry (`PDOMapping=1`)."""
    line: int | None = None

    @property
    def formula(self) -> EdsValue | None:
        """The value after power-on for any node-ID: the configured value, else the default, else None."""
        return self.parameter if self.parameter is not None else self.default

    def value(self, node: int) -> int | float | str | bytes | None:
        """Return the value after power-on of the device with this node-ID; None when the file gives none."""
        chosen = self.formula
        return chosen.at(node) if isinstance(chosen, NodeOffset) else chosen


@dataclass(frozen=True)
class EdsObject:
    """One object and its entries by sub-index; a simple variable has sub-index 0 only."""

    index: int
    name: str
    code: ObjectCode
    entries: Mapping[int, EdsEntry] = field(default_factory=dict)
    line: int | None = None

    @property
    def is_simple(self) -> bool:
        """Whether the object's own section describes it, without sections of sub-indices."""
        return self.code not in (ObjectCode.ARRAY, ObjectCode.RECORD, ObjectCode.DEFSTRUCT)


@dataclass(frozen=True)
class DeviceInfo:
    """The section `[DeviceInfo]`; None where the file gives nothing usable."""

    vendor_name: str = ""
    vendor_number: int | None = None
    product_name: str = ""
    product_number: int | None = None
    revision_number: int | None = None
    order_code: str = ""
    bit_rates: tuple[int, ...] = ()
    """Supported bit rates [kbit/s]."""
    rpdos: int | None = None
    tpdos: int | None = None
    granularity: int = 8
    """Unit of PDO mapping [bit]."""
    lss: bool = False


@dataclass(frozen=True)
class Eds:
    """One file; `faults` lists its mistakes, none of which prevented it from being read."""

    objects: Mapping[int, EdsObject]
    device: DeviceInfo = field(default_factory=DeviceInfo)
    node: int | None = None
    """Node-ID of a DCF; None in an EDS."""
    dummies: tuple[int, ...] = ()
    """Indices of data types that may be mapped as unused space."""
    file_info: Mapping[str, str] = field(default_factory=dict)
    comments: tuple[str, ...] = ()
    source: str = ""
    faults: tuple[Fault, ...] = ()

    def __iter__(self) -> Iterator[EdsEntry]:
        """Yield all entries of all objects."""
        for item in self.objects.values():
            yield from item.entries.values()

    def __contains__(self, index: int) -> bool:
        return index in self.objects

    def find(self, index: int, subindex: int = 0) -> EdsEntry | None:
        """Return the entry; None when the device does not have it."""
        found = self.objects.get(index)
        return found.entries.get(subindex) if found is not None else None

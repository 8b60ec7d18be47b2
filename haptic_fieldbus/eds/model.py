"""What an EDS or DCF says of a device, as values: the result of reading, and what is written.

Reference: CiA 306-1, object description and device information; CiA 301 4.2, table 42 (object codes).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from haptic_fieldbus.eds.types import EdsType
from haptic_fieldbus.errors import Fault

ACCESS_TYPES = ("ro", "wo", "rw", "rwr", "rww", "const")
"""rwr: readable and writable by SDO, as a mapped object only sent (TPDO); rww: only received (RPDO)."""


@dataclass(frozen=True)
class NodeOffset:
    """A value that follows the node-ID: `$NODEID+0x180`."""

    offset: int

    def at(self, node: int) -> int:
        return self.offset + node


EdsValue = int | float | str | bytes | NodeOffset


class ObjectCode(IntEnum):
    """What an object is; the value is what stands behind `ObjectType=`."""

    DOMAIN = 0x02
    DEFTYPE = 0x05
    DEFSTRUCT = 0x06
    VAR = 0x07
    ARRAY = 0x08
    RECORD = 0x09


@dataclass(frozen=True)
class EdsEntry:
    """One sub-index; None where the file says nothing (usable)."""

    index: int
    subindex: int
    name: str
    type: EdsType | None
    """None: missing, or a structure that only the device knows."""
    access: str
    """One of `ACCESS_TYPES`."""
    default: EdsValue | None = None
    parameter: EdsValue | None = None
    """What a DCF, or a tool that wrote into an EDS, gives as the configured value."""
    low: int | float | None = None
    high: int | float | None = None
    mappable: bool = False
    """`PDOMapping=1`."""
    line: int | None = None

    @property
    def formula(self) -> EdsValue | None:
        """What stands there after power-on: the configured value, or the default."""
        return self.parameter if self.parameter is not None else self.default

    def value(self, node: int) -> int | float | str | bytes | None:
        """The same for the device with this node-ID."""
        chosen = self.formula
        return chosen.at(node) if isinstance(chosen, NodeOffset) else chosen


@dataclass(frozen=True)
class EdsObject:
    """One object with its sub-indices; a simple variable has sub-index 0 only."""

    index: int
    name: str
    code: ObjectCode
    entries: Mapping[int, EdsEntry] = field(default_factory=dict)
    line: int | None = None

    @property
    def is_simple(self) -> bool:
        """Described by its own section, without those of sub-indices."""
        return self.code not in (ObjectCode.ARRAY, ObjectCode.RECORD, ObjectCode.DEFSTRUCT)


@dataclass(frozen=True)
class DeviceInfo:
    """`[DeviceInfo]`; None where the file says nothing."""

    vendor_name: str = ""
    vendor_number: int | None = None
    product_name: str = ""
    product_number: int | None = None
    revision_number: int | None = None
    order_code: str = ""
    bit_rates: tuple[int, ...] = ()
    """[kbit/s]"""
    rpdos: int | None = None
    tpdos: int | None = None
    granularity: int = 8
    """Bits: the unit of mapping."""
    lss: bool = False


@dataclass(frozen=True)
class Eds:
    """One file; `faults` lists what is wrong in it, none of which kept it from being read."""

    objects: Mapping[int, EdsObject]
    device: DeviceInfo = field(default_factory=DeviceInfo)
    node: int | None = None
    """Node-ID of a DCF."""
    dummies: tuple[int, ...] = ()
    """Data types that may be mapped as space that is not used."""
    file_info: Mapping[str, str] = field(default_factory=dict)
    comments: tuple[str, ...] = ()
    source: str = ""
    faults: tuple[Fault, ...] = ()

    def __iter__(self) -> Iterator[EdsEntry]:
        for item in self.objects.values():
            yield from item.entries.values()

    def __contains__(self, index: int) -> bool:
        return index in self.objects

    def find(self, index: int, subindex: int = 0) -> EdsEntry | None:
        """The entry, or None when the device does not have it."""
        found = self.objects.get(index)
        return found.entries.get(subindex) if found is not None else None

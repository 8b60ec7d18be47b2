"""A simulated drive with the object dictionary of a vendor's EDS.

Objects that the simulated drive implements keep their behaviour and take access, type, limits, mappability and power-on
value from the file. Other objects of the file become plain storage. Objects that the file does not have are removed.
Values that describe the bench rather than the model (rated torque and current, ramps, encoder and gear) stay those of
the rig, because a file gives them for some other motor and without a unit. REAL32 is stored as its octets and BOOLEAN
as one octet. Larger types, and types that the file leaves open, are stored as octets that cannot be mapped.
"""

import struct
from collections.abc import Callable, Iterator, Mapping

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType, NodeOffset
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.vendor.pdos import COMMUNICATION, MAPPING, MOST_ENTRIES, pdo_shape
from haptic_fieldbus.protocols.canopen.vendor.values import data_type
from haptic_fieldbus.sim.canopen.services.cob_id import INVALID
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, Dictionary, Entry, Mappable, Refused

STRING_OCTETS = 256
"""Capacity of a string that can be written."""
DOMAIN_OCTETS = 32 * 1024
"""Capacity of a DOMAIN."""
UNKNOWN_OCTETS = 8
"""Capacity of an entry whose type the file leaves open."""
BENCH_VALUES = frozenset((0x6075, 0x6076, 0x6081, 0x6083, 0x6084, 0x6085, 0x608F, 0x6090, 0x6091, 0x6092))
"""Rated current and torque, profile velocity, ramps and factors, which follow from the rig."""
COMMUNICATION_PROFILE = range(0x1000, 0x2000)
"""Objects whose types and limits stay those of CiA 301: one file limits 1016h to 65535, which names no node."""
SHOWN_VALUES = frozenset((0x1000, 0x1008, 0x1009, 0x100A, 0x1018, 0x6502))
"""Read-only objects whose values are taken from the file; the drive computes its other read-only values itself."""
MANDATORY = frozenset(((0x1000, 0), (0x1001, 0), (0x1018, 0), (0x1018, 1)))
"""Entries that every CANopen device has (CiA 301, 7.5.2), whether its file names them or not."""
_PDO_RECORDS = range(0x1400, 0x1C00)
_LEFT_OPEN = {0: 2, 1: INVALID, 2: 255}
"""Values of a communication record by sub-index where the file gives none: no identifier, event-driven."""
_DUMMIES = range(2, 8)
_MAX_BITS = 64
_ACCESS = {access.value: access for access in Access} | {"rwr": Access.RW, "rww": Access.RW}
_WAYS = {
    "ro": Mappable.TPDO, "const": Mappable.TPDO, "rwr": Mappable.TPDO,
    "wo": Mappable.RPDO, "rww": Mappable.RPDO, "rw": Mappable.BOTH,
}  # fmt: skip


def extend(dictionary: Dictionary, eds: Eds, node: int) -> tuple[str, ...]:
    """Turn the dictionary into that of the file, for this node-ID.

    Returns notes, in words, on the PDOs that could not be taken over.
    """
    implemented = {(entry.index, entry.subindex): entry for entry in dictionary}
    pdos = _records(eds)
    _take_away(dictionary, eds)
    for described in eds:
        entry = implemented.get((described.index, described.subindex))
        if entry is not None and _understood(entry, described):
            _take_over(entry, described, node)
        elif described.index not in _PDO_RECORDS or (described.index in pdos and not _beyond(described)):
            dictionary.add(_stored(described, node))
    notes = (*_lone(eds, pdos), *_set_up_pdos(dictionary, implemented, eds, node))
    for entry in dictionary:
        source = eds.find(entry.index, entry.subindex)
        entry.numbered = source is not None and isinstance(source.formula, NodeOffset)
    return notes


def _records(eds: Eds) -> frozenset[int]:
    """Return the indices of the records of all PDOs that have both."""
    first = (COMMUNICATION[way].start - 1 + number for way in Direction for number in pdo_shape(eds, way))
    return frozenset(index + part for index in first for part in (0, MAPPING))


def _lone(eds: Eds, pdos: frozenset[int]) -> Iterator[str]:
    """Yield a note on each record of a PDO that lacks its other one."""
    for index in eds.objects:
        if index in _PDO_RECORDS and index not in pdos:
            yield f"{index:04X}h: the other record of this PDO is missing; it is left out"


def _beyond(described: EdsEntry) -> bool:
    """Return whether this is a mapping entry that no PDO can have (CiA 301, 7.5.2.36)."""
    return described.index & MAPPING != 0 and described.subindex > MOST_ENTRIES


def _understood(entry: Entry, described: EdsEntry) -> bool:
    """Return whether the drive can work with every value that the file allows for an entry.

    Counter-example from a vendor's file: 60E1h as INTEGER16 with the default −1000, where CiA 402-2 has an UNSIGNED16.
    Taken over as it is, it would reverse the limit. Such an object becomes storage, and the drive uses its own value.
    """
    type = data_type(described)
    if type is None or entry.type is None or type is entry.type:
        return type is entry.type
    # Another type is acceptable for a value that the master writes, unless it allows values below the drive's range.
    shown = entry.access in (Access.RO, Access.CONST)
    return not shown and _limits(described, type)[0] >= entry.type.limits[0]


def _take_away(dictionary: Dictionary, eds: Eds) -> None:
    """Remove the entries that the file does not have."""
    for entry in list(dictionary):
        if eds.find(entry.index, entry.subindex) is None and (entry.index, entry.subindex) not in MANDATORY:
            dictionary.remove(entry.index, entry.subindex)


def _take_over(entry: Entry, described: EdsEntry, node: int) -> None:
    """Give an entry that the drive implements the properties that it has in the file."""
    shown, measured = entry.access in (Access.RO, Access.CONST), entry.access is Access.RO
    entry.access, entry.mappable = _ACCESS[described.access], _mappable(described)
    if entry.index in BENCH_VALUES or (measured and entry.index not in SHOWN_VALUES):
        return
    type, value = data_type(described), described.value(node)
    if type is not None and entry.type is not None and not shown and entry.index not in COMMUNICATION_PROFILE:
        entry.type, (entry.low, entry.high) = type, _limits(described, type)
    if isinstance(value, int) and entry.type is not None:
        entry.value = entry.default = value
    elif isinstance(value, str) and entry.type is None:
        entry.text = entry.default_text = value.encode()


def _mappable(described: EdsEntry) -> Mappable:
    return _WAYS[described.access] if described.mappable else Mappable.NO


def _limits(described: EdsEntry, type: DataType) -> tuple[int, int]:
    """Return the limits of the file if they leave a range that contains the default, else those of the type."""
    low, high = type.limits
    asked = (
        described.low if isinstance(described.low, int) else low,
        described.high if isinstance(described.high, int) else high,
    )
    default = described.default if isinstance(described.default, int) else asked[0]
    return asked if asked[0] < asked[1] and asked[0] <= default <= asked[1] else (low, high)


# Objects that the drive does not implement.


def _stored(described: EdsEntry, node: int) -> Entry:
    """Return an entry that only stores its value."""
    access, value = _ACCESS[described.access], described.value(node)
    type = data_type(described)
    if type is not None:
        low, high = _limits(described, type)
        # Without a default in the file: 0, or the limit nearest to it.
        initial = value if isinstance(value, int) else max(low, min(high, 0))
        return Entry(described.index, described.subindex, type, initial, access,
                     limits=(low, high), mappable=_mappable(described))  # fmt: skip
    if described.type is EdsType.REAL32:
        bits = int.from_bytes(struct.pack("<f", value if isinstance(value, float) else 0.0), "little")
        return Entry(described.index, described.subindex, DataType.UINT32, bits, access, mappable=_mappable(described))
    if described.type is EdsType.BOOLEAN:
        flag = value if isinstance(value, int) else 0
        return Entry(described.index, described.subindex, DataType.UINT8, flag, access, limits=(0, 1))
    return _octets(described, access, value)


def _octets(described: EdsEntry, access: Access, value: int | float | str | bytes | None) -> Entry:
    size = described.type.size if described.type is not None else None
    entry = Entry(described.index, described.subindex, None, access=access, text=_initial(described, value, size),
                  capacity=size or _room(described.type))  # fmt: skip
    if size is not None:
        entry.accept = _whole(size)
    return entry


def _room(type: EdsType | None) -> int:
    if type is None:
        return UNKNOWN_OCTETS
    return DOMAIN_OCTETS if type is EdsType.DOMAIN else STRING_OCTETS


def _initial(described: EdsEntry, value: int | float | str | bytes | None, size: int | None) -> bytes:
    """Return the octets of a default value."""
    if isinstance(value, str):
        return value.encode("utf-16-le" if described.type is EdsType.UNICODE_STRING else "utf-8")
    if isinstance(value, bytes):
        return value
    if described.type is EdsType.REAL64:
        return struct.pack("<d", value or 0.0)
    if described.type is not None and size is None:
        return b""
    number = value if isinstance(value, int) else 0
    return number.to_bytes(size or UNKNOWN_OCTETS // 2, "little", signed=number < 0)


def _whole(size: int) -> Callable[[int], None]:
    """Return an `accept` that refuses fewer octets than a type of this size has."""

    def accept(octets: int) -> None:
        if octets != size:
            raise Refused(AbortCode.TOO_SHORT)

    return accept


# PDOs.


def _set_up_pdos(
    dictionary: Dictionary, implemented: Mapping[tuple[int, int], Entry], eds: Eds, node: int
) -> Iterator[str]:
    """Give the PDOs their power-on values of the file; switch off each PDO that cannot work and yield a note on it.

    An entry of a PDO that the file lacks is out of reach, but the drive works with it all the same.
    """
    records: dict[int, dict[int, Entry]] = {}
    for (index, subindex), entry in implemented.items():
        if index in _PDO_RECORDS:
            records.setdefault(index, {})[subindex] = entry
    for direction, way in ((Direction.RPDO, Mappable.RPDO), (Direction.TPDO, Mappable.TPDO)):
        for index in (COMMUNICATION[direction].start - 1 + number for number in pdo_shape(eds, direction)):
            communication, mapping = records[index], records[index + MAPPING]
            for subindex, entry in communication.items():
                _default(entry, _given(eds, index, subindex, node), _LEFT_OPEN.get(subindex, 0))
            for subindex, entry in mapping.items():
                _default(entry, _given(eds, index + MAPPING, subindex, node), 0)
            reason = _unmappable(dictionary, mapping, way)
            if reason:
                yield f"{index + MAPPING:04X}h: {reason}; this PDO is left without objects"
                _default(mapping[0], 0, 0)
                _default(communication[1], communication[1].default | INVALID, INVALID)


def _given(eds: Eds, index: int, subindex: int, node: int) -> int | None:
    described = eds.find(index, subindex)
    value = described.value(node) if described is not None else None
    return value if isinstance(value, int) else None


def _default(entry: Entry, value: int | None, otherwise: int) -> None:
    entry.value = entry.default = otherwise if value is None else value


def _unmappable(dictionary: Dictionary, record: Mapping[int, Entry], way: Mappable) -> str:
    """Return why the mapping of a PDO cannot work, empty when it can.

    Objects that the file itself maps become mappable, even if their entry in the file forbids it.
    """
    bits = 0
    for position in range(1, record[0].default + 1):
        if position not in record:
            return f"there are fewer than {record[0].default} entries"
        mapping = record[position].default
        bits += mapping & 0xFF
        if way is Mappable.RPDO and mapping >> 16 in _DUMMIES:
            continue
        try:
            target = dictionary.find(mapping >> 16, mapping >> 8 & 0xFF)
        except Refused:
            return f"{mapping:08X}h names an object that does not exist"
        if target.type is None or target.bits != mapping & 0xFF:
            return f"{mapping:08X}h has another length than its object"
        target.mappable |= way
    return f"{bits} bits do not fit into a PDO" if bits > _MAX_BITS else ""

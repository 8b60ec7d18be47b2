"""The node of one model of drive: its object dictionary and its options, from a profile or a vendor's EDS."""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType, NodeOffset
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.eds_pdos import COMMUNICATION, MAPPING, MOST_ENTRIES, pdo_shape
from haptic_fieldbus.protocols.canopen.eds_values import data_type
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile
from haptic_fieldbus.protocols.canopen.pdo import Direction, FixedPdo
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, SimulatedObject
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim.canopen.services.basics import INVALID, NO_RTR
from haptic_fieldbus.sim.canopen.services.pdo import PdoDefaults
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Dictionary, Entry, Mappable, one_of
from haptic_fieldbus.sim.drive.settings import DriveSettings

# Properties by which the nodes of different models differ, and the PDOs after power-on.

_PREDEFINED = range(1, 5)
"""Numbers of the PDOs of each direction that have a predefined identifier (CiA 301, table 39)."""


@dataclass(frozen=True)
class NodeOptions:
    """Properties of a model: its PDOs, the object of its heartbeat consumers, the action time of RPDOs, its reset time.

    `consumer` is the index of the heartbeat consumer object, None when the model has none.
    """

    rpdos: list[PdoDefaults]
    tpdos: list[PdoDefaults]
    consumer: int | None = 0x1016
    acts_at_sync: bool = False
    reset_ns: int = 0


def node_options(node: int, profile: CanopenProfile, settings: DriveSettings) -> NodeOptions:
    """Return the options of a node as its profile and settings describe them.

    After power-on all PDOs are event-driven, with the predefined identifiers; only the first of each direction is
    valid.
    """
    signals = profile.entries()
    status, control = signals[Signal.STATUSWORD], signals[Signal.CONTROLWORD]
    # Seconds to the steps of 100 µs of 1800h:03.
    inhibit = round(profile.pdo.inhibit_time_default * 1e4)
    measured = signals.get(Signal.POSITION) or signals[Signal.VELOCITY]
    first = 0x200 + node, 0x180 + node
    rpdos = _defaults(_shape(profile, Direction.RPDO), first[0], 0, control, signals[Signal.TARGET_TORQUE])
    tpdos = _defaults(_shape(profile, Direction.TPDO), first[1], inhibit, status, measured)
    if not isinstance(profile, EdsProfile):  # the file of the vendor says more of the PDOs, and is taken over later
        rpdos += _fixed(profile.pdo.rpdo_fixed, first[0], 0)
        tpdos += _fixed(profile.pdo.tpdo_fixed, first[1], inhibit)
    return NodeOptions(
        rpdos=[replace(rpdo, sync_honoured=profile.simulation.sync_honoured) for rpdo in rpdos],
        tpdos=tpdos,
        consumer=profile.link_loss.heartbeat_consumer,
        acts_at_sync=profile.pdo.rpdo_acts == "next_sync",
        reset_ns=settings.reset_ns,
    )


def _shape(profile: CanopenProfile, direction: Direction) -> dict[int, int]:
    """Return the number of mapping entries of each PDO that the model has, by the number of the PDO."""
    if isinstance(profile, EdsProfile):
        return pdo_shape(profile.eds, direction)
    return {number: room for number, room in profile.pdo.room(direction).items() if room}


def _defaults(
    shape: dict[int, int], first_id: int, inhibit: int, word: ObjectEntry, value: ObjectEntry
) -> list[PdoDefaults]:
    """Return the PDOs of one direction.

    PDO 1 maps the word, PDO 2 word and value if its mapping has room for two, the others nothing.
    """
    mappings = {1: (word.mapping,), 2: (word.mapping, value.mapping)}
    return [
        PdoDefaults(
            number=number,
            cob_id=_cob_id(first_id, number),
            mapping=mappings[number] if len(mappings.get(number, ())) in range(1, entries + 1) else (),
            max_entries=entries,
            inhibit_time=inhibit,
        )
        for number, entries in shape.items()
    ]


def _fixed(pdos: Sequence[FixedPdo], first_id: int, inhibit: int) -> list[PdoDefaults]:
    """Return the PDOs with mappings that cannot be written."""
    return [
        PdoDefaults(each.number, _cob_id(first_id, each.number), each.maps, len(each.maps), inhibit, fixed=True)
        for each in pdos
    ]


def _cob_id(first_id: int, number: int) -> int:
    identifier = first_id + 0x100 * (number - 1) if number in _PREDEFINED else 0
    return (0 if number == 1 else INVALID) | NO_RTR | identifier


# A simulated drive with the object dictionary of a vendor's EDS.
#
# Objects that the simulated drive implements keep their behaviour and take access, type, limits, mappability and
# power-on value from the file. Other objects of the file become plain storage. Objects that the file does not have are
# removed. Values that describe the bench rather than the model (rated torque and current, ramps, encoder and gear) stay
# those of the rig, because a file gives them for some other motor and without a unit. REAL32 is stored as its octets
# and BOOLEAN as one octet. Larger types, and types that the file leaves open, are stored as octets that cannot be
# mapped.

SIGNED_LIMITS = (0x60E0, 0x60E1)
"""Torque limits that some drives have as INTEGER16."""
STRING_OCTETS = 256
"""Capacity of a string that can be written."""
DOMAIN_OCTETS = 32 * 1024
"""Capacity of a DOMAIN."""
UNKNOWN_OCTETS = 8
"""Capacity of an entry whose type the file leaves open."""
BENCH_VALUES = frozenset((0x6075, 0x6076, 0x6081, 0x6083, 0x6084, 0x6085, 0x608F, 0x6090, 0x6091, 0x6092))
"""Rated current and torque, profile velocity, ramps and factors, which follow from the rig."""
COMMUNICATION_PROFILE = range(0x1000, 0x2000)
"""Objects whose types and limits stay those of CiA 301: one file limits 1016h to 65535, without room for a node-ID."""
SHOWN_VALUES = frozenset((0x1000, 0x1008, 0x1009, 0x100A, 0x1018, 0x6502))
"""Read-only objects whose values are taken from the file; the drive computes its other read-only values itself."""
MANDATORY = frozenset(((0x1000, 0), (0x1001, 0), (0x1018, 0), (0x1018, 1)))
"""Entries that every CANopen device has (CiA 301, 7.5.2), whether its file names them or not."""
_PDO_RECORDS = range(0x1400, 0x1C00)
_LEFT_OPEN = {0: 2, 1: INVALID, 2: 255}
"""Default values of a communication record by sub-index, if the file gives none: no identifier, event-driven."""
_DUMMIES = range(2, 8)
_MAX_BITS = 64
ACCESS = {access.value: access for access in Access} | {"rwr": Access.RW, "rww": Access.RW}
"""Access type of an EDS → access of an entry."""
WAYS = {
    "ro": Mappable.TPDO, "const": Mappable.TPDO, "rwr": Mappable.TPDO,
    "wo": Mappable.RPDO, "rww": Mappable.RPDO, "rw": Mappable.BOTH,
}  # fmt: skip
"""Access type of an EDS → PDOs into which a mappable entry may be mapped."""


def extend(dictionary: Dictionary, eds: Eds, node: int) -> tuple[str, ...]:
    """Turn the dictionary into that of the file, for this node-ID.

    Returns notes, in words, on the PDOs that could not be taken over.
    """
    implemented = {(entry.index, entry.subindex): entry for entry in dictionary}
    # The records of all PDOs that have both.
    first = [COMMUNICATION[way].start - 1 + number for way in Direction for number in pdo_shape(eds, way)]
    pdos = frozenset(index + part for index in first for part in (0, MAPPING))
    for key in implemented:
        if key not in MANDATORY and eds.find(*key) is None:
            dictionary.remove(*key)
    for described in eds:
        entry = implemented.get((described.index, described.subindex))
        if entry is not None and _understood(entry, described):
            _take_over(entry, described, node)
        elif described.index not in _PDO_RECORDS or (
            # CiA 301, 7.5.2.36: no PDO can have further mapping entries.
            described.index in pdos and (not described.index & MAPPING or described.subindex <= MOST_ENTRIES)
        ):
            dictionary.add(_stored_entry(described, node))
    lone = [
        f"{index:04X}h: the other record of this PDO is missing; the PDO is omitted"
        for index in eds.objects
        if index in _PDO_RECORDS and index not in pdos
    ]
    notes = (*lone, *_set_up_pdos(dictionary, implemented, eds, node))
    for entry in dictionary:
        source = eds.find(entry.index, entry.subindex)
        entry.numbered = source is not None and isinstance(source.formula, NodeOffset)
    return notes


def _understood(entry: Entry, described: EdsEntry) -> bool:
    """Return whether the drive can work with every value that the file allows for an entry.

    A torque limit may be signed: a vendor's file has 60E1h as INTEGER16 with the default −1000, where CiA 402-2 has an
    UNSIGNED16. It is then the lowest torque itself.
    """
    type = data_type(described)
    if entry.index in SIGNED_LIMITS and type is DataType.INT16:
        return True
    if type is None or entry.type is None or type is entry.type:
        return type is entry.type
    # Another type is acceptable for a value that the master writes, unless it allows values below the drive's range.
    shown = entry.access in (Access.RO, Access.CONST)
    return not shown and _limits(described, type)[0] >= entry.type.limits[0]


def _take_over(entry: Entry, described: EdsEntry, node: int) -> None:
    """Set the properties of an implemented entry to those in the file."""
    shown, measured = entry.access in (Access.RO, Access.CONST), entry.access is Access.RO
    entry.access, entry.mappable = ACCESS[described.access], _ways(described.access, described.mappable)
    if entry.index in BENCH_VALUES or (measured and entry.index not in SHOWN_VALUES):
        return
    type, value = data_type(described), described.value(node)
    if type is not None and entry.type is not None and not shown and entry.index not in COMMUNICATION_PROFILE:
        entry.type, (entry.low, entry.high) = type, _limits(described, type)
    if isinstance(value, int) and entry.type is not None:
        entry.start_with(value)
    elif isinstance(value, str) and entry.type is None:
        entry.text = entry.default_text = value.encode()


def _limits(described: EdsEntry, type: DataType) -> tuple[int, int]:
    """Return the limits of the file if their range contains the default, otherwise the limits of the type."""
    low, high = type.limits
    asked = (
        described.low if isinstance(described.low, int) else low,
        described.high if isinstance(described.high, int) else high,
    )
    default = described.default if isinstance(described.default, int) else asked[0]
    return asked if asked[0] < asked[1] and asked[0] <= default <= asked[1] else (low, high)


# Objects that the drive does not implement.


def _stored_entry(described: EdsEntry, node: int) -> Entry:
    """Return an entry that only stores its value."""
    access, value = ACCESS[described.access], described.value(node)
    mappable = _ways(described.access, described.mappable)
    if (type := data_type(described)) is not None:
        low, high = _limits(described, type)
        # Without a default in the file: 0, or the limit nearest to it.
        initial = value if isinstance(value, int) else max(low, min(high, 0))
        return Entry(described.index, described.subindex, type, initial, access,
                     limits=(low, high), mappable=mappable)  # fmt: skip
    if described.type is EdsType.REAL32:
        bits = int.from_bytes(struct.pack("<f", value if isinstance(value, float) else 0.0), "little")
        return Entry(described.index, described.subindex, DataType.UINT32, bits, access, mappable=mappable)
    if described.type is EdsType.BOOLEAN:
        flag = value if isinstance(value, int) else 0
        return Entry(described.index, described.subindex, DataType.UINT8, flag, access, limits=(0, 1))
    return _octets(described, access, value)


def _octets(described: EdsEntry, access: Access, value: int | float | str | bytes | None) -> Entry:
    size = described.type.size if described.type is not None else None
    room = {None: UNKNOWN_OCTETS, EdsType.DOMAIN: DOMAIN_OCTETS}.get(described.type, STRING_OCTETS)
    accept = None if size is None else one_of((size,), AbortCode.TOO_SHORT)
    return Entry(described.index, described.subindex, None, access=access, text=_initial(described, value, size),
                 limits=(0, size or room), accept=accept)  # fmt: skip


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


# PDOs.


def _set_up_pdos(
    dictionary: Dictionary, implemented: Mapping[tuple[int, int], Entry], eds: Eds, node: int
) -> Iterator[str]:
    """Set the PDOs to the power-on values of the file; switch off each PDO that cannot work and yield a note on it.

    An entry of a PDO that the file lacks is not accessible, but the drive still uses it.
    """
    for direction, way in ((Direction.RPDO, Mappable.RPDO), (Direction.TPDO, Mappable.TPDO)):
        for index in (COMMUNICATION[direction].start - 1 + number for number in pdo_shape(eds, direction)):
            communication = {subindex: entry for (at, subindex), entry in implemented.items() if at == index}
            mapping = {subindex: entry for (at, subindex), entry in implemented.items() if at == index + MAPPING}
            for subindex, entry in communication.items():
                entry.start_with(_given(eds, index, subindex, node, _LEFT_OPEN.get(subindex, 0)))
            for subindex, entry in mapping.items():
                entry.start_with(_given(eds, index + MAPPING, subindex, node, 0))
            if reason := _unmappable(dictionary, mapping, way):
                yield f"{index + MAPPING:04X}h: {reason}; this PDO is left without objects"
                mapping[0].start_with(0)
                communication[1].start_with(communication[1].default | INVALID)


def _given(eds: Eds, index: int, subindex: int, node: int, otherwise: int) -> int:
    """Return the power-on value in the file; `otherwise` where it gives none."""
    described = eds.find(index, subindex)
    value = described.value(node) if described is not None else None
    return value if isinstance(value, int) else otherwise


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
        except AccessRefused:
            return f"{mapping:08X}h names an object that does not exist"
        if target.type is None or target.bits != mapping & 0xFF:
            return f"{mapping:08X}h has another length than its object"
        target.mappable |= way
    return f"{bits} bits do not fit into a PDO" if bits > _MAX_BITS else ""


# The object dictionary of a simulated drive as its profile describes it, in [simulation.objects].
#
# An object that the simulated drive implements keeps its behaviour and takes access, limits, mappability and power-on
# value from the description; one with another type, and one that the drive does not implement, only stores its value. A
# torque limit may be signed.
# What is not described stays as it is, since a profile lists differences alone.

_MAPPINGS = (*range(0x1600, 0x1800), *range(0x1A00, 0x1C00))
_LAST_DUMMY = 0x0007
NODE_ID = re.compile(r"\$NODEID\s*\+\s*(0x[0-9A-Fa-f]+|\d+)")
"""A value that contains the node-ID."""
OCTETS = 256
"""Capacity of an entry without a type."""


def install_described(dictionary: Dictionary, objects: Mapping[str, SimulatedObject], node: int) -> None:
    """Make the dictionary hold the described objects, for this node-ID."""
    present = {(entry.index, entry.subindex): entry for entry in dictionary}
    for name, described in objects.items():
        for index, subindex in entries_of(name):
            entry = present.get((index, subindex))
            if described.absent:
                dictionary.remove(index, subindex)
            elif entry is not None and index in SIGNED_LIMITS and described.type is DataType.INT16:
                entry.type, (entry.low, entry.high) = described.type, described.type.limits
                _change(entry, described, node)
            elif entry is None or (described.type is not None and described.type is not entry.type):
                dictionary.add(_stored(index, subindex, described, node))
            else:
                _change(entry, described, node)
    _check_mappings(dictionary)


def _check_mappings(dictionary: Dictionary) -> None:
    """Raise UsageError for a PDO that after power-on maps an object that the drive does not have."""
    for count in [entry for entry in dictionary if entry.subindex == 0 and entry.index in _MAPPINGS]:
        for subindex in range(1, min(count.default, MOST_ENTRIES) + 1):
            mapping = dictionary.value(count.index, subindex)
            if mapping >> 16 not in dictionary and mapping >> 16 > _LAST_DUMMY:
                raise UsageError(
                    f"simulation.objects: {count.index:04X}h:{subindex:02X} maps {mapping:08X}h, which the drive "
                    "lacks; add this object, or let the PDO map nothing"
                )


def entries_of(name: str) -> Iterator[tuple[int, int]]:
    """Yield index and sub-index of each entry that a key of [simulation.objects] names.

    All numbers are hexadecimal, and each may be a range: "6007", "60C2:01", "1400-1403:01-02".
    """
    indices, _, subindices = name.partition(":")
    yield from product(_range(indices), _range(subindices or "0"))


def _range(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first, 16), int(last or first, 16) + 1)


def _stored(index: int, subindex: int, described: SimulatedObject, node: int) -> Entry:
    """Return an entry that only stores its value; without a type it stores octets."""
    access = described.access or "ro"
    ways = _ways(access, described.mappable)
    entry = Entry(
        index,
        subindex,
        described.type,
        access=ACCESS[access],
        mappable=ways,
        limits=(0, OCTETS) if described.type is None else None,
    )
    _set_limits(entry, described)
    _set_value(entry, described.value if described.value is not None else max(entry.low, min(entry.high, 0)), node)
    return entry


def _change(entry: Entry, described: SimulatedObject, node: int) -> None:
    """Apply the description of an object to an implemented entry."""
    if described.access is not None:
        entry.access = ACCESS[described.access]
    if described.mappable is not None or (described.access is not None and entry.mappable):
        access = described.access or ("rw" if entry.access is Access.RW else entry.access.value)
        entry.mappable = _ways(access, described.mappable is not False)
    _set_limits(entry, described)
    if described.value is not None:
        _set_value(entry, described.value, node)


def _ways(access: str, mappable: bool | None) -> Mappable:
    return WAYS[access] if mappable else Mappable.NO


def _set_limits(entry: Entry, described: SimulatedObject) -> None:
    if entry.type is not None:
        entry.low = entry.low if described.low is None else described.low
        entry.high = entry.high if described.high is None else described.high
        # A value of the bench, such as a ramp, may be beyond them.
        entry.start_with(max(entry.low, min(entry.high, entry.default)))


def _set_value(entry: Entry, value: int | str, node: int) -> None:
    """Set the power-on value; a number with the node-ID changes with it."""
    if entry.type is None:
        entry.text = entry.default_text = str(value).encode()
        return
    offset = NODE_ID.fullmatch(value) if isinstance(value, str) else None
    entry.numbered = offset is not None
    entry.start_with(int(offset[1], 0) + node if offset is not None else int(value))

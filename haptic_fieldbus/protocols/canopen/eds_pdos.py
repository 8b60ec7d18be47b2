"""The PDOs of an EDS, and what the file lacks for a drive."""

from collections.abc import Iterator, Mapping

from haptic_fieldbus.drive.cia402 import VelocitySection
from haptic_fieldbus.eds import Eds, EdsEntry, EdsObject, EdsType
from haptic_fieldbus.protocols.canopen.eds_values import (
    RECEIVED,
    SENT,
    WRITABLE,
    axes_in,
    axes_words,
    is_mappable,
    number_of,
    object_name,
    position_unit,
    supported_modes,
)
from haptic_fieldbus.protocols.canopen.pdo import LARGEST_PAYLOAD, OCTETS, Direction, FixedPdo
from haptic_fieldbus.protocols.canopen.profile import PdoSection

# The PDOs of an EDS: which there are, and the room that each has for a mapping of ours.
#
# A PDO is there when both of its records are. Their numbers may have gaps: some drives have only every other one.

COMMUNICATION = {Direction.RPDO: range(0x1400, 0x1600), Direction.TPDO: range(0x1800, 0x1A00)}
"""Communication records of each direction."""
MAPPING = 0x200
"""Difference of index from the communication record of a PDO to its mapping record."""
MOST_ENTRIES = 64
"""Largest number of mapping entries of one PDO."""
_EVENT_DRIVEN = 255
_INHIBIT_UNIT = 1e-4
"""Unit of the inhibit time, 1800h:03 [s]."""
_USUAL_TYPES = (1, 254, 255)
"""Transmission types that CiA 301 lets one expect; an EDS does not list those of the drive."""


def pdo_shape(eds: Eds, direction: Direction) -> dict[int, int]:
    """Return the highest mapping entry of each PDO of a direction, by the number of the PDO."""
    records = COMMUNICATION[direction]
    present = sorted(index for index in eds.objects if index in records and index + MAPPING in eds)
    return {index - records.start + 1: _highest(eds.objects[index + MAPPING]) for index in present}


def pdo_room(eds: Eds, direction: Direction) -> dict[int, int]:
    """Return the mapping entries of each PDO that can be written, by its number; 0 for a mapping that is fixed."""
    first = COMMUNICATION[direction].start - 1
    return {number: _room(eds, first + number) for number in pdo_shape(eds, direction)}


def fixed_pdos(eds: Eds, direction: Direction) -> tuple[FixedPdo, ...]:
    """Return the PDOs with a mapping that cannot be written, but that can be switched on and used as they are."""
    first, rooms = COMMUNICATION[direction].start - 1, pdo_room(eds, direction)
    found = {number: _held(eds, first + number) for number, room in rooms.items() if not room}
    return tuple(FixedPdo(number, maps) for number, maps in found.items() if maps and _is_usable(eds, first + number))


def _held(eds: Eds, index: int) -> tuple[int, ...]:
    """Return the values of the mapping entries of a PDO; none where one is unknown, or no frame carries them."""
    count = number_of(eds, index + MAPPING, 0) or 0
    values = [number_of(eds, index + MAPPING, each) or 0 for each in range(1, min(count, MOST_ENTRIES) + 1)]
    fits = sum(value & 0xFF for value in values) <= 8 * LARGEST_PAYLOAD
    return tuple(values) if fits and all(value & 0xFF in OCTETS for value in values) else ()


def _is_usable(eds: Eds, index: int) -> bool:
    """Return whether a PDO can be switched on, with the transmission type that the loop needs."""
    cob_id, kind = eds.find(index, 1), eds.find(index, 2)
    if cob_id is None or cob_id.access not in WRITABLE or kind is None:
        return False
    needed = 1 if index in COMMUNICATION[Direction.TPDO] else _EVENT_DRIVEN
    return kind.access in WRITABLE or number_of(eds, index, 2) == needed


def carries(eds: Eds, direction: Direction, entry: EdsEntry) -> bool:
    """Return whether a PDO of a direction carries an entry, or can be mapped anew so that it does."""
    access = RECEIVED if direction is Direction.RPDO else SENT
    if is_mappable(entry, access) and any(pdo_room(eds, direction).values()):
        return True
    bits = 8 * entry.type.size if entry.type is not None and entry.type.size is not None else 0
    value = entry.index << 16 | entry.subindex << 8 | bits
    return any(value in each.maps for each in fixed_pdos(eds, direction))


def pdo_section(eds: Eds) -> PdoSection:
    """Return the PDOs of a file: their numbers, the room of each, and the longest inhibit time of any."""
    rooms = {direction: pdo_room(eds, direction) for direction in Direction}
    entries = max((room for each in rooms.values() for room in each.values()), default=0) or 1
    irregular = {direction: _listed(room, entries) for direction, room in rooms.items()}
    return PdoSection(
        tpdo_types=_types(eds, Direction.TPDO),
        rpdo_types=_types(eds, Direction.RPDO),
        tpdos=len(rooms[Direction.TPDO]),
        rpdos=len(rooms[Direction.RPDO]),
        entries=entries,
        tpdo_entries=irregular[Direction.TPDO],
        rpdo_entries=irregular[Direction.RPDO],
        tpdo_fixed=fixed_pdos(eds, Direction.TPDO),
        rpdo_fixed=fixed_pdos(eds, Direction.RPDO),
        inhibit_time_default=inhibit_time(eds),
    )


def inhibit_time(eds: Eds) -> float:
    """Return the longest inhibit time of any TPDO after power-on [s]."""
    first = COMMUNICATION[Direction.TPDO].start - 1
    times = (number_of(eds, first + number, 3) or 0 for number in pdo_shape(eds, Direction.TPDO))
    return round(max(times, default=0) * _INHIBIT_UNIT, 4)


def default_types(eds: Eds, direction: Direction) -> set[int]:
    """Return the transmission types that the PDOs of a direction have after power-on."""
    first = COMMUNICATION[direction].start - 1
    found = {number_of(eds, first + number, 2) for number in pdo_shape(eds, direction)}
    return {kind for kind in found if kind is not None}


def _types(eds: Eds, direction: Direction) -> tuple[int, ...]:
    """Return the usual transmission types and those of the file, without types that the file's limits forbid."""
    types = {kind for kind in default_types(eds, direction) if 0 <= kind <= 0xFF}
    low, high = type_limits(eds, direction)
    return tuple(sorted(types | {kind for kind in _USUAL_TYPES if low <= kind <= high}))


def type_limits(eds: Eds, direction: Direction) -> tuple[int, int]:
    """Return the limits that the file sets for the transmission types of a direction."""
    first = COMMUNICATION[direction].start - 1
    found = [eds.find(first + number, 2) for number in pdo_shape(eds, direction)]
    lows = [entry.low for entry in found if entry is not None and isinstance(entry.low, int)]
    highs = [entry.high for entry in found if entry is not None and isinstance(entry.high, int)]
    low, high = max(lows, default=0), min(highs, default=0xFF)
    # Limits that leave nothing are a slip of the file.
    return (low, high) if low < high else (0, 0xFF)


def _highest(mapping: EdsObject) -> int:
    return max((subindex for subindex in mapping.entries if subindex <= MOST_ENTRIES), default=0)


def _room(eds: Eds, index: int) -> int:
    """Return the entries of a PDO that can be written one after another, 0 when its mapping is fixed."""
    mapping, cob_id = eds.objects[index + MAPPING].entries, eds.find(index, 1)
    if cob_id is None or cob_id.access not in WRITABLE or 0 not in mapping or mapping[0].access not in WRITABLE:
        return 0
    most = mapping[0].high
    limit = most if isinstance(most, int) and 0 < most <= MOST_ENTRIES else MOST_ENTRIES
    count = 0
    while count < limit and count + 1 in mapping and mapping[count + 1].access in WRITABLE:
        count += 1
    return count


def _listed(room: dict[int, int], entries: int) -> tuple[int, ...]:
    """Return the entries of PDO 1, 2, 3 … where they differ from `entries`, 0 for one that is not there."""
    highest = max(room, default=0)
    listed = tuple(room.get(number, 0) for number in range(1, highest + 1))
    return listed if any(each != entries for each in listed) else ()


# What a vendor's file lacks: for a drive of CiA 402 at all, and for force.

CYCLIC_TORQUE, PROFILE_TORQUE = 10, 4
"""Modes of operation (6060h)."""
TORQUE_TYPES = (EdsType.INTEGER16, EdsType.INTEGER32)
NEEDED: Mapping[int, tuple[EdsType, ...]] = {
    0x6040: (EdsType.UNSIGNED16,),
    0x6041: (EdsType.UNSIGNED16,),
    0x6060: (EdsType.INTEGER8,),
    0x6061: (EdsType.INTEGER8,),
    0x6064: (EdsType.INTEGER32,),
    0x6071: TORQUE_TYPES,
}
"""Objects without which no force can be rendered → types that each may have; 606Ch may replace 6064h."""
AUTOMATON = (0x6040, 0x6041)
"""Objects without which there is no drive of CiA 402."""
MAPPED = {0x6040: Direction.RPDO, 0x6041: Direction.TPDO, 0x6064: Direction.TPDO, 0x6071: Direction.RPDO}
"""Objects that the cycle maps → direction of the PDO."""
_WAYS = {Direction.RPDO: (RECEIVED, "received"), Direction.TPDO: (SENT, "sent")}
"""Direction → access types that an object needs to be mapped anew, and the word for it."""
Lack = tuple[str, int | None]
"""What is missing in words, and the line of the file that shows it; None when there is no such line."""


def automaton_lacks(eds: Eds) -> Iterator[Lack]:
    """Yield each lack that makes this no drive of CiA 402."""
    for index in AUTOMATON:
        yield from _object_lacks(eds, index)


def force_lacks(eds: Eds, mode: int | None, velocity: VelocitySection | None) -> Iterator[Lack]:
    """Yield each lack that keeps the drive from rendering force; `velocity` replaces the position where it is given."""
    for index in NEEDED:
        if index == 0x6064 and velocity is not None:  # the position is integrated from the velocity instead
            continue
        lacks = list(_object_lacks(eds, index))
        yield from lacks
        entry = eds.find(index)
        if not lacks and entry is not None and index in MAPPED:
            yield from _mapping_lacks(eds, entry, MAPPED[index])
    if velocity is None and position_unit(eds) is None:
        code = (number_of(eds, 0x60A8) or 0) & 0xFFFF_FFFF
        yield f"60A8h SI unit position is {code:08X}h, expected 00B50000h (counts) or FF410000h (0.1 degrees)", None
    several = axes_in(eds)
    if several:
        yield axes_words(several), eds.objects[several[0]].line
    for direction in (Direction.RPDO, Direction.TPDO):
        yield from _pdo_lacks(eds, direction)
    if not mode and not torque_mode(eds):
        modes = eds.find(0x6502)
        yield f"{object_name(0x6502)} {supported_modes(eds):X}h names no torque mode", modes.line if modes else None


def torque_mode(eds: Eds) -> int:
    """Return the mode of operation for torque: cyclic before profile torque, 0 when the drive has neither.

    A file without supported drive modes is trusted to have the cyclic one.
    """
    modes = supported_modes(eds)
    if not modes:
        return CYCLIC_TORQUE
    # Bit n − 1 of 6502h stands for mode n.
    return next((mode for mode in (CYCLIC_TORQUE, PROFILE_TORQUE) if modes >> mode - 1 & 1), 0)


def _object_lacks(eds: Eds, index: int) -> Iterator[Lack]:
    entry, types = eds.find(index), NEEDED[index]
    if entry is None:
        yield f"there is no {object_name(index)}", None
    elif entry.type not in types:
        found = entry.type.name if entry.type is not None else "of an unknown type"
        yield f"{object_name(index)} is {found}, expected {' or '.join(type.name for type in types)}", entry.line


def _mapping_lacks(eds: Eds, entry: EdsEntry, direction: Direction) -> Iterator[Lack]:
    """Yield why no PDO carries an object: it cannot be mapped, or no fixed mapping has it."""
    if carries(eds, direction, entry) or not pdo_shape(eds, direction):
        return
    access, word = _WAYS[direction]
    if any(pdo_room(eds, direction).values()) or not is_mappable(entry, access):
        yield f"{object_name(entry.index)} cannot be {word} in a PDO", entry.line
        return
    first = COMMUNICATION[direction].start
    found = eds.objects[first + MAPPING + min(pdo_shape(eds, direction)) - 1]
    records = f"{first:04X}h and {first + MAPPING:04X}h"
    yield (
        f"no {direction.value} that can be switched on carries {object_name(entry.index)}, and none can be mapped "
        f"anew: their records are not writable ({records} and on)",
        found.line,
    )


def _pdo_lacks(eds: Eds, direction: Direction) -> Iterator[Lack]:
    if not pdo_shape(eds, direction):
        first = COMMUNICATION[direction].start
        yield f"there is no {direction.value} ({first:04X}h and {first + MAPPING:04X}h)", None

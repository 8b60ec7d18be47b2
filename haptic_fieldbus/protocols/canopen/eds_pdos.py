"""The PDOs of an EDS, and what the file lacks for a drive."""

from collections.abc import Iterator
from itertools import takewhile

from haptic_fieldbus.drive.cia402 import VelocitySection
from haptic_fieldbus.eds import Eds, EdsEntry
from haptic_fieldbus.protocols.canopen import eds_values
from haptic_fieldbus.protocols.canopen.eds_values import OBJECTS, USABLE, StandardObject, Use, number_of, object_name
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


def records(eds: Eds, direction: Direction) -> dict[int, int]:
    """Return the index of the communication record of each PDO of a direction, by the number of the PDO."""
    every = COMMUNICATION[direction]
    return {index - every.start + 1: index for index in every if index in eds and index + MAPPING in eds}


def pdo_shape(eds: Eds, direction: Direction) -> dict[int, int]:
    """Return the highest mapping entry of each PDO of a direction, by the number of the PDO."""
    return {
        number: max((each for each in eds.objects[index + MAPPING].entries if each <= MOST_ENTRIES), default=0)
        for number, index in records(eds, direction).items()
    }


def pdo_room(eds: Eds, direction: Direction) -> dict[int, int]:
    """Return the mapping entries of each PDO that can be written, by its number; 0 for a mapping that is fixed."""
    return {number: _room(eds, index) for number, index in records(eds, direction).items()}


def _room(eds: Eds, index: int) -> int:
    """Return the entries of a PDO that can be written one after another, 0 when its mapping is fixed."""
    mapping = eds.objects[index + MAPPING].entries
    if not Use.WRITTEN.permits(eds.find(index, 1)) or not Use.WRITTEN.permits(mapping.get(0)):
        return 0
    most = mapping[0].high
    limit = most if isinstance(most, int) and 0 < most <= MOST_ENTRIES else MOST_ENTRIES
    return len([*takewhile(lambda each: Use.WRITTEN.permits(mapping.get(each)), range(1, limit + 1))])


def fixed_pdos(eds: Eds, direction: Direction) -> tuple[FixedPdo, ...]:
    """Return the PDOs with a read-only mapping that can be switched on and used as they are."""
    found = {number: _held(eds, index) for number, index in records(eds, direction).items() if not _room(eds, index)}
    first = COMMUNICATION[direction].start - 1
    return tuple(FixedPdo(number, maps) for number, maps in found.items() if maps and _is_usable(eds, first + number))


def _held(eds: Eds, index: int) -> tuple[int, ...]:
    """Return the values of the mapping entries of a PDO; none where one is unknown, or no frame carries them."""
    count = number_of(eds, index + MAPPING, 0) or 0
    values = [number_of(eds, index + MAPPING, each) or 0 for each in range(1, min(count, MOST_ENTRIES) + 1)]
    fits = sum(value & 0xFF for value in values) <= 8 * LARGEST_PAYLOAD
    return tuple(values) if fits and all(value & 0xFF in OCTETS for value in values) else ()


def _is_usable(eds: Eds, index: int) -> bool:
    """Return whether a PDO can be switched on, with the transmission type that the loop needs."""
    needed = 1 if index in COMMUNICATION[Direction.TPDO] else _EVENT_DRIVEN
    has_type = Use.WRITTEN.permits(eds.find(index, 2)) or number_of(eds, index, 2) == needed
    return has_type and Use.WRITTEN.permits(eds.find(index, 1))


def carries(eds: Eds, direction: Direction, entry: EdsEntry) -> bool:
    """Return whether a PDO of a direction carries an entry, or can be mapped anew so that it does."""
    if is_mappable(entry, direction) and any(pdo_room(eds, direction).values()):
        return True
    bits = 8 * entry.type.size if entry.type is not None and entry.type.size is not None else 0
    value = entry.index << 16 | entry.subindex << 8 | bits
    return any(value in each.maps for each in fixed_pdos(eds, direction))


def is_mappable(entry: EdsEntry, direction: Direction) -> bool:
    """Return whether a PDO of a direction may be mapped anew to carry an entry."""
    return entry.mappable and (Use.RECEIVED if direction is Direction.RPDO else Use.SENT).permits(entry)


def pdo_section(eds: Eds) -> PdoSection:
    """Return the PDOs of a file: their numbers, the room of each, and the longest inhibit time of any."""
    rooms = {direction: pdo_room(eds, direction) for direction in Direction}
    entries = max((room for each in rooms.values() for room in each.values()), default=0) or 1
    return PdoSection(
        tpdo_types=_types(eds, Direction.TPDO),
        rpdo_types=_types(eds, Direction.RPDO),
        tpdos=len(rooms[Direction.TPDO]),
        rpdos=len(rooms[Direction.RPDO]),
        entries=entries,
        tpdo_entries=_listed(rooms[Direction.TPDO], entries),
        rpdo_entries=_listed(rooms[Direction.RPDO], entries),
        tpdo_fixed=fixed_pdos(eds, Direction.TPDO),
        rpdo_fixed=fixed_pdos(eds, Direction.RPDO),
        inhibit_time_default=inhibit_time(eds),
    )


def inhibit_time(eds: Eds) -> float:
    """Return the longest inhibit time of any TPDO after power-on [s]."""
    times = (number_of(eds, index, 3) or 0 for index in records(eds, Direction.TPDO).values())
    return round(max(times, default=0) * _INHIBIT_UNIT, 4)


def default_types(eds: Eds, direction: Direction) -> set[int]:
    """Return the transmission types that the PDOs of a direction have after power-on."""
    return {kind for index in records(eds, direction).values() if (kind := number_of(eds, index, 2)) is not None}


def _types(eds: Eds, direction: Direction) -> tuple[int, ...]:
    """Return the usual transmission types and those of the file, without types that the file's limits forbid."""
    types = {kind for kind in default_types(eds, direction) if 0 <= kind <= 0xFF}
    low, high = type_limits(eds, direction)
    return tuple(sorted(types | {kind for kind in _USUAL_TYPES if low <= kind <= high}))


def type_limits(eds: Eds, direction: Direction) -> tuple[int, int]:
    """Return the limits that the file sets for the transmission types of a direction."""
    found = [entry for index in records(eds, direction).values() if (entry := eds.find(index, 2)) is not None]
    low = max((entry.low for entry in found if isinstance(entry.low, int)), default=0)
    high = min((entry.high for entry in found if isinstance(entry.high, int)), default=0xFF)
    # Limits that leave nothing are a slip of the file.
    return (low, high) if low < high else (0, 0xFF)


def _listed(room: dict[int, int], entries: int) -> tuple[int, ...]:
    """Return the entries of PDO 1, 2, 3 … where they differ from `entries`, 0 for one that is not there."""
    listed = tuple(room.get(number, 0) for number in range(1, max(room, default=0) + 1))
    return listed if any(each != entries for each in listed) else ()


# What a vendor's file lacks: for a drive of CiA 402 at all, and for force.

CYCLIC_TORQUE, PROFILE_TORQUE = TORQUE_MODES = 10, 4
"""Modes of operation (6060h) of CiA 402-2 with a target torque: cyclic synchronous torque, profile torque."""
Lack = tuple[str, int | None]
"""Missing part in words, and the line of the file that shows it; None when there is no such line."""


def automaton_lacks(eds: Eds) -> Iterator[Lack]:
    """Yield a sentence for each missing object without which this is no CiA 402 drive: controlword, statusword."""
    for row in OBJECTS:
        if row.key == USABLE and row.use.direction is not None:
            yield from _object_lacks(eds, row)


def force_lacks(eds: Eds, mode: int | None, velocity: VelocitySection | None) -> Iterator[Lack]:
    """Yield a sentence for each missing object that force needs; `velocity` replaces the position where it is given."""
    for row in sorted(OBJECTS, key=lambda row: row.index):
        # Without a position it is integrated from the velocity.
        if row.is_needed and (velocity is None or row.key != "position.actual"):
            yield from _object_lacks(eds, row) or _mapping_lacks(eds, row)
    if velocity is None and eds_values.position_unit(eds) is None:
        code = (number_of(eds, 0x60A8) or 0) & 0xFFFF_FFFF
        yield f"60A8h SI unit position is {code:08X}h, expected 00B50000h (counts) or FF410000h (0.1 degrees)", None
    if several := eds_values.axes_in(eds):
        yield eds_values.axes_words(several), eds.objects[several[0]].line
    for direction in (Direction.RPDO, Direction.TPDO):
        if not records(eds, direction):
            yield f"there is no {direction.value} ({_first_records(direction)})", None
    if not mode and not torque_mode(eds):
        modes, named = eds.find(0x6502), f"{object_name(0x6502)} {eds_values.supported_modes(eds):X}h"
        yield f"{named} names no torque mode", modes.line if modes else None


def torque_mode(eds: Eds) -> int:
    """Return the mode of operation for torque: cyclic before profile torque, 0 when the drive has neither.

    If the file does not state the supported drive modes, the cyclic mode is assumed.
    """
    modes = eds_values.supported_modes(eds)
    if not modes:
        return CYCLIC_TORQUE
    # Bit n − 1 of 6502h stands for mode n.
    return next((mode for mode in TORQUE_MODES if modes >> mode - 1 & 1), 0)


def _object_lacks(eds: Eds, row: StandardObject) -> list[Lack]:
    entry = row.found(eds)
    if entry is None:
        return [(f"there is no {object_name(row.index)}", None)]
    if entry.type in row.types:
        return []
    found = entry.type.name if entry.type is not None else "of an unknown type"
    expected = " or ".join(type.name for type in row.types)
    return [(f"{object_name(row.index)} is {found}, expected {expected}", entry.line)]


def _mapping_lacks(eds: Eds, row: StandardObject) -> Iterator[Lack]:
    """Yield why no PDO carries an object: it cannot be mapped, or no fixed mapping has it."""
    entry, direction = row.found(eds), row.use.direction
    if entry is None or direction is None or carries(eds, direction, entry):
        return
    present, name, kind = records(eds, direction), object_name(row.index), direction.value
    if present and (any(pdo_room(eds, direction).values()) or not is_mappable(entry, direction)):
        yield f"{name} cannot be {row.use.words}", entry.line
    elif present:
        why = f"their records are read-only ({_first_records(direction)} and on)"
        line = eds.objects[min(present.values()) + MAPPING].line
        yield f"no active {kind} carries {name}, and no {kind} can be remapped: {why}", line


def _first_records(direction: Direction) -> str:
    first = COMMUNICATION[direction].start
    return f"{first:04X}h and {first + MAPPING:04X}h"

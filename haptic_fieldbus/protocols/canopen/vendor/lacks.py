"""What a vendor's file lacks: for a drive of CiA 402 at all, and for force."""

from collections.abc import Iterator, Mapping

from haptic_fieldbus.drive.cia402 import VelocitySection
from haptic_fieldbus.eds import Eds, EdsEntry, EdsType
from haptic_fieldbus.protocols.canopen.pdo import Direction
from haptic_fieldbus.protocols.canopen.vendor.pdos import COMMUNICATION, MAPPING, carries, pdo_room, pdo_shape
from haptic_fieldbus.protocols.canopen.vendor.values import (
    RECEIVED,
    SENT,
    axes_in,
    axes_words,
    is_mappable,
    number_of,
    object_name,
    position_unit,
    supported_modes,
)

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

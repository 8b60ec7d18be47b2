"""The PDOs of one drive, configured by SDO: those that the plan uses are mapped and switched on, the others are off.

A mapping that is fixed in the drive is read and compared instead of written, and of the other parameters of its PDO
only those are written that differ.

Reference: CiA 301 7.5.2.35 to 38 (PDO communication and mapping parameters).
"""

from collections.abc import Callable, Sequence
from functools import partial

from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.buses.canopen.preparing import ensure
from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.pdo import Direction, Pdo
from haptic_fieldbus.protocols.canopen.traffic import BusMember

COB_ID_INVALID = 0x8000_0000
"""Bit 31 of a PDO's COB-ID: the PDO is switched off."""
COB_ID_NO_RTR = 0x4000_0000
"""Bit 30 of a TPDO's COB-ID: no remote frames. It keeps its value, since many drives have it fixed."""


def map_pdos(node: Node, member: BusMember) -> None:
    """Switch all PDOs of a drive off, and map and switch on those that it exchanges; raises BusError."""
    for direction, pdos in ((Direction.TPDO, member.traffic.tpdos), (Direction.RPDO, member.traffic.rpdos)):
        used = {pdo.number: pdo for pdo in pdos}
        # In the order of the numbers: a PDO beyond the fourth takes the COB-ID of one that is off by then.
        for number, room in sorted(member.profile.pdo.room(direction).items()):
            # A PDO without room for a mapping may not be there at all.
            cob_id = _switch_off(node, direction, number, node.read if room else node.optional)
            if number in used:
                _map(node, used[number], cob_id, inhibited=bool(member.profile.pdo.inhibit_time_default))


def _switch_off(node: Node, direction: Direction, number: int, read: Callable[[ObjectEntry], int | None]) -> int:
    """Make the PDO invalid if it is not, and return its COB-ID as the drive then holds it."""
    entry = _communication(direction, number, DataType.UINT32, 1)
    cob_id = COB_ID_INVALID if (held := read(entry)) is None else held
    if not cob_id & COB_ID_INVALID:
        cob_id |= COB_ID_INVALID
        node.write(entry, cob_id)
    return cob_id


def _map(node: Node, pdo: Pdo, cob_id: int, *, inhibited: bool) -> None:
    """Map a PDO in the order of CiA 301 7.5.2: invalid (done), no entries, entries, their number, type, valid."""
    if pdo.fixed:
        _check_fixed(node, pdo)
    else:
        node.write(ObjectEntry(pdo.mapping_index, DataType.UINT8, 0), 0)
        for subindex, entry in enumerate(pdo.entries, start=1):
            node.write(ObjectEntry(pdo.mapping_index, DataType.UINT32, subindex), entry.mapping)
        node.write(ObjectEntry(pdo.mapping_index, DataType.UINT8, 0), len(pdo.entries))
    write = partial(ensure, node) if pdo.fixed else node.write
    write(_communication(pdo.direction, pdo.number, DataType.UINT8, 2), pdo.transmission_type)
    # By CiA 301 an inhibit time does not delay a synchronous TPDO; not every drive is known to keep to it.
    if pdo.direction is Direction.TPDO and (not pdo.synchronous or inhibited):
        write(_communication(pdo.direction, pdo.number, DataType.UINT16, 3), 0)
    valid = pdo.cob_id | (cob_id & COB_ID_NO_RTR)
    node.write(_communication(pdo.direction, pdo.number, DataType.UINT32, 1), valid)


def _check_fixed(node: Node, pdo: Pdo) -> None:
    """Raise BusConfigurationError when the drive maps otherwise than its profile says."""
    count = node.read(ObjectEntry(pdo.mapping_index, DataType.UINT8, 0))
    places = [ObjectEntry(pdo.mapping_index, DataType.UINT32, each) for each in range(1, count + 1)]
    held, said = [node.read(place) for place in places], [entry.mapping for entry in pdo.entries]
    if held != said:
        raise BusConfigurationError(
            f"{node.label}: {pdo.mapping_index:04X}h maps {_mappings(held)} into {pdo.name}; the profile says "
            f"{_mappings(said)}. Correct pdo.{pdo.direction.value.lower()}_fixed in the profile"
        )


def _mappings(values: Sequence[int]) -> str:
    return ", ".join(f"{value:08X}h" for value in values) or "nothing"


def _communication(direction: Direction, number: int, kind: DataType, subindex: int) -> ObjectEntry:
    return ObjectEntry((0x1800 if direction is Direction.TPDO else 0x1400) + number - 1, kind, subindex)

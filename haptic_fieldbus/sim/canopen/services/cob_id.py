"""COB-IDs: the bits above the identifier, and identifiers that no parameter may name.

Reference: CiA 301 4.2, 7.3.5 (CAN-IDs of restricted use), 7.5.2.35 and 7.5.2.37 (bits 29 to 31).
"""

from haptic_fieldbus.sim.drive.dictionary import AbortCode, Refused

INVALID = 1 << 31
"""Set: the communication object does not exist (of TIME: it is not consumed while clear)."""
NO_RTR = 1 << 30
"""Of a TPDO: no remote frame asks for it. Of SYNC and TIME: the node produces it."""
EXTENDED = 1 << 29
ID = 0x7FF

# CiA 301, table 41.
_RESTRICTED = (
    range(0x080), range(0x101, 0x181), range(0x581, 0x600), range(0x601, 0x680), range(0x6E0, 0x700),
    range(0x701, 0x800),
)  # fmt: skip


def is_restricted(can_id: int) -> bool:
    """Whether the standard keeps an 11-bit identifier for other purposes."""
    return any(can_id in identifiers for identifiers in _RESTRICTED)


def refuse_move(value: int, *, exists: bool, becomes: bool, can_id: int) -> None:
    """Refused for an extended or restricted identifier, and for a new one while the object exists."""
    new_id = value & ID
    if value & EXTENDED or (exists and becomes and new_id != can_id) or (becomes and is_restricted(new_id)):
        raise Refused(AbortCode.INVALID_VALUE)

"""COB-IDs: the bits above the identifier, and the identifiers of restricted use.

Reference: CiA 301 4.2, 7.3.5 (CAN-IDs of restricted use), 7.5.2.35 and 7.5.2.37 (bits 29 to 31).
"""

from haptic_fieldbus.sim.drive.dictionary import AbortCode, Refused

INVALID = 1 << 31
"""Set: the communication object does not exist. In the COB-ID of TIME the bit set means that TIME is consumed."""
NO_RTR = 1 << 30
"""TPDO: no remote frame may request it. SYNC and TIME: the node produces it."""
EXTENDED = 1 << 29
"""Set: the identifier has 29 bits, which no object here accepts."""
ID = 0x7FF
"""Mask of the 11-bit identifier."""

# CiA 301, table 41.
_RESTRICTED = (
    range(0x080), range(0x101, 0x181), range(0x581, 0x600), range(0x601, 0x680), range(0x6E0, 0x700),
    range(0x701, 0x800),
)  # fmt: skip


def is_restricted(can_id: int) -> bool:
    """Return whether the standard reserves an 11-bit identifier for other purposes."""
    return any(can_id in identifiers for identifiers in _RESTRICTED)


def refuse_move(value: int, *, exists: bool, becomes: bool, can_id: int) -> None:
    """Check a new COB-ID of an object that `exists` now with `can_id`, and `becomes` existent with the new value.

    Raises Refused for an extended identifier, for a restricted one, and for another one while the object exists.
    """
    new_id = value & ID
    if value & EXTENDED or (exists and becomes and new_id != can_id) or (becomes and is_restricted(new_id)):
        raise Refused(AbortCode.INVALID_VALUE)

"""Manufacturer-specific objects of the simulated drive: memory for the user's data.

5FF0h *user data memory* (DOMAIN, rw): two blocks of up to 32 KiB that share 48 KiB, so that a client can try long
transfers and a full memory. Volatile unless saved by 1010h.

5FF2h *erase user data memory* (UNSIGNED32, wo): *eras* in ASCII empties both blocks.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, Dictionary, Entry, Refused, one_of

USER_DATA_MEMORY = 0x5FF0
ERASE_USER_DATA_MEMORY = 0x5FF2
BLOCK_OCTETS = 32 * 1024
SHARED_OCTETS = 48 * 1024
_ERASE = int.from_bytes(b"eras", "little")


def add_user_data_memory(dictionary: Dictionary) -> None:
    """Add both blocks, empty, and the command that empties them."""
    blocks = [Entry(USER_DATA_MEMORY, subindex, None, access=Access.RW, capacity=BLOCK_OCTETS) for subindex in (1, 2)]
    for block, other in (blocks, reversed(blocks)):
        block.accept = _room_beside(other)
    dictionary.add_record(blocks)
    erase = Entry(ERASE_USER_DATA_MEMORY, 0, DataType.UINT32, access=Access.WO, accept=one_of((_ERASE,)))
    erase.changed = lambda: _empty(blocks)
    dictionary.add(erase)


def _empty(blocks: list[Entry]) -> None:
    for block in blocks:
        block.text = b""


def _room_beside(other: Entry) -> Callable[[int], None]:
    def accept(octets: int) -> None:
        if octets + len(other.text) > SHARED_OCTETS:
            raise Refused(AbortCode.OUT_OF_MEMORY)

    return accept

"""Communication objects that belong to no single service: 1014h, 1029h, 1200h, and the LSS address in 1018h.

Reference: CiA 301 4.2, 7.5.2.17 (1014h), 7.5.2.32 (1029h), 7.5.2.33 (1200h), 7.5.2.21 (1018h).
"""

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.canopen.services.cob_id import ID, INVALID, refuse_move
from haptic_fieldbus.sim.canopen.services.memory import add_user_data_memory
from haptic_fieldbus.sim.drive.dictionary import Access, Dictionary, Entry, one_of

_EMERGENCY_ID = 0x80
_SDO = ((1, 0x600), (2, 0x580))
_IDENTITY = 0x1018
_BEHAVIOURS = (0, 1, 2)


class NodeObjects:
    """The objects with the power-on values of node-ID `number`."""

    def __init__(self, dictionary: Dictionary, number: int) -> None:
        self._dictionary = dictionary
        self._emergency = Entry(
            0x1014,
            0,
            DataType.UINT32,
            _EMERGENCY_ID + number,
            Access.RW,
            accept=self._accept_emergency,
            numbered=True,
        )
        dictionary.add(self._emergency)
        self._behaviour = Entry(0x1029, 1, DataType.UINT8, 0, Access.RW, accept=one_of(_BEHAVIOURS))
        dictionary.add_record([self._behaviour])
        dictionary.add_record(
            Entry(0x1200, subindex, DataType.UINT32, base + number, numbered=True) for subindex, base in _SDO
        )
        add_user_data_memory(dictionary)

    @property
    def emergency_cob_id(self) -> int:
        return self._emergency.value

    @property
    def error_behaviour(self) -> int:
        """Return 1029h:01, the effect of a communication error on the NMT state."""
        return self._behaviour.value

    def identity(self) -> list[int]:
        """Return the LSS address: vendor-ID, product code, revision number, serial number; 0 for any missing one."""
        return [self._dictionary.value(_IDENTITY, subindex) for subindex in range(1, 5)]

    def _accept_emergency(self, value: int) -> None:
        refuse_move(
            value, exists=not self._emergency.value & INVALID, becomes=not value & INVALID,
            can_id=self._emergency.value & ID,
        )  # fmt: skip

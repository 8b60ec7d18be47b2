"""SYNC as a simulated node consumes it: 1005h, 1006h, 1007h, 1019h.

Reference: CiA 301 4.2, 7.2.5 and 7.5.2.6 to 7.5.2.8, 7.5.2.22. The node does not produce SYNC. The SYNC counter (1019h)
cannot be changed while the period 1006h is not 0. A synchronous RPDO that comes later than 1007h after SYNC is dropped.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.canopen.services.cob_id import ID, is_restricted
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, Dictionary, Entry, Refused

SYNC_ID = 0x80
# 1019h: 0 for no counter, else its highest value; 1 is reserved.
_COUNTERS = (0, *range(2, 241))


class SyncObjects:
    """The objects of SYNC and their meaning; `changed` is called when one of them was written."""

    def __init__(self, dictionary: Dictionary, changed: Callable[[], None]) -> None:
        add = dictionary.add
        self._cob_id = add(Entry(0x1005, 0, DataType.UINT32, SYNC_ID, Access.RW, accept=_accept_identifier))
        self._period = add(Entry(0x1006, 0, DataType.UINT32, 0, Access.RW))
        self._window = add(Entry(0x1007, 0, DataType.UINT32, 0, Access.RW))
        self._overflow = add(Entry(0x1019, 0, DataType.UINT8, 0, Access.RW, accept=self._accept_overflow))
        for entry in (self._cob_id, self._window, self._overflow):
            entry.changed = changed

    @property
    def can_id(self) -> int:
        return self._cob_id.value & ID

    @property
    def counted(self) -> bool:
        """Return whether SYNC messages carry a counter."""
        return self._overflow.value != 0

    @property
    def window_ns(self) -> int:
        """Return the synchronous window; 0: until the next SYNC."""
        return self._window.value * 1000

    def _accept_overflow(self, value: int) -> None:
        if self._period.value:
            raise Refused(AbortCode.DEVICE_STATE)
        if value not in _COUNTERS:
            raise Refused(AbortCode.INVALID_VALUE)


def _accept_identifier(value: int) -> None:
    """Refuse the production of SYNC (bit 30), 29-bit identifiers and restricted ones."""
    if value & ~ID or is_restricted(value):
        raise Refused(AbortCode.INVALID_VALUE)

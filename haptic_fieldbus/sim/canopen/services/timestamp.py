"""TIME: the time of day that a simulated node takes from the bus (1012h).

Reference: CiA 301 4.2, 7.2.6, 7.1.6.6 (TIME_OF_DAY: 28 bits milliseconds after midnight, 4 bits void, 16 bits days
since 1 January 1984), 7.5.2.15. The node consumes TIME while bit 31 is set and never produces it. The manufacturer's
object 5FF1h *time of day* shows the result: 1 milliseconds after midnight, 2 days since 1984.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.canopen.services.cob_id import ID, NO_RTR, refuse_move
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, Dictionary, Entry, Mappable, Refused

TIME_ID = 0x100
TIME_OF_DAY = 0x5FF1
_CONSUMED = 1 << 31
_PRODUCED = NO_RTR
_OCTETS = 6
_DAY_MS = 24 * 60 * 60 * 1000
_MS = 1_000_000


class TimeConsumer:
    """The clock of the node; `now` returns the time of the simulation [ns]."""

    def __init__(self, dictionary: Dictionary, now: Callable[[], int], changed: Callable[[], None]) -> None:
        self._now = now
        self._set_ns: int | None = None
        self._day = self._ms = 0
        self._cob_id = Entry(0x1012, 0, DataType.UINT32, TIME_ID, Access.RW, accept=self._accept_cob_id)
        self._cob_id.changed = changed
        dictionary.add(self._cob_id)
        ms = Entry(TIME_OF_DAY, 1, DataType.UINT32, mappable=Mappable.NO)
        days = Entry(TIME_OF_DAY, 2, DataType.UINT16, mappable=Mappable.NO)
        ms.fetch, days.fetch = (lambda: self.time_of_day()[1]), (lambda: self.time_of_day()[0])
        dictionary.add_record((ms, days))

    @property
    def can_id(self) -> int | None:
        """Return the identifier of TIME; None when it is not consumed."""
        value = self._cob_id.value
        return value & ID if value & _CONSUMED else None

    def time_of_day(self) -> tuple[int, int]:
        """Return (days since 1984, milliseconds after midnight); zeros before the first TIME."""
        if self._set_ns is None:
            return 0, 0
        days, ms = divmod(self._ms + (self._now() - self._set_ns) // _MS, _DAY_MS)
        return (self._day + days) & 0xFFFF, ms

    def received(self, data: bytes, t_ns: int) -> None:
        """Set the clock from a TIME message; a message of another length is ignored."""
        if len(data) == _OCTETS:
            self._ms = int.from_bytes(data[:4], "little") & 0x0FFF_FFFF
            self._day = int.from_bytes(data[4:], "little")
            self._set_ns = t_ns

    def forget(self) -> None:
        """Forget the time, as at power-on."""
        self._set_ns = None

    def _accept_cob_id(self, value: int) -> None:
        if value & _PRODUCED:
            raise Refused(AbortCode.INVALID_VALUE)
        exists = self._cob_id.value & _CONSUMED != 0
        refuse_move(value, exists=exists, becomes=value & _CONSUMED != 0, can_id=self._cob_id.value & ID)

"""Heartbeat producer and consumer of a simulated node.

Reference: CiA 301 4.2, 7.2.8.3.2. Monitoring of a node starts with the first heartbeat received from it, not with the
writing of 1016h, and starts again with the next one after a loss. A boot-up message (state 0) is no heartbeat.
"""

from collections.abc import Callable

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.dictionary import AbortCode, Access, Dictionary, Entry, SdoAbort
from haptic_fieldbus.sim.wire import NEVER_NS

HEARTBEAT_ID = 0x700
_MS = 1_000_000


class Producer:
    """When our own heartbeat is due; `now` tells the time when 1017h is written."""

    def __init__(self, dictionary: Dictionary, now: Callable[[], int]) -> None:
        self.due_ns = NEVER_NS
        self._time = dictionary.add(Entry(0x1017, 0, DataType.UINT16, 0, Access.RW))
        self._time.changed = lambda: self.next(now())

    def next(self, t_ns: int) -> None:
        """One was sent, or the time was written."""
        period_ns = self._time.value * _MS
        self.due_ns = t_ns + period_ns if period_ns else NEVER_NS

    def stop(self) -> None:
        """None until `next`."""
        self.due_ns = NEVER_NS


class Consumer:
    """Watches one other node, the one named by sub-index 1 of its object (bits 16 to 23; time in ms below)."""

    def __init__(self, dictionary: Dictionary, index: int, changed: Callable[[], None]) -> None:
        self.due_ns = NEVER_NS
        self.lost = False
        self._changed = changed
        self._time = Entry(index, 1, DataType.UINT32, 0, Access.RW, accept=_node_exists)
        self._time.changed = self._written
        dictionary.add_record([self._time])

    @property
    def can_id(self) -> int | None:
        """The identifier that is watched; None when nothing is."""
        node = self._time.value >> 16
        return HEARTBEAT_ID + node if node and self._time.value & 0xFFFF else None

    def received(self, data: bytes, t_ns: int) -> bool:
        """A message with the watched identifier; True when it ends a loss."""
        if not data or data[0] & 0x7F == 0:
            return False
        self.due_ns = t_ns + (self._time.value & 0xFFFF) * _MS
        was_lost, self.lost = self.lost, False
        return was_lost

    def expire(self) -> None:
        """The heartbeat did not come in time."""
        self.due_ns = NEVER_NS
        self.lost = True

    def stop(self) -> None:
        """Not watching until the next heartbeat."""
        self.due_ns = NEVER_NS
        self.lost = False

    def _written(self) -> None:
        self.stop()
        self._changed()


def _node_exists(value: int) -> None:
    if value >> 16 > 127:
        raise SdoAbort(AbortCode.INVALID_VALUE)

"""Heartbeat producer and consumers of a simulated node.

Reference: CiA 301 4.2, 7.2.8.3.2.2, 7.5.2.19, 7.5.2.20. Monitoring of a node starts with the first heartbeat received
from it, not with the writing of 1016h, and starts again with the next one after a loss. A boot-up message (state 0) is
no heartbeat. An entry of 1016h without a time, or whose node-ID is not 1 to 127, is not used.
"""

from collections.abc import Callable
from functools import partial

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.canopen.services.alarms import Alarms, Handler
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, Dictionary, Entry, Refused

HEARTBEAT_ID = 0x700
_MS = 1_000_000
_LAST_NODE = 127
_RESERVED = 0xFF00_0000


class Producer:
    """When our own heartbeat is due; `now` tells the time when 1017h is written, `beat` sends one."""

    def __init__(
        self, dictionary: Dictionary, alarms: Alarms, now: Callable[[], int], beat: Callable[[], None]
    ) -> None:
        self._beat = beat
        self._alarm = alarms.new(self._rings)
        self._time = dictionary.add(Entry(0x1017, 0, DataType.UINT16, 0, Access.RW))
        self._time.changed = lambda: self.start(now())

    @property
    def active(self) -> bool:
        """Heartbeats are produced, so the node is not guarded."""
        return self._time.value != 0

    def start(self, t_ns: int) -> None:
        """The first one comes a period later."""
        if self._time.value:
            self._alarm.at(t_ns + self._time.value * _MS)
        else:
            self._alarm.off()

    def stop(self) -> None:
        """None until `start`."""
        self._alarm.off()

    def _rings(self, t_ns: int) -> None:
        self.start(t_ns)
        self._beat()


class Watch:
    """Someone who has to be heard in time; `lost` is called with the time when not, `back` when heard again."""

    def __init__(self, alarms: Alarms, lost: Callable[[int], None], back: Callable[[], None]) -> None:
        self.lost = False
        self._lost = lost
        self._back = back
        self._alarm = alarms.new(self._rings)

    def heard(self, due_ns: int) -> None:
        """Now, and to be heard again by then."""
        self._alarm.at(due_ns)
        if self.lost:
            self.lost = False
            self._back()

    def stop(self) -> None:
        """Not watched until heard again."""
        self._alarm.off()
        self.lost = False

    def renew(self) -> None:
        """The same with other parameters, which ends a loss."""
        was_lost = self.lost
        self.stop()
        if was_lost:
            self._back()

    def _rings(self, t_ns: int) -> None:
        self.lost = True
        self._lost(t_ns)


class _Consumer(Watch):
    """One entry of 1016h; node-ID in bits 16 to 23, time [ms] below."""

    def __init__(self, entry: Entry, alarms: Alarms, lost: Callable[[int], None], back: Callable[[], None]) -> None:
        super().__init__(alarms, lost, back)
        self.entry = entry

    @property
    def node(self) -> int | None:
        """The node that is watched; None when nothing is."""
        return _watched(self.entry.value)

    def received(self, data: bytes, t_ns: int) -> None:
        """A message with the watched identifier."""
        if data and data[0] & 0x7F:
            self.heard(t_ns + (self.entry.value & 0xFFFF) * _MS)


class Consumers:
    """Watch other nodes; `lost` is called with the time when one falls silent, `back` when one returns."""

    def __init__(
        self,
        dictionary: Dictionary,
        index: int,
        count: int,
        alarms: Alarms,
        changed: Callable[[], None],
        lost: Callable[[int], None],
        back: Callable[[], None],
    ) -> None:
        self._changed = changed
        entries = [
            Entry(index, number, DataType.UINT32, 0, Access.RW, accept=partial(self._accept, number))
            for number in range(1, count + 1)
        ]
        self._watches = [_Consumer(entry, alarms, lost, back) for entry in entries]
        for watch in self._watches:
            watch.entry.changed = partial(self._rewritten, watch)
        if entries:
            dictionary.add_record(entries)

    @property
    def lost(self) -> bool:
        """Whether a node is missing."""
        return any(watch.lost for watch in self._watches)

    def route(self) -> dict[int, Handler]:
        """Who is watched, by identifier."""
        return {HEARTBEAT_ID + watch.node: watch.received for watch in self._watches if watch.node is not None}

    def stop(self) -> None:
        """Not watching until the next heartbeats."""
        for watch in self._watches:
            watch.stop()

    def _accept(self, number: int, value: int) -> None:
        if value & _RESERVED:
            raise Refused(AbortCode.INVALID_VALUE)
        node = _watched(value)
        others = (watch for watch in self._watches if watch.entry.subindex != number)
        if node is not None and any(watch.node == node for watch in others):
            raise Refused(AbortCode.PARAMETER_INCOMPATIBLE)

    def _rewritten(self, watch: Watch) -> None:
        watch.renew()
        self._changed()


def _watched(value: int) -> int | None:
    """The node-ID that a value of 1016h asks to watch."""
    node = value >> 16
    return node if 1 <= node <= _LAST_NODE and value & 0xFFFF else None

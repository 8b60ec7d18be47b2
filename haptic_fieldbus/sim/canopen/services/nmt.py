"""Network management of a simulated node: NMT states, heartbeat, node guarding."""

from collections.abc import Callable
from enum import Enum, auto
from functools import partial

from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.sim.canopen.services.basics import Alarms, Handler
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Dictionary, Entry

# Heartbeat producer and consumers of a simulated node.
#
# Reference: CiA 301 4.2, 7.2.8.3.2.2, 7.5.2.19, 7.5.2.20. Monitoring of a node starts with the first heartbeat received
# from it, not with the writing of 1016h, and restarts with the next heartbeat after a loss. A boot-up message (state 0)
# is no heartbeat. An entry of 1016h without a time, or whose node-ID is not 1 to 127, is not used.

HEARTBEAT_ID = 0x700
_MS = 1_000_000
_LAST_NODE = 127
# Bits 24 to 31 of 1016h are 0.
_RESERVED = 0xFF00_0000


class Producer:
    """The timing of the node's own heartbeat.

    `now` returns the time when 1017h is written; `beat` sends a heartbeat.
    """

    def __init__(
        self, dictionary: Dictionary, alarms: Alarms, now: Callable[[], int], beat: Callable[[], None]
    ) -> None:
        self._beat = beat
        self._alarm = alarms.new(self._rings)
        self._time = dictionary.add(Entry(0x1017, 0, DataType.UINT16, 0, Access.RW))
        self._time.changed = lambda: self.start(now())

    @property
    def active(self) -> bool:
        """Return whether heartbeats are produced; node guarding is then not answered."""
        return self._time.value != 0

    def start(self, t_ns: int) -> None:
        """Send the first heartbeat one period from now, none if the period is 0."""
        if self._time.value:
            self._alarm.at(t_ns + self._time.value * _MS)
        else:
            self._alarm.off()

    def stop(self) -> None:
        """Send no heartbeat until `start`."""
        self._alarm.off()

    def _rings(self, t_ns: int) -> None:
        self.start(t_ns)
        self._beat()


class Watch:
    """A peer that must be heard in time.

    `lost` is called with the time when it is not heard, `back` when it is heard again.
    """

    def __init__(self, alarms: Alarms, lost: Callable[[int], None], back: Callable[[], None]) -> None:
        self.lost = False
        self.factor: float | None = 1.0
        """Reaction time of the watch as a multiple of its set time; None: no reaction (a fault)."""
        self._lost = lost
        self._back = back
        self._alarm = alarms.new(self._rings)

    def heard(self, t_ns: int, within_ns: int) -> None:
        """Note that the peer is heard, and expect it again within this time [ns]."""
        if self.factor is not None:
            self._alarm.at(t_ns + round(self.factor * within_ns))
        if self.lost:
            self.lost = False
            self._back()

    def stop(self) -> None:
        """Stop monitoring until the peer is heard again."""
        self._alarm.off()
        self.lost = False

    def renew(self) -> None:
        """Restart monitoring after a change of parameters, which ends a loss."""
        was_lost = self.lost
        self.stop()
        if was_lost:
            self._back()

    def _rings(self, t_ns: int) -> None:
        self.lost = True
        self._lost(t_ns)


class _Consumer(Watch):
    """One entry of 1016h: node-ID in bits 16 to 23, time [ms] below."""

    def __init__(self, entry: Entry, alarms: Alarms, lost: Callable[[int], None], back: Callable[[], None]) -> None:
        super().__init__(alarms, lost, back)
        self.entry = entry

    @property
    def node(self) -> int | None:
        """Return the node that is monitored; None when the entry is not used."""
        return _watched(self.entry.value)

    def received(self, data: bytes, t_ns: int) -> None:
        """Handle a message with the monitored identifier."""
        if data and data[0] & 0x7F:
            self.heard(t_ns, (self.entry.value & 0xFFFF) * _MS)


class Consumers:
    """The monitoring of other nodes: `lost` is called with the time when one falls silent, `back` when one returns."""

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
        self.watches = [_Consumer(entry, alarms, lost, back) for entry in entries]
        for watch in self.watches:
            watch.entry.changed = partial(self._rewritten, watch)
        if entries:
            dictionary.add_record(entries)

    @property
    def lost(self) -> bool:
        """Return whether a monitored node is missing."""
        return any(watch.lost for watch in self.watches)

    def route(self) -> dict[int, Handler]:
        """Return the handlers of the monitored nodes, by identifier."""
        return {HEARTBEAT_ID + watch.node: watch.received for watch in self.watches if watch.node is not None}

    def stop(self) -> None:
        """Stop monitoring until the next heartbeats."""
        for watch in self.watches:
            watch.stop()

    def _accept(self, number: int, value: int) -> None:
        if value & _RESERVED:
            raise AccessRefused(AbortCode.INVALID_VALUE)
        node = _watched(value)
        others = (watch for watch in self.watches if watch.entry.subindex != number)
        if node is not None and any(watch.node == node for watch in others):
            raise AccessRefused(AbortCode.PARAMETER_INCOMPATIBLE)

    def _rewritten(self, watch: Watch) -> None:
        watch.renew()
        self._changed()


def _watched(value: int) -> int | None:
    """Return the node-ID that a value of 1016h monitors; None when it monitors none."""
    node = value >> 16
    return node if 1 <= node <= _LAST_NODE and value & 0xFFFF else None


# Node guarding and life guarding of a simulated node: 100Ch, 100Dh.
#
# Reference: CiA 301 4.2, 7.2.8.3.2.1, 7.5.2.11, 7.5.2.12. The master requests by a remote frame. The answer is the NMT
# state with a toggle bit, which is 0 in the first answer after a reset of communication. The node life time is guard
# time × life time factor. It is monitored from the first request on; when it passes without another request, the master
# is lost until its next one.

_TOGGLE = 0x80


class Guarding(Watch):
    """The monitoring of the master."""

    def __init__(
        self, dictionary: Dictionary, alarms: Alarms, lost: Callable[[int], None], back: Callable[[], None]
    ) -> None:
        super().__init__(alarms, lost, back)
        self._toggle = 0
        self._guard_time = dictionary.add(Entry(0x100C, 0, DataType.UINT16, 0, Access.RW))
        self._factor = dictionary.add(Entry(0x100D, 0, DataType.UINT8, 0, Access.RW))
        self._guard_time.changed = self._factor.changed = self.renew

    def request(self, state: int, t_ns: int) -> bytes:
        """Return the answer to the master's remote frame: NMT state and toggle bit."""
        answer = bytes((self._toggle | state,))
        self._toggle ^= _TOGGLE
        life_ns = self._guard_time.value * self._factor.value * _MS
        if life_ns:
            self.heard(t_ns, life_ns)
        return answer

    def reset(self) -> None:
        """Start anew, as after a reset of communication."""
        self._toggle = 0
        self.stop()


# The NMT states of a CANopen slave, their commands and their services, as tables without behaviour.
#
# Reference: CiA 301 4.2, 7.2.8.3.1 (commands), 7.3.2 with table 38 (states and communication objects), 7.5.2.32
# (1029h).


class NmtState(Enum):
    """NMT states; the value is the state octet of the heartbeat, for *initialising* that of the boot-up message."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class Service(Enum):
    """Kinds of communication objects that work in the same states."""

    NMT = auto()
    """Module control and error control."""
    SDO = auto()
    """SDO, EMCY and TIME."""
    PDO = auto()
    """PDO and SYNC, which acts only on PDOs."""
    LSS = auto()


COMMANDED = {1: NmtState.OPERATIONAL, 2: NmtState.STOPPED, 128: NmtState.PRE_OPERATIONAL}
RESET_NODE, RESET_COMMUNICATION = 129, 130

WORKING = {
    NmtState.INITIALISING: frozenset[Service](),
    NmtState.PRE_OPERATIONAL: frozenset({Service.NMT, Service.SDO, Service.LSS}),
    NmtState.OPERATIONAL: frozenset({Service.NMT, Service.SDO, Service.PDO}),
    NmtState.STOPPED: frozenset({Service.NMT, Service.LSS}),
}
WITHOUT_NODE_ID = frozenset({Service.LSS})
"""Services in *initialising* while the node has no node-ID (CiA 305)."""

# New state by 1029h:01 and the state before the error; other combinations change nothing.
AFTER_ERROR = {
    (0, NmtState.OPERATIONAL): NmtState.PRE_OPERATIONAL,
    (2, NmtState.OPERATIONAL): NmtState.STOPPED,
    (2, NmtState.PRE_OPERATIONAL): NmtState.STOPPED,
}

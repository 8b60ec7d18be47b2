"""Network management of a simulated node: NMT states, heartbeat, node guarding, emergencies."""

import struct
from collections import deque
from collections.abc import Callable
from enum import Enum, auto
from functools import partial

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.services.basics import Alarms, Handler
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Dictionary, Entry, Mappable, one_of

# Heartbeat producer and consumers of a simulated node.
#
# Reference: CiA 301 4.2, 7.2.8.3.2.2, 7.5.2.19, 7.5.2.20. Monitoring of a node starts with the first heartbeat received
# from it, not with the writing of 1016h, and restarts with the next heartbeat after a loss. A boot-up message (state 0)
# is no heartbeat. An entry of 1016h without a time, or whose node-ID is not 1 to 127, is not used.

HEARTBEAT_ID = 0x700
_MS = 1_000_000
_LAST_NODE = 127
_CONSUMERS = range(1, 5)
"""Sub-indices of the nodes that can be monitored."""
# Bits 24 to 31 of 1016h are 0.
_RESERVED = 0xFF00_0000


Lost = Callable[[int], None]
"""Function that is told the time [ns] at which a peer was not heard any more."""
Notice = Callable[[], None]
"""Function that is told that something has happened."""


class Producer:
    """The timing of the node's own heartbeat.

    `now` returns the time when 1017h is written; `beat` sends a heartbeat.
    """

    def __init__(self, dictionary: Dictionary, alarms: Alarms, now: Callable[[], int], beat: Notice) -> None:
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
        self._alarm.at(t_ns + self._time.value * _MS if self._time.value else NEVER_NS)

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

    def __init__(self, alarms: Alarms, lost: Lost, back: Notice) -> None:
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

    def __init__(self, entry: Entry, alarms: Alarms, lost: Lost, back: Notice) -> None:
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
        self, dictionary: Dictionary, index: int | None, alarms: Alarms, changed: Notice, lost: Lost, back: Notice
    ) -> None:
        """Add the object of the monitored nodes, at this index; None: the model has none."""
        self._changed = changed
        entries = [
            Entry(index, number, DataType.UINT32, 0, Access.RW, accept=partial(self._accept, number))
            for number in _CONSUMERS
            if index is not None
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

    def __init__(self, dictionary: Dictionary, alarms: Alarms, lost: Lost, back: Notice) -> None:
        super().__init__(alarms, lost, back)
        self._toggle = 0
        self._guard_time = dictionary.add(Entry(0x100C, 0, DataType.UINT16, 0, Access.RW))
        self._factor = dictionary.add(Entry(0x100D, 0, DataType.UINT8, 0, Access.RW))
        self._guard_time.changed = self._factor.changed = self.renew

    def request(self, state: int, t_ns: int) -> bytes:
        """Return the answer to the master's remote frame: NMT state and toggle bit."""
        answer = bytes((self._toggle | state,))
        self._toggle ^= _TOGGLE
        if life_ns := self._guard_time.value * self._factor.value * _MS:
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


# Errors of a simulated node: emergency messages, the error register and the error history.
# Reference: CiA 301 4.2, 7.2.7 (EMCY), 7.5.2.2 (1001h), 7.5.2.4 (1003h), 7.5.2.18 (1015h). An error is active from
# `raise_error` to `clear`, which sends *error reset* with the errors that remain in the register. An error may have
# several causes, and lasts until all are gone; one of them is the *fault* of the drive, which its reset ends. Messages
# within the inhibit time of an earlier message wait, up to `HISTORY` of them.

HISTORY = 8
DISCONNECTED = 0x8100
"""Communication, generic error: the master has ended the connection while the drive could make torque."""
HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT = 0x8210
PDO_TOO_LONG = 0x8220
SYNC_LENGTH = 0x8240
RPDO_TIMEOUT = 0x8250
DRIVE = "drive"
"""Cause of the errors of the drive, which its fault reset ends."""

_GENERIC = 0x01
# CiA 301, tables 26 and 46: bit of the error register by the class of the code. Every active error sets the generic bit
# too; device specific errors (FFxxh) also set bit 7.
_REGISTER_BITS = {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10, 0xF: 0x80}
# Codes of communication errors, which last until communication works again and end with its reset.
_MONITORING = range(0x8100, 0x8300)
# 1015h is in steps of 100 µs.
_TICK_NS = 100_000


class Emergencies:
    """Active errors, their register, history and messages; `send` queues the eight octets of an emergency message."""

    def __init__(
        self, dictionary: Dictionary, send: Callable[[bytes], None], alarms: Alarms, now: Callable[[], int]
    ) -> None:
        self.monitored = 0
        """Number of active communication errors; while it is 0, callers need not call `clear`."""
        self._send = send
        self._now = now
        self._active: list[int] = []
        self._causes: dict[int, set[object]] = {}
        self._history: deque[int] = deque(maxlen=HISTORY)
        self._waiting: deque[bytes] = deque(maxlen=HISTORY)
        self._inhibit = alarms.new(self._next)
        self._register = dictionary.add(Entry(0x1001, 0, DataType.UINT8, mappable=Mappable.TPDO))
        self._inhibit_time = dictionary.add(Entry(0x1015, 0, DataType.UINT16, 0, Access.RW))
        count = dictionary.add(Entry(0x1003, 0, DataType.UINT8, 0, Access.RW, accept=one_of((0,))))
        count.fetch = lambda: len(self._history)
        count.changed = self._history.clear
        for number in range(1, HISTORY + 1):
            entry = dictionary.add(Entry(0x1003, number, DataType.UINT32))
            entry.fetch = partial(self._past, number)

    def raise_error(self, code: int, cause: object = None) -> None:
        """Activate an error; send a message unless the same code is already active for any cause."""
        self._causes.setdefault(code, set()).add(cause)
        if code not in self._active:
            self._active.append(code)
            self._history.appendleft(code)
            self._report(code)

    def clear(self, code: int, cause: object = None) -> None:
        """Remove this cause, and end the error if no cause is left; unknown codes and causes are ignored."""
        if (causes := self._causes.get(code)) is None:
            return
        causes.discard(cause)
        if not causes:
            del self._causes[code]
            self._active.remove(code)
            self._report(0)

    def persists(self, cause: object) -> bool:
        """Return whether an error with this cause also has another cause that is still present."""
        return any(cause in causes and len(causes) > 1 for causes in self._causes.values())

    def clear_all(self, cause: object) -> None:
        """End all errors after a fault reset, except communication errors with a cause other than this one."""
        for causes in self._causes.values():
            causes.discard(cause)
        remaining = [code for code in self._active if code in _MONITORING and self._causes[code]]
        if remaining != self._active:
            self._keep(remaining)
            self._report(0)

    def restart(self, *, power_on: bool) -> None:
        """Reset without a message; errors of the device survive a reset of communication, also in the history."""
        survives = [code for code in self._active if not power_on and self._outlives_reset(code)]
        self._keep(survives)
        past = [code for code in self._history if code in survives]
        self._history.clear()
        self._history.extend(past)
        self._waiting.clear()
        self._inhibit.off()
        self._show()

    def _outlives_reset(self, code: int) -> bool:
        """Return whether an error is not a communication error, or has put the drive into *fault*."""
        causes = self._causes[code]
        if code in _MONITORING and DRIVE in causes:
            # What was monitored is monitored anew after the reset.
            causes.intersection_update({DRIVE})
        return code not in _MONITORING or DRIVE in causes

    def _keep(self, codes: list[int]) -> None:
        self._active = codes
        self._causes = {code: self._causes[code] for code in codes}

    def _show(self) -> None:
        register = 0
        for active in self._active:
            register |= _GENERIC | _REGISTER_BITS.get(active >> 12, 0)
        self._register.value = register
        self.monitored = sum(active in _MONITORING for active in self._active)

    def _report(self, code: int) -> None:
        self._show()
        self._waiting.append(struct.pack("<HB5x", code, self._register.value))
        if self._inhibit.due_ns == NEVER_NS:
            self._next(self._now())

    def _next(self, t_ns: int) -> None:
        """Send the waiting messages, one in each inhibit time."""
        while self._waiting:
            self._send(self._waiting.popleft())
            if self._inhibit_time.value:
                self._inhibit.at(t_ns + self._inhibit_time.value * _TICK_NS)
                return

    def _past(self, number: int) -> int:
        if number > len(self._history):
            raise AccessRefused(AbortCode.NO_DATA)
        return self._history[number - 1]

"""The process data of a simulated node: the PDOs that act on SYNC or on an event, and their timing.

At a SYNC the measured entries are latched and the synchronous TPDOs are made of them; then the synchronous RPDOs
received since the last SYNC act (CiA 301, 7.2.5). Synchronous RPDOs that come later than the synchronous window (1007h)
after SYNC are dropped. Event-driven TPDOs are checked every `event_period_ns`. The work of each period is fixed when a
parameter changes: an RPDO gets only the receiver that its parameters need.
"""

from collections.abc import Callable
from dataclasses import InitVar, dataclass

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.services.basics import ID, Alarm, Alarms, Handler, is_restricted
from haptic_fieldbus.sim.canopen.services.nmt import PDO_TOO_LONG, PDO_TOO_SHORT, RPDO_TIMEOUT, SYNC_LENGTH, Emergencies
from haptic_fieldbus.sim.canopen.services.pdo import PdoDefaults, Rpdo, Tpdo
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.dictionary import AbortCode, Access, AccessRefused, Entry, only_if

# Deadlines of RPDOs: their event timers (1400h:05).
#
# Theory (CiA 301, 7.5.2.35): the first reception in *operational* arms the deadline, each further one postpones it.
# When it passes, an emergency 8250h is sent, whose error ends with the next reception. Writing the event timer or the
# identifier disarms the deadline. The standard leaves further reactions to the application: this drive treats a missed
# deadline as a lost link (6007h).
#
# A reception only notes its time; the alarm is postponed when it rings. So a period costs one assignment.


class Deadline:
    """The deadline of one RPDO."""

    def __init__(self, rpdo: Rpdo, alarms: Alarms, emergencies: Emergencies, lost: Callable[[int, int], None]) -> None:
        self.alarm: Alarm = alarms.new(self._rings)
        self._rpdo = rpdo
        self._emergencies = emergencies
        self._lost = lost
        self._parameters = (rpdo.can_id, rpdo.deadline_ns)
        self._last_ns = 0
        self._armed = False

    def heard(self, t_ns: int) -> None:
        """Note a reception of the RPDO."""
        self._last_ns = t_ns
        if not self._armed:
            self._armed = True
            self.alarm.at(t_ns + self._rpdo.deadline_ns)
            self._emergencies.clear(RPDO_TIMEOUT, self._rpdo)

    def disarm(self) -> None:
        """Disarm until the next reception; an error that was raised ends."""
        self._armed = False
        self.alarm.off()
        self._emergencies.clear(RPDO_TIMEOUT, self._rpdo)

    def timed(self, receive: Handler) -> Handler:
        """Return a receiver that notes the reception and then calls `receive`."""
        heard = self.heard

        def timed(data: bytes, t_ns: int) -> None:
            heard(t_ns)
            receive(data, t_ns)

        return timed

    def check(self) -> None:
        """Disarm when the parameters have changed, and when the RPDO is not received any more."""
        before, self._parameters = self._parameters, (self._rpdo.can_id, self._rpdo.deadline_ns)
        if not self._rpdo.valid or self._parameters != before:
            self.disarm()

    def _rings(self, t_ns: int) -> None:
        # The alarm still has the time of an earlier reception: postpone it.
        due_ns = self._last_ns + self._rpdo.deadline_ns
        if due_ns > t_ns:
            self.alarm.at(due_ns)
            return
        self._armed = False
        self._emergencies.raise_error(RPDO_TIMEOUT, self._rpdo)
        self._lost(RPDO_TIMEOUT, t_ns)


SYNC_ID = 0x80
# 1019h: 0 for no counter, else its highest value; 1 is reserved.
_COUNTERS = (0, *range(2, 241))


@dataclass
class Losses:
    """The frames of a kind that are lost inside the node (a fault), as a count of those to come; inf: all of them."""

    left: float = 0.0

    def before(self, receive: Handler) -> Handler:
        """Return a receiver that drops the frames to be lost, `receive` itself when there are none."""

        def lose(data: bytes, t_ns: int) -> None:
            if self.left:
                self.left -= 1
            else:
                receive(data, t_ns)

        return lose if self.left else receive


# SYNC as a simulated node consumes it: 1005h, 1006h, 1007h, 1019h.
#
# Reference: CiA 301 4.2, 7.2.5 and 7.5.2.6 to 7.5.2.8, 7.5.2.22. The node does not produce SYNC. The SYNC counter
# (1019h) cannot be changed while the period 1006h is not 0. A synchronous RPDO that comes later than 1007h after SYNC
# is dropped.


@dataclass(eq=False)
class ProcessData:
    """All PDOs of a node; they work between `start` and `stop`."""

    _drive: Drive
    _emergencies: Emergencies
    _send: Callable[[Frame], None]
    _changed: Callable[[], None]
    _alarms: Alarms
    rpdos: InitVar[list[PdoDefaults]]
    tpdos: InitVar[list[PdoDefaults]]
    _acts_at_sync: bool
    """Whether even event-driven RPDOs wait for the next SYNC."""
    skip_tpdos: int = 0
    """Number of following TPDOs that are lost inside the node (a fault)."""

    def __post_init__(self, rpdos: list[PdoDefaults], tpdos: list[PdoDefaults]) -> None:
        dictionary = self._drive.dictionary
        self.lost_rpdos, self.lost_syncs = Losses(), Losses()
        # Not produced (bit 30), not of 29 bits, not restricted.
        is_sync_id = only_if(lambda value: not value & ~ID and not is_restricted(value))
        self._sync_id = dictionary.add(Entry(0x1005, 0, DataType.UINT32, SYNC_ID, Access.RW, accept=is_sync_id))
        self._period = dictionary.add(Entry(0x1006, 0, DataType.UINT32, 0, Access.RW))
        self._window = dictionary.add(Entry(0x1007, 0, DataType.UINT32, 0, Access.RW))
        """The synchronous window [µs]; 0: until the next SYNC."""
        self._overflow = dictionary.add(Entry(0x1019, 0, DataType.UINT8, 0, Access.RW, accept=self._accept_overflow))
        """Largest value of the counter in SYNC messages; 0: they carry none."""
        for entry in (self._sync_id, self._window, self._overflow):
            entry.changed = self._changed
        self._rpdos = [Rpdo(dictionary, defaults, self._changed) for defaults in rpdos]
        self._tpdos = [Tpdo(dictionary, defaults, self._changed) for defaults in tpdos]
        self._poll = self._alarms.new(self.poll)
        self._deadlines: dict[Rpdo, Deadline] = {}
        """The deadlines of the RPDOs that have, or have had, one."""
        self._waiting: dict[Rpdo, bytes] = {}
        self._at_sync: list[Tpdo] = []
        self._at_event: list[Tpdo] = []
        self._sync_octets = 0
        self._window_ns = 0
        self._window_end_ns = NEVER_NS

    def compile(self) -> None:
        """Take over the parameters of all PDOs, as after a reset."""
        for pdo in (*self._rpdos, *self._tpdos):
            pdo.compile()

    def start(self, t_ns: int) -> None:
        """Start on entering *operational*."""
        for tpdo in self._tpdos:
            tpdo.restart(t_ns, counted=self._overflow.value != 0)
        self._waiting.clear()
        self._window_end_ns = NEVER_NS
        self._poll.at(t_ns)

    def stop(self) -> None:
        """Stop on leaving *operational*."""
        self._waiting.clear()
        for deadline in self._deadlines.values():
            deadline.disarm()
        self._poll.off()

    def route(self, t_ns: int) -> dict[int, Handler]:
        """Take over the parameters, and return the handlers of SYNC and of the RPDOs by identifier."""
        self._at_sync = [tpdo for tpdo in self._tpdos if tpdo.valid and tpdo.with_sync]
        self._at_event = [tpdo for tpdo in self._tpdos if tpdo.valid and tpdo.event_driven]
        self._sync_octets = int(self._overflow.value != 0)
        self._window_ns = self._window.value * 1000
        # An event-driven TPDO is checked at once after a change: it may have become valid.
        self._poll.at(min(self._poll.due_ns, t_ns) if self._at_event else NEVER_NS)
        for deadline in self._deadlines.values():
            deadline.check()
        handlers: dict[int, Handler] = {rpdo.can_id: self._receiver(rpdo) for rpdo in self._rpdos if rpdo.valid}
        handlers[self._sync_id.value & ID] = self.lost_syncs.before(self.sync)
        return handlers

    @property
    def received(self) -> set[int]:
        """Identifiers of SYNC and of the RPDOs."""
        return {self._sync_id.value & ID, *(rpdo.can_id for rpdo in self._rpdos if rpdo.valid)}

    def requests(self) -> dict[int, Callable[[int], None]]:
        """Return the handlers of remote frames, by identifier."""
        return {tpdo.can_id: self._requested(tpdo) for tpdo in self._tpdos if tpdo.on_request}

    def sync(self, data: bytes, t_ns: int) -> None:
        """Handle a SYNC that has ended."""
        if len(data) != self._sync_octets:
            self._emergencies.raise_error(SYNC_LENGTH)
            return
        # Asked first, because it is one comparison in a period without errors.
        if self._emergencies.monitored:
            self._emergencies.clear(SYNC_LENGTH)
        self._drive.sync(t_ns)
        if self._window_ns:
            self._window_end_ns = t_ns + self._window_ns
        counter = data[0] if data else 0
        # TPDOs first: they carry the state before the waiting RPDOs act.
        for tpdo in self._at_sync:
            if (octets := tpdo.at_sync(counter)) is not None:
                self._send_pdo(tpdo, octets)
        if self._waiting:
            for rpdo, received in self._waiting.items():
                rpdo.apply(received)
            self._waiting.clear()
            self._drive.act(t_ns)

    def poll(self, t_ns: int) -> None:
        """Check the event-driven TPDOs."""
        self._poll.at(t_ns + self._drive.event_period_ns)
        self._drive.measure(t_ns)
        for tpdo in self._at_event:
            if (octets := tpdo.at_event(t_ns)) is not None:
                self._send_pdo(tpdo, octets)

    def _accept_overflow(self, value: int) -> None:
        if self._period.value:
            raise AccessRefused(AbortCode.DEVICE_STATE)
        if value not in _COUNTERS:
            raise AccessRefused(AbortCode.INVALID_VALUE)

    def _receiver(self, rpdo: Rpdo) -> Handler:
        apply, act = rpdo.apply, self._drive.act

        def hold(data: bytes, t_ns: int) -> None:
            if not self._window_ns or t_ns <= self._window_end_ns:
                self._waiting[rpdo] = data

        def follow(data: bytes, t_ns: int) -> None:
            apply(data)
            act(t_ns)

        receive: Handler = hold if rpdo.synchronous or self._acts_at_sync else follow
        if rpdo.deadline_ns:
            if rpdo not in self._deadlines:
                self._deadlines[rpdo] = Deadline(rpdo, self._alarms, self._emergencies, self._drive.link_lost)
            receive = self._deadlines[rpdo].timed(receive)
        return self.lost_rpdos.before(self._measured(rpdo, receive))

    def _measured(self, rpdo: Rpdo, receive: Handler) -> Handler:
        """Return a receiver that checks the length: any but the mapped one is an error, a shorter frame is dropped."""
        size, emergencies = rpdo.packing.size, self._emergencies

        def measured(data: bytes, t_ns: int) -> None:
            if len(data) != size:
                emergencies.raise_error(PDO_TOO_SHORT if len(data) < size else PDO_TOO_LONG, rpdo)
                if len(data) < size:
                    return
            elif emergencies.monitored:
                emergencies.clear(PDO_TOO_SHORT, rpdo)
                emergencies.clear(PDO_TOO_LONG, rpdo)
            receive(data, t_ns)

        return measured

    def _requested(self, tpdo: Tpdo) -> Callable[[int], None]:
        def requested(t_ns: int) -> None:
            if (octets := tpdo.at_request(lambda: self._drive.measure(t_ns))) is not None:
                self._send_pdo(tpdo, octets)

        return requested

    def _send_pdo(self, tpdo: Tpdo, octets: bytes) -> None:
        if self.skip_tpdos:
            self.skip_tpdos -= 1
        else:
            self._send(Frame(tpdo.can_id, octets))

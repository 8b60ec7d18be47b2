"""Simulated drives on a python-can bus, in real time and in one thread, for masters in other programs.

Theory: the real bus replaces the simulated wire, so bit times are not simulated; the drives are the same. The thread
waits for a frame until the next timer of a drive falls due. Each timer is served with the instant at which it was due,
not the instant of waking up, and a frame with the instant of its arrival, if that is known. So the lateness of the host
does not accumulate and does not change the motion of the shafts. Frames that the drives send at one instant go out in
the order of their priority, as on a wire.

A step must not cause lateness itself, so everything for it is built before a drive is *ready*: afterwards no matrix
exponential is computed and no module imported, and existing objects are kept out of garbage collection.
"""

from collections.abc import Callable, Collection, Sequence
from functools import partial
from operator import is_

import can

from haptic_fieldbus.buses.canopen.errors import FOREIGN, is_queue_full, translate
from haptic_fieldbus.buses.canopen.frames import CAN_ID_MASK, ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from haptic_fieldbus.buses.canopen.opening import open_can
from haptic_fieldbus.buses.canopen.wire import OURS, port_to
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, DEFAULT_SEED
from haptic_fieldbus.errors import BusError, UsageError
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.protocols.canopen.bus import SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID, can_section
from haptic_fieldbus.protocols.canopen.pdo import HEARTBEAT_COB_ID
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.sim.bench import LONGEST_REMEMBERED, NAP_NS, frozen
from haptic_fieldbus.sim.canopen.drives import KINDS as KINDS
from haptic_fieldbus.sim.canopen.drives import SimulatedDrives
from haptic_fieldbus.sim.canopen.link import Frame, Port
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus

# The port of hosted drives to a python-can bus that may go down, and come back.
#
# A drive does not end when its cable is pulled: it goes on, hears nothing, and lets go by its own watch. So nothing
# that the interface raises ends the hosting. It is told once when the bus goes down and once when a frame passes again;
# what is sent meanwhile is lost. An interface that goes on failing is opened anew, because its socket may belong to an
# adapter that was unplugged.
#
# Where the kernel stamps frames as they arrive, a frame is served at its stamp, so that a process that was woken late
# latches what the shaft did when SYNC came, as a drive would, and does not miss a proof of life that waited with the
# rest. The stamp is of the wall clock, which may be set at any time; it is bounded by what was served before, and by
# now.

REOPENED_EVERY_NS = 1_000_000_000
RETRIED_EVERY_NS = 20_000_000
"""Pause after a failed receive, because an immediate retry would keep a processor busy."""

_ROOM = 100
"""Frames that the drives may send at once; a block of an SDO has up to 127 segments."""
MOST_OCTETS = 8
"""Longest frame of CAN 2.0."""

Tell = Callable[[str], None]
"""Function that shows a sentence to the user."""


class HostPort:
    """A python-can bus, opened by `reopen` again when it goes on failing; `name` is the bus in sentences."""

    def __init__(
        self, can_bus: can.BusABC, clock: Clock, name: str, tell: Tell, reopen: Callable[[], can.BusABC] | None = None
    ) -> None:
        self.lost = 0
        """Number of frames that could not be sent because the transmit queue was full."""
        self._clock = clock
        self._focused: frozenset[int] | None = None
        """CAN-IDs of the frames that concern the drives; None: not set yet."""
        self._use(can_bus)
        self._name = name
        self._tell = tell
        self._reopen = reopen
        self._down_ns: int | None = None
        """Time at which the bus went down; None while it is up."""
        self._opened_ns = clock.now_ns()

    def send(self, frame: Frame) -> None:
        """Send a frame; it is lost when the bus is down or its transmit queue full."""
        if self._port is None:
            return
        flags = (EXTENDED_FLAG if frame.extended else 0) | (REMOTE_FLAG if frame.remote else 0)
        try:
            self._port.send(frame.can_id | flags, frame.data)
        except FOREIGN as error:
            if is_queue_full(error):
                self.lost += 1
            else:
                self._failed(error)
        else:
            self._passed()

    def receive(self, longest_ns: int) -> Frame | None:
        """Return the next frame; None when none comes within `longest_ns`, or the bus is down."""
        if self._port is None:
            self._open()
            self._pause(longest_ns)
            return None
        try:
            received = self._port.receive(max(0, longest_ns) * 1e-9)
        except FOREIGN as error:
            self._failed(error)
            self._pause(longest_ns)
            return None
        if received is None or received is OURS:
            return None
        can_id, data = received
        if can_id & ERROR_FLAG or len(data) > MOST_OCTETS:
            return None
        self._passed()
        return Frame(can_id & CAN_ID_MASK, bytes(data), bool(can_id & EXTENDED_FLAG), bool(can_id & REMOTE_FLAG))

    def focus(self, concerns: frozenset[tuple[int, bool]]) -> None:
        """Set a kernel filter for these frames, if available; each is an identifier and True for a remote frame.

        Then frames for other nodes cost this process no time.
        """
        self._focused = frozenset(can_id | (REMOTE_FLAG if remote else 0) for can_id, remote in concerns)
        try:
            if self._port is not None:
                self._port.focus(self._focused, _ROOM)
        except FOREIGN as error:
            self._failed(error)

    def arrived_ns(self, earliest_ns: int) -> int:
        """Return the instant at which the frame that was received last arrived, not before `earliest_ns`."""
        stamped_ns = None if self._port is None else self._port.arrived_ns(earliest_ns)
        return max(earliest_ns, self._clock.now_ns() if stamped_ns is None else stamped_ns)

    def twice(self, nodes: Collection[int]) -> BusError:
        """Return the error that another device has these node-IDs."""
        return BusError(
            f"{self._name}: another device on this bus has the node-ID {', '.join(map(str, sorted(nodes)))}; choose "
            "another one by --node or --drive PROFILE@NODE, or disconnect the other device"
        )

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()

    def _use(self, can_bus: can.BusABC | None) -> None:
        self._bus = can_bus
        self._port = None if can_bus is None else port_to(can_bus, self._clock)
        if self._port is not None and self._focused is not None:
            self._port.focus(self._focused, _ROOM)

    def _pause(self, longest_ns: int) -> None:
        self._clock.sleep_until(self._clock.now_ns() + min(max(0, longest_ns), RETRIED_EVERY_NS))

    def _passed(self) -> None:
        if self._down_ns is not None:
            seconds = rounded((self._clock.now_ns() - self._down_ns) * 1e-9)
            self._down_ns = None
            self._tell(f"{self._name}: frames pass again after {seconds} s")

    def _failed(self, error: Exception) -> None:
        """Report that the bus is down, or reopen it after failures for a long time."""
        why = translate(error, self._name)
        if self._down_ns is None:
            self._down_ns = self._clock.now_ns()
            self._tell(f"{why}. The drives continue; their frames are lost until the bus is back")
        elif self._clock.now_ns() - self._down_ns >= REOPENED_EVERY_NS:
            self._open()

    def _open(self) -> None:
        """Open the bus anew, at most once in `REOPENED_EVERY_NS`."""
        now_ns = self._clock.now_ns()
        if self._reopen is None or now_ns - self._opened_ns < REOPENED_EVERY_NS:
            return
        self._opened_ns = now_ns
        self.close()
        try:
            self._use(self._reopen())
        except (BusError, UsageError):
            # It has been told that the bus is down.
            self._use(None)


_BOOT_NS = 1_000_000
"""Time after power-on by which a drive has sent its boot-up message and is ready."""
_ASKING_NS = 30_000_000
"""Time in which a node that is on the bus already is heard, and then answers."""
_READ_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")
_BURST = 1000
"""Most frames sent before the bus is read again, in case drives answer each other without end."""


def host(
    bus: BusName,
    slots: Sequence[DriveOnBus],
    seed: int,
    ready: Callable[[DriveOnBus], None],
    stopped: Callable[[], bool],
    tell: Tell = lambda _sentence: None,
    opened: Callable[[BusName], None] = lambda _bus: None,
) -> int:
    """Host drives until `stopped()` is True; return the number of frames that could not be sent.

    `opened` is called once the bus is open, `ready` for each drive once it has booted; `tell` gets a sentence when the
    bus goes down or returns. Raises UsageError or BusError when the bus cannot be opened, BusError when another device
    on it has the node-ID of a drive, also when it comes later, and UsageError when two drives have the same node-ID.
    """
    section = can_section(bus.section)
    clock = MonotonicClock()
    host_port = HostPort(open_can(section), clock, bus.text, tell, partial(open_can, section))
    try:
        if taken := _taken({slot.node for slot in slots}, host_port, clock):
            raise host_port.twice(taken)
        opened(bus)
        subject = Host(host_port, clock, seed, bitrate=section.bitrate)
        for slot in slots:
            subject.add(slot)
        subject.serve_for(_BOOT_NS)
        with frozen():
            for slot in slots:
                ready(slot)
            while not stopped():
                subject.serve(NAP_NS)
        return host_port.lost
    finally:
        host_port.close()


def _taken(nodes: set[int], host_port: HostPort, clock: Clock) -> set[int]:
    """Return the node-IDs that other devices have: those that send unasked, and those that answer one SDO request.

    A node that is heard first is not asked, since the request could disturb its master.
    """
    taken: set[int] = set()
    for asked in (False, True):
        for node in sorted(nodes - taken) if asked else ():
            host_port.send(Frame(SDO_REQUEST_COB_ID + node, _READ_DEVICE_TYPE))
        end_ns = clock.now_ns() + _ASKING_NS
        while taken < nodes and (remaining_ns := end_ns - clock.now_ns()) > 0:
            frame = host_port.receive(remaining_ns)
            if frame is not None and not frame.remote and not frame.extended:
                taken |= nodes & {frame.can_id - SDO_RESPONSE_COB_ID, frame.can_id - HEARTBEAT_COB_ID}
    return taken


class Host:
    """Simulated drives on a bus, served in one thread."""

    def __init__(
        self, host_port: HostPort, clock: Clock, seed: int = DEFAULT_SEED, *, bitrate: int = DEFAULT_BIT_RATE
    ) -> None:
        self._host_port = host_port
        self._clock = clock
        self._bitrate = bitrate
        self._served_ns = clock.now_ns()
        """Time up to which all events have been served."""
        self._drives = SimulatedDrives(seed, LONGEST_REMEMBERED)
        self._routes: list[object] = []
        """Handlers of the nodes at the last setting of the frame filter."""
        self._nodes: frozenset[int] = frozenset()
        """Node-IDs at that time."""

    def add(self, slot: DriveOnBus) -> None:
        """Build a drive with everything for its steps, and power it on; raises UsageError when its node-ID is taken."""
        slave = self._drives.add(slot, Port(in_order=False), self._clock.now_ns())
        self._routes.append(None)
        slave.node.commission(self._bitrate)
        slave.drive.plant.prepare()

    def serve(self, longest_ns: int) -> None:
        """Handle one received frame or the next due timer, within `longest_ns`; raises BusError for our own heartbeat.

        Two devices that begin at the same time find each other by it.
        """
        # A frame that waits may have come before a timer that is due: what waits is looked at first.
        frame = self._host_port.receive(min(longest_ns, self._drives.due_ns - self._clock.now_ns()))
        if frame is None:
            self._catch_up(self._clock.now_ns())
            # The shafts are followed while there is time: after a long silence it would hold up the first answer.
            for _port, slave in self._drives.attached:
                slave.drive.servo.advance(self._served_ns)
            return
        if frame.can_id - HEARTBEAT_COB_ID in self._nodes and not frame.remote and not frame.extended:
            raise self._host_port.twice((frame.can_id - HEARTBEAT_COB_ID,))
        t_ns = self._host_port.arrived_ns(self._served_ns)
        self._catch_up(t_ns)
        self._drives.receive(frame, None, t_ns)
        self._flush(t_ns)

    def serve_for(self, duration_ns: int) -> None:
        """Serve the drives for this duration."""
        end_ns = self._clock.now_ns() + duration_ns
        while (remaining_ns := end_ns - self._clock.now_ns()) > 0:
            self.serve(remaining_ns)

    def _catch_up(self, now_ns: int) -> None:
        """Serve all timers that are due, each with its own instant."""
        self._served_ns = now_ns
        while (due_ns := self._drives.due_ns) <= now_ns:
            self._drives.timers(due_ns)
            self._flush(due_ns)

    def _flush(self, t_ns: int) -> None:
        """Send the waiting frames, the most urgent first, and pass each one to the other drives of this host."""
        # Before an answer is sent that lets a master use what has changed.
        self._focus()
        for _ in range(_BURST):
            if not (waiting := [port for port, _slave in self._drives.attached if port.waiting]):
                return
            port = min(waiting, key=Port.urgency)
            frame = port.take()
            self._host_port.send(frame)
            self._drives.receive(frame, port, t_ns)

    def _focus(self) -> None:
        """Tell the bus which frames concern the drives, when a parameter or a state has changed."""
        slaves = [slave for _port, slave in self._drives.attached]
        if not all(map(is_, (slave.node.handlers for slave in slaves), self._routes)):
            self._routes = [slave.node.handlers for slave in slaves]
            self._nodes = frozenset(slave.node.number for slave in slaves)
            # Their own heartbeats too: only another device sends those to us.
            own = frozenset((HEARTBEAT_COB_ID + node, False) for node in self._nodes)
            self._host_port.focus(own.union(*(slave.concerns for slave in slaves)))

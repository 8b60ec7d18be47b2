"""Simulated drives on a python-can bus, in real time and in one thread, for masters in other programs.

Theory: the real bus replaces the simulated wire, so bit times are not simulated; the drives are the same. The thread
waits in `recv` until the next timer of a drive falls due. Each timer is served with the instant at which it was due,
not the instant of waking up. So the lateness of the host does not accumulate, and the shafts move as if there were
none. Frames that the drives send at one instant go out in the order of their priority, as on a wire.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import can

from haptic_fieldbus.buses.canopen.errors import FOREIGN, is_queue_full, translate
from haptic_fieldbus.buses.canopen.opening import open_can
from haptic_fieldbus.buses.canopen.wire import ECHOING
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, DEFAULT_HOSTED_HAND, DEFAULT_NODE, DEFAULT_SEED
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.bus_name import BusName
from haptic_fieldbus.protocols.canopen.bus import NODES, can_section
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.channel import NamedDrive, drive_of, slot_of
from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.canopen.link.wire import Port
from haptic_fieldbus.sim.canopen.rack import Rack
from haptic_fieldbus.sim.faults import Disturbance, Fault, HostFault, LineFault
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.slot import Slot

LONGEST_REMEMBERED = 1000
"""Least number of latest motion segments that are kept; no caller needs more."""

_NAP_NS = 100_000_000
"""Longest wait, so that a request to stop is noticed soon."""
_BOOT_NS = 1_000_000
"""Time after power-on by which a drive has sent its boot-up message and is ready."""
_BURST = 1000
"""Most frames sent before the bus is read again, in case drives answer each other without end."""


@dataclass(frozen=True)
class HostRequest:
    """Drives to host and the bus to host them on.

    `drives` are written `PROFILE` or `PROFILE@NODE`; the first without a node-ID gets `node`, the others the next free
    ones.
    """

    drives: Sequence[str]
    bus: str | None
    node: int = DEFAULT_NODE
    hand: str = DEFAULT_HOSTED_HAND
    faults: tuple[Fault, ...] = ()
    profiles: str | Path | None = None
    """Folder of one's own profiles (see `load_profile`)."""


def host(
    bus: BusName, slots: Sequence[Slot], seed: int, ready: Callable[[Slot], None], stopped: Callable[[], bool]
) -> int:
    """Host drives until `stopped()` is True; return the number of frames that could not be sent.

    `ready` is called for each drive once it has booted. Raises UsageError or BusError when the bus cannot be opened,
    BusError when it fails later, and ValueError when two drives have the same node-ID.
    """
    section = can_section(bus.section)
    can_bus = open_can(section)
    try:
        echoes = section.interface in ECHOING
        subject = Host(can_bus, MonotonicClock(), bus.text, seed, bitrate=section.bitrate, echoes=echoes)
        for slot in slots:
            subject.add(slot)
        subject.serve_for(_BOOT_NS)
        for slot in slots:
            ready(slot)
        while not stopped():
            subject.serve(_NAP_NS)
        return subject.lost
    finally:
        can_bus.shutdown()


def resolve(request: HostRequest) -> tuple[BusName, list[Slot]]:
    """Return the bus of a request and the slots to put on it.

    Raises one UsageError that lists all faults of the request, or ProfileError or EdsError for a bad profile file.
    """
    faults = [
        f'fault "{fault.kind}" is one of the bus or of the master\'s computer, which are not simulated here'
        for fault in request.faults
        if isinstance(fault, LineFault | HostFault)
    ] + [
        f'fault "{fault.kind}" names the bus "{fault.bus}" of a rig; here is one bus, leave it out'
        for fault in request.faults
        if fault.bus is not None
    ]
    slots: list[Slot] = []
    bus, drives, hand = None, [], None
    with _collecting(faults):
        hand = hand_named(request.hand)
    with _collecting(faults):
        bus = joined_bus(request.bus)
    with _collecting(faults):
        drives = numbered(request.drives, request.node)
    for drive in drives:
        with _collecting(faults):
            bench = (drive, request.bus or "", Workspace.LINEAR, hand, request.faults)
            slots.append(slot_of(*bench, booted=False, profiles=request.profiles))
    if bus is None or faults:
        raise UsageError("\n".join(faults))
    return bus, slots


@contextmanager
def _collecting(faults: list[str]) -> Iterator[None]:
    try:
        yield
    except UsageError as error:
        faults.append(str(error))


def joined_bus(text: str | None) -> BusName:
    """Parse the name of a bus that other programs can join.

    Raises UsageError for no bus, an unknown one, or the simulated one, which exists inside a single program.
    """
    example = "socketcan:can0, udp_multicast:239.74.163.2"
    if text is None:
        raise UsageError(f"--bus says where the drives are hosted, for example {example}")
    name = parse_bus(text)
    if name.simulated:
        raise UsageError(f'bus "{text}": no other program can join it; host on {example} or virtual:CHANNEL')
    return name


def numbered(texts: Sequence[str], first: int) -> list[NamedDrive]:
    """Return every drive with its node-ID: the one it is written with, else the next free one from `first` on.

    Raises UsageError for a node-ID that is used twice or out of range, and when none is left.
    """
    asking = [text.rpartition("@")[2].isdecimal() and "@" in text for text in texts]
    taken = [drive_of(text).node for text, asks in zip(texts, asking, strict=True) if asks]
    twice = sorted({node for node in taken if taken.count(node) > 1})
    if twice:
        raise UsageError(f"node-ID {', '.join(map(str, twice))} is asked for twice")
    if first not in NODES:
        raise UsageError(f"node {first}: a node-ID is a whole number from {NODES[0]} to {NODES[-1]}")
    free = (node for node in NODES if node >= first and node not in taken)
    drives = []
    for text, asks in zip(texts, asking, strict=True):
        node = drive_of(text).node if asks else next(free, None)
        if node is None:
            raise UsageError(f"no node-ID is left for {text}")
        drives.append(drive_of(text) if asks else NamedDrive(text, node))
    return drives


class Host:
    """Simulated drives on a bus, served in one thread.

    `name` is the bus in messages. `echoes` tells that the bus returns the frames that are sent on it.
    """

    def __init__(
        self,
        can_bus: can.BusABC,
        clock: Clock,
        name: str,
        seed: int = DEFAULT_SEED,
        *,
        bitrate: int = DEFAULT_BIT_RATE,
        echoes: bool = False,
    ) -> None:
        self.lost = 0
        """Number of frames that could not be sent because the transmit queue was full."""
        self._bus = can_bus
        self._clock = clock
        self._name = name
        self._bitrate = bitrate
        self._echoes = echoes
        self._rack = Rack(_Elsewhere(), seed, LONGEST_REMEMBERED)

    def add(self, slot: Slot) -> None:
        """Power a drive on now; raises ValueError when its node-ID is taken."""
        slave = self._rack.add(slot, Port(in_order=False), self._clock.now_ns())
        slave.node.commission(self._bitrate)
        slave.drive.plant.prepare()

    def serve(self, longest_ns: int) -> None:
        """Handle one received frame or the next due timer, within `longest_ns`; raises BusError when the bus fails."""
        now_ns = self._clock.now_ns()
        self._catch_up(now_ns)
        message = self._receive(min(longest_ns, self._rack.due_ns - now_ns))
        if message is None or message.is_error_frame or message.is_fd:
            return
        data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
        frame = Frame(message.arbitration_id, data, message.is_extended_id, message.is_remote_frame)
        # Time has passed in `recv`: timers that fell due meanwhile come before the frame.
        now_ns = self._clock.now_ns()
        self._catch_up(now_ns)
        self._rack.receive(frame, None, now_ns)
        self._flush(now_ns)

    def serve_for(self, duration_ns: int) -> None:
        """Serve the drives for this duration."""
        end_ns = self._clock.now_ns() + duration_ns
        while (remaining_ns := end_ns - self._clock.now_ns()) > 0:
            self.serve(remaining_ns)

    def _catch_up(self, now_ns: int) -> None:
        """Serve all timers that are due, each with its own instant."""
        while self._rack.due_ns <= now_ns:
            due_ns = self._rack.due_ns
            self._rack.timers(due_ns)
            self._flush(due_ns)

    def _flush(self, t_ns: int) -> None:
        """Send the waiting frames, the most urgent first, and pass each one to the other drives of this host."""
        for _ in range(_BURST):
            waiting = [port for port in self._ports() if port.waiting]
            if not waiting:
                return
            port = min(waiting, key=lambda port: port.candidate()[0])
            item = port.candidate()
            port.waiting.remove(item)
            self._send(item[1])
            # On an echoing bus the other drives receive this frame by `recv`; passing it on here would deliver it
            # twice.
            if not self._echoes:
                self._rack.receive(item[1], port, t_ns)

    def _ports(self) -> Iterator[Port]:
        return (port for port, _slave in self._rack.attached)

    def _send(self, frame: Frame) -> None:
        message = can.Message(
            arbitration_id=frame.can_id,
            is_extended_id=frame.extended,
            is_remote_frame=frame.remote,
            dlc=len(frame.data),
            data=None if frame.remote else frame.data,
        )
        try:
            self._bus.send(message)
        except FOREIGN as error:
            if not is_queue_full(error):
                raise translate(error, self._name) from error
            self.lost += 1

    def _receive(self, longest_ns: int) -> can.Message | None:
        try:
            return self._bus.recv(max(0, longest_ns) * 1e-9)
        except FOREIGN as error:
            raise translate(error, self._name) from error


class _Elsewhere:
    """Stand-in for the bus and the master's controller; `resolve` refuses the faults that concern them."""

    def bus_off(self, t_ns: int, until_ns: int) -> None:
        """Never called: `resolve` refuses this fault."""

    def interface_down(self, t_ns: int, until_ns: int) -> None:
        """Never called: `resolve` refuses this fault."""

    def error_frame(self, t_ns: int) -> None:
        """Never called: `resolve` refuses this fault."""

    def disturb(self, fault: Disturbance) -> None:
        """Never called: `resolve` refuses this fault."""

    def foreign_frame(self, can_id: int, data: bytes) -> None:
        """Never called: `resolve` refuses this fault."""

    def host_fault(self, fault: HostFault) -> None:
        """Never called: `resolve` refuses this fault."""

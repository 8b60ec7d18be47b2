"""Simulated drives on a python-can bus, in real time and in one thread, for masters in other programs.

Theory: the real bus replaces the simulated wire, so bit times are not simulated; the drives are the same. The thread
waits for a frame until the next timer of a drive falls due. Each timer is served with the instant at which it was due,
not the instant of waking up, and a frame with the instant at which it arrived, where that is known. So the lateness of
the host does not accumulate, and the shafts move as if there were none. Frames that the drives send at one instant go
out in the order of their priority, as on a wire.

A step must not be late for its own reasons, so all that steps need is built before a drive is *ready*: no matrix
exponential is computed and no module imported afterwards, and what exists then is kept out of garbage collection.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from operator import is_

from haptic_fieldbus.buses.canopen.opening import open_can
from haptic_fieldbus.buses.canopen.wire import ECHOING
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.defaults import DEFAULT_BIT_RATE, DEFAULT_SEED
from haptic_fieldbus.protocols.bus_name import BusName
from haptic_fieldbus.protocols.canopen.bus import can_section
from haptic_fieldbus.sim.canopen.link.wire import Port
from haptic_fieldbus.sim.canopen.outlet import STAMPED, Outlet, Tell
from haptic_fieldbus.sim.canopen.rack import KINDS as KINDS
from haptic_fieldbus.sim.canopen.rack import Rack
from haptic_fieldbus.sim.faults import Disturbance, HostFault
from haptic_fieldbus.sim.realtime import LONGEST_REMEMBERED, NAP_NS, frozen
from haptic_fieldbus.sim.slot import Slot

_BOOT_NS = 1_000_000
"""Time after power-on by which a drive has sent its boot-up message and is ready."""
_BURST = 1000
"""Most frames sent before the bus is read again, in case drives answer each other without end."""


def host(
    bus: BusName,
    slots: Sequence[Slot],
    seed: int,
    ready: Callable[[Slot], None],
    stopped: Callable[[], bool],
    tell: Tell = lambda _sentence: None,
    opened: Callable[[BusName], None] = lambda _bus: None,
) -> int:
    """Host drives until `stopped()` is True; return the number of frames that could not be sent.

    `opened` is called once the bus is open, `ready` for each drive once it has booted; `tell` gets a sentence when the
    bus goes down or comes back.
    Raises UsageError or BusError when the bus cannot be opened, and ValueError when two drives have the same node-ID.
    """
    section = can_section(bus.section)
    clock = MonotonicClock()
    outlet = Outlet(
        open_can(section),
        clock,
        bus.text,
        tell,
        partial(open_can, section),
        echoes=section.interface in ECHOING,
        stamped=section.interface in STAMPED,
    )
    try:
        opened(bus)
        subject = Host(outlet, clock, seed, bitrate=section.bitrate)
        for slot in slots:
            subject.add(slot)
        subject.serve_for(_BOOT_NS)
        with frozen():
            for slot in slots:
                ready(slot)
            while not stopped():
                subject.serve(NAP_NS)
        return outlet.lost
    finally:
        outlet.close()


class Host:
    """Simulated drives on a bus, served in one thread."""

    def __init__(
        self,
        outlet: Outlet,
        clock: Clock,
        seed: int = DEFAULT_SEED,
        *,
        bitrate: int = DEFAULT_BIT_RATE,
    ) -> None:
        self._outlet = outlet
        self._clock = clock
        self._bitrate = bitrate
        self._served_ns = clock.now_ns()
        """Up to here all has been served."""
        self._rack = Rack(_Elsewhere(), seed, LONGEST_REMEMBERED)
        self._routes: list[object] = []
        """Handlers of the nodes when the bus was told last which frames concern them."""

    def add(self, slot: Slot) -> None:
        """Build a drive, with all that its steps need, and power it on; raises ValueError when its node-ID is taken."""
        slave = self._rack.add(slot, Port(in_order=False), self._clock.now_ns())
        self._routes.append(None)
        slave.node.commission(self._bitrate)
        slave.drive.plant.prepare()

    def serve(self, longest_ns: int) -> None:
        """Handle one received frame or the next due timer, within `longest_ns`."""
        # A frame that waits may have come before a timer that is due: what waits is looked at first.
        frame = self._outlet.receive(min(longest_ns, self._rack.due_ns - self._clock.now_ns()))
        if frame is None:
            self._catch_up(self._clock.now_ns())
            # The shafts are followed while there is time: after a long silence it would hold up the first answer.
            for _port, slave in self._rack.attached:
                slave.drive.servo.advance(self._served_ns)
            return
        t_ns = self._outlet.arrived_ns(self._served_ns)
        self._catch_up(t_ns)
        self._rack.receive(frame, None, t_ns)
        self._flush(t_ns)

    def serve_for(self, duration_ns: int) -> None:
        """Serve the drives for this duration."""
        end_ns = self._clock.now_ns() + duration_ns
        while (remaining_ns := end_ns - self._clock.now_ns()) > 0:
            self.serve(remaining_ns)

    def _catch_up(self, now_ns: int) -> None:
        """Serve all timers that are due, each with its own instant."""
        self._served_ns = now_ns
        while self._rack.due_ns <= now_ns:
            due_ns = self._rack.due_ns
            self._rack.timers(due_ns)
            self._flush(due_ns)

    def _flush(self, t_ns: int) -> None:
        """Send the waiting frames, the most urgent first, and pass each one to the other drives of this host."""
        # Before an answer is sent that lets a master use what has changed.
        self._focus()
        for _ in range(_BURST):
            waiting = [port for port in self._ports() if port.waiting]
            if not waiting:
                return
            port = min(waiting, key=lambda port: port.candidate()[0])
            item = port.candidate()
            port.waiting.remove(item)
            self._outlet.send(item[1])
            self._rack.receive(item[1], port, t_ns)

    def _focus(self) -> None:
        """Tell the bus which frames concern the drives, when a parameter or a state has changed."""
        slaves = [slave for _port, slave in self._rack.attached]
        if not all(map(is_, (slave.node.handlers for slave in slaves), self._routes)):
            self._routes = [slave.node.handlers for slave in slaves]
            self._outlet.focus(frozenset().union(*(slave.concerns for slave in slaves)))

    def _ports(self) -> Iterator[Port]:
        return (port for port, _slave in self._rack.attached)


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

"""Simulated drives behind a Modbus server, in real time and in one thread, for masters in other programs.

Theory: the wires are real, or provided by the operating system, so their times are not simulated. Nor is the processing
time of a drive: it answers as soon as it can. The drives are the same as in virtual time. Each timer is served with the
instant at which it was due, and a request with the instant of its arrival. So the lateness of the host does not
accumulate and does not change the motion of the shafts.
"""

import asyncio
import errno
import logging
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.server.base import ModbusBaseServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.buses.modbus.transport import port_errors, translate
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, line_of, modbus_section
from haptic_fieldbus.protocols.modbus.profile import Parity, modbus_profile
from haptic_fieldbus.protocols.modbus.register_traffic import LineTimes
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.bench import LONGEST_REMEMBERED, NAP_NS, DrivenBus, frozen, until
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.modbus.drives import KINDS
from haptic_fieldbus.sim.modbus.station import RequestServer, ServerRequest, starts_no_frame
from haptic_fieldbus.sim.modbus.unit import Unit
from haptic_fieldbus.sim.simulation import HostClock, Simulation, truth_of

# Drives behind pymodbus's servers, which listen, accept and carry octets; requests are carried out here.
#
# The servers' own handlers answer from a table of registers, and the last of several requests in one packet alone. So
# each connection has a handler of ours, which gives its octets to the drives with the instant at which they came.

# What pymodbus notes is told by nobody; it must not fall back to standard error.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

SILENCE_NS = 20_000_000
"""Silence on a serial line after which earlier octets are discarded; longer than adapters hold octets back."""
_NOTHING = SimDevice(0, simdata=SimData(0, datatype=DataType.REGISTERS))
"""Registers that a server must have; they are never read."""


class Connection(ServerRequestHandler):
    """One master's connection, or the serial line."""

    def __init__(
        self, owner: ModbusBaseServer, requests: RequestServer, clock: Clock, is_dead: Callable[[], bool]
    ) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._requests, self._clock, self._is_dead = requests, clock, is_dead
        self._serial = isinstance(owner, ModbusSerialServer)
        self._octets, self._heard_ns = b"", 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if self._is_dead():
            self.reset()

    def data_received(self, data: bytes) -> None:
        """Execute the requests in the received octets, and answer them."""
        now_ns = self._clock.now_ns()
        if self._serial and now_ns > self._heard_ns + SILENCE_NS:
            self._octets = b""
        self._octets, self._heard_ns = self._octets + data, now_ns
        self._requests.drives.run(now_ns)
        while self._octets and not self._is_dead():
            if not self._serial and starts_no_frame(self._octets):
                self.reset()
                return
            used, asked = self._requests.next(self._octets)
            if not used:
                return
            self._octets = self._octets[used:]
            held = self._requests.disturbances.released()
            arriving = [] if asked is None else list(self._requests.answer(asked, now_ns))
            for later_ns, octets in [(0, each) for each in held] + arriving:
                self._say(later_ns, octets)

    def reset(self) -> None:
        """End the connection; a serial line only discards its received octets."""
        self._octets = b""
        if not self._serial and isinstance(self.transport, asyncio.WriteTransport):
            self.transport.abort()

    def _say(self, later_ns: int, octets: bytes) -> None:
        if later_ns:
            self.loop.call_later(later_ns * 1e-9, partial(self._say, 0, octets))
        elif isinstance(self.transport, asyncio.WriteTransport) and not (
            self._is_dead() or self.transport.is_closing()
        ):
            self.transport.write(octets)


class Server:
    """Drives on one TCP port or one serial device."""

    def __init__(self, clock: Clock, seed: int, *, serial: bool, longest: int | None) -> None:
        self.requests = RequestServer(self.inject_line, seed, serial=serial, longest=longest)
        self._clock = clock
        self._listener: ModbusBaseServer | None = None
        self._connections: list[Connection] = []
        self._dead_until_ns = -NEVER_NS

    async def listen_tcp(self, host: str, port: int) -> int:
        """Listen; return the port, a free one for 0. Raises OSError."""
        listener = _TcpServer(_NOTHING, address=(host, port))
        transport = await self._listen(listener)
        sockets = transport.sockets if isinstance(transport, asyncio.Server) else ()
        return int(sockets[0].getsockname()[1])

    async def listen_serial(self, device: str, baud: int, parity: str, stop_bits: int) -> None:
        """Listen on a serial device; raises OSError."""
        listener = _SerialServer(_NOTHING, port=device, baudrate=baud, parity=parity, stopbits=stop_bits)
        await self._listen(listener)

    async def close(self) -> None:
        """End all connections, and listen no more."""
        if self._listener is not None:
            await self._listener.shutdown()  # type: ignore[no-untyped-call]

    def inject_line(self, fault: faults.LineDisturbance | faults.HostFault, number: int, t_ns: int) -> None:
        """Disturb the next answers of a drive, or end all connections; `resolve` refuses faults of the host."""
        if isinstance(fault, faults.ConnectionReset):
            self._dead_until_ns = until(t_ns, fault.duration)
            for connection in self._connections:
                connection.reset()
        elif not isinstance(fault, faults.HostFault):
            self.requests.disturbances.add(fault, number)

    # Inside.

    def _connected(self, listener: ModbusBaseServer) -> Connection:
        self._connections = [each for each in self._connections if each.transport]
        self._connections.append(Connection(listener, self.requests, self._clock, self._is_dead))
        return self._connections[-1]

    def _is_dead(self) -> bool:
        return self._clock.now_ns() < self._dead_until_ns

    async def _listen(self, listener: "_TcpServer | _SerialServer") -> object:
        """Listen as `listener.listen` does, but raise the reason of a failure, which it hides."""
        self._listener, listener.connected = listener, partial(self._connected, listener)
        found = await listener.call_create()
        transport = found[0] if isinstance(found, tuple) else found
        listener.transport, listener.is_listener = transport, True
        return transport


class _Listener:
    connected: Callable[[], Connection]

    def callback_new_connection(self) -> Connection:
        return self.connected()


class _TcpServer(_Listener, ModbusTcpServer):
    """A server on a TCP port."""


class _SerialServer(_Listener, ModbusSerialServer):
    """A server on a serial device."""


PTY = "pty"
"""Channel of a serial bus without a device: creates a pair of pseudo-terminals and reports the other end."""

PSEUDO_TERMINALS = "/dev/pts/"
WITHOUT_PARITY = (
    "{} is a pseudo-terminal without parity: open it with parity N (none). With even or odd parity pyserial fails "
    "with termios error 22 (Invalid argument), at the first or a later opening"
)


def host(
    bus: BusName,
    slots: Sequence[DriveOnBus],
    seed: int,
    ready: Callable[[DriveOnBus], None],
    stopped: Callable[[], bool],
    tell: Callable[[str], None] = lambda _sentence: None,
    opened: Callable[[BusName], None] = lambda _bus: None,
) -> int:
    """Host drives until `stopped()` is True; return 0, since no answer is lost here.

    `opened` is called with the open bus, which has the port or the device for masters, and `ready` for each drive.
    Raises BusError when the bus cannot be opened, and ValueError when two drives have the same unit id. Raises
    PlanError for drives that are not made for such a line.
    """
    section, clock = modbus_section(bus.section), MonotonicClock()
    line_of(section, [modbus_profile(slot.profile) for slot in slots])
    errors = port_errors() if section.serial else (OSError, UnicodeError)

    async def serve() -> None:
        server = Server(clock, seed, serial=section.serial, longest=LONGEST_REMEMBERED)
        for slot in slots:
            server.requests.drives.add(slot, clock.now_ns()).drive.plant.prepare()
        with device(section) as (own, theirs):
            try:
                joined = await listen(server, own, theirs, slots)
            except errors as error:
                raise translate(error, bus.text) from error
            try:
                opened(protocol_named(section.protocol).bus_name(joined))
                if joined.channel.startswith(PSEUDO_TERMINALS):
                    tell(WITHOUT_PARITY.format(joined.channel))
                with frozen():
                    for slot in slots:
                        ready(slot)
                    while not stopped():
                        await asyncio.sleep(NAP_NS * 1e-9)
                        server.requests.drives.run(clock.now_ns())
            finally:
                await server.close()

    asyncio.run(serve())
    return 0


async def listen(
    server: Server, own: ModbusSection, theirs: ModbusSection, slots: Sequence[DriveOnBus]
) -> ModbusSection:
    """Let the server listen on its own end; return the end for masters, with the port or device now known."""
    if not own.serial:
        host, port = own.address
        port = await server.listen_tcp(host, port)
        return replace(theirs, channel=f"[{host}]:{port}" if ":" in host else f"{host}:{port}")
    line = modbus_profile(slots[0].profile).line
    # A pseudo-terminal has no parity, and refuses to be set to one.
    parity = "none" if own.channel.startswith(PSEUDO_TERMINALS) else own.parity or line.parity
    stop_bits = own.stop_bits or line.stop_bits
    await server.listen_serial(own.channel, own.baud or line.baud, parity[0].upper(), stop_bits)
    return theirs


@contextmanager
def device(section: ModbusSection) -> Iterator[tuple[ModbusSection, ModbusSection]]:
    """Yield the end of the line for the drives, and the end for masters."""
    if not section.serial or section.channel != PTY:
        yield section, section
        return
    with _cable() as (first, second):
        yield replace(section, channel=first), replace(section, channel=second)


@contextmanager
def _cable() -> Iterator[tuple[str, str]]:
    """Yield the names of two pseudo-terminals: octets written to one are read from the other."""
    from tty import setraw  # Windows has none; `port_errors` has refused it

    pairs = [os.openpty(), os.openpty()]
    loop, (one, other) = asyncio.get_running_loop(), (pair[0] for pair in pairs)
    for _, end in pairs:
        setraw(end)  # the descriptor stays open, so that a master may come and go
    for source, target in ((one, other), (other, one)):
        os.set_blocking(target, False)
        loop.add_reader(source, _copy, source, target)
    try:
        yield os.ttyname(pairs[0][1]), os.ttyname(pairs[1][1])
    finally:
        for pair in pairs:
            loop.remove_reader(pair[0])
            for descriptor in pair:
                os.close(descriptor)


def _copy(source: int, target: int) -> None:
    """Pass octets on; octets that the other end does not read are lost, as on a wire."""
    octets = os.read(source, 4096)
    try:
        os.write(target, octets)
    except BlockingIOError:
        return


# A Modbus line with its drives in virtual time, as the transport of a master.
#
# Theory. A request is under way for its characters (none on TCP) and half of the round trip. On RTU the silence after a
# request marks its end. The drive works for its answer time, and writes and reads its registers at the end of this
# time. Then the answer is transmitted in the same way. On RTU, without the silence between them, the drives read other
# octets and a following request as one frame, and do not understand it.
#
# Time passes while the master waits, for an answer or for anything else. Each access to the line runs the due events of
# the drives, each at its own instant. Everything random is drawn from the seed, so the same seed gives the same octets.


_TOLERANCE_NS = 1_000
"""Permitted shortfall of a silence, for rounding."""

Tap = Callable[[int, bool, bytes], None]
"""Callback for a frame: begin [ns], True if the master sent it, and the octets that arrive."""


class _Arrival(NamedTuple):
    """Octets on their way to the master: arrival of the first and of the last one [ns]."""

    first_ns: int
    last_ns: int
    octets: bytes


class SimulatedLine(DrivenBus):
    """A line with its drives; the times are those of `clock`, the host's."""

    def __init__(
        self,
        name: str,
        wire: LineTimes,
        clock: Clock,
        seed: int | str = DEFAULT_SEED,
        *,
        serial: bool,
        echo: bool = False,
    ) -> None:
        """With `echo` the master receives its own frames, as with some adapters."""
        self.name, self.serial = name, serial
        self._wire, self._host, self._clock, self._echo = wire, clock, truth_of(clock), echo
        self._requests = RequestServer(self.inject_line, seed, serial=serial)
        self._drives = self._requests.drives
        super().__init__(self._drives)
        self._coming: list[_Arrival] = []
        self._next_ns = NEVER_NS
        """Arrival of the last octet of the frame that comes first."""
        self._octet_ns = wire.octet * 1e9
        self._way_ns, self._silence_ns = round(0.5 * wire.round_trip * 1e9), round(wire.silence * 1e9)
        self._traffic: deque[tuple[int, int]] = deque()
        """Begin and end [ns] of recent and coming frames on the line."""
        self._dead_since_ns = self._dead_until_ns = 0
        self._broken = False
        self._taps: list[Tap] = []

    # Setting up.

    def add(self, slot: DriveOnBus) -> Unit:
        """Put a drive on the line; raises ValueError when its unit id is taken."""
        return self._drives.add(slot, self._clock.now_ns())

    def unit(self, number: int) -> Unit:
        return self._drives.units[number]

    def tap(self, callback: Tap) -> None:
        """Call `callback` with every frame."""
        self._taps.append(callback)

    # The transport.

    def tune(self, baud: int, parity: Parity, stop_bits: int) -> None:
        """Do nothing: the plan sets the speed of a simulated line."""

    def discard(self) -> bytes:
        """Drop all octets that wait, and return them; raises BusError when the line is dead."""
        return self._taken(self._check_alive())

    def send(self, frame: bytes | bytearray) -> None:
        """Send a frame; raises BusError when the line is dead."""
        begin_ns, frame = self._check_alive(), bytes(frame)  # a master fills the same octets again
        for tap in self._taps:
            tap(begin_ns, True, frame)
        end_ns, glued = begin_ns + round(self._octet_ns * len(frame)), False
        if self.serial:
            glued = self._is_glued(begin_ns)
            self._traffic.append((begin_ns, end_ns))
        if self._echo:
            self._comes(begin_ns, frame)
        for octets in self._requests.disturbances.released():
            self._comes(begin_ns + self._way_ns, octets)
        _, asked = self._requests.next(frame)
        if asked is not None and not glued:
            heard_ns = end_ns + self._way_ns + self._silence_ns
            self._drives.queue.plan(heard_ns + self._answer_ns(asked), partial(self._execute, asked))

    def receive(self, deadline_ns: int) -> bytes:
        """Return the octets that have arrived; the clock advances to the end of an answer, or to the deadline [ns]."""
        clock, drives, now_ns = self._clock, self._drives, self._check_alive()
        if octets := self._taken(now_ns):
            return octets
        limit_ns = now_ns + max(0, deadline_ns - self._host.now_ns())
        while (due_ns := drives.next_due_ns) <= (end_ns := min(limit_ns, self._next_ns)):
            drives.serve(due_ns)
            if self._broken:
                clock.sleep_until(min(limit_ns, self._dead_since_ns))
                self._check_alive()
        clock.sleep_until(end_ns)
        now_ns = clock.now_ns()
        if now_ns >= due_ns:  # a real clock has gone on
            drives.run(now_ns)
        drives.now_ns = now_ns
        return self._taken(now_ns)

    def reopen(self) -> None:
        """Reopen a dead line; raises BusError while that is not possible."""
        if self._clock.now_ns() < self._dead_until_ns:
            raise self._error(errno.ENOENT if self.serial else errno.ECONNREFUSED)
        self._broken = False
        self._lose()

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def run(self) -> None:
        """Run all events up to the present of the clock."""
        self._drives.run(self._clock.now_ns())

    @property
    def reached_ns(self) -> int:
        return self._drives.now_ns

    # Faults.

    def inject_line(self, fault: faults.LineDisturbance | faults.HostFault, number: int, t_ns: int) -> None:
        """Disturb the next answers of a drive, or break the line, or let a fault of the master's computer happen.

        Raises ValueError for the last one when the clock of the host is not simulated.
        """
        if isinstance(fault, faults.HostFault):
            if not isinstance(self._host, HostClock):
                raise ValueError(f'fault "{fault.kind}" needs a simulated clock of the host')
            self._host.happen(fault)
        elif isinstance(fault, faults.ConnectionReset):
            self._broken, self._dead_since_ns, self._dead_until_ns = True, t_ns, until(t_ns, fault.duration)
            self._lose()
        else:
            self._requests.disturbances.add(fault, number)

    # Inside.

    def _answer_ns(self, asked: ServerRequest) -> int:
        unit = self._drives.units.get(asked.unit)
        return 0 if unit is None else unit.answer_ns

    def _execute(self, asked: ServerRequest, t_ns: int) -> None:
        """Execute a request, and send its answer."""
        for later_ns, octets in self._requests.answer(asked, t_ns):
            for tap in self._taps:
                tap(t_ns + later_ns, False, octets)
            self._comes(t_ns + later_ns + self._way_ns, octets)

    def _comes(self, begin_ns: int, octets: bytes) -> None:
        """Let octets arrive; the first one arrives one character after `begin_ns`."""
        if octets:
            self._coming.append(self._arriving(begin_ns + round(self._octet_ns), octets))
            self._next_ns = min(self._next_ns, self._coming[-1].last_ns)
            if self.serial:
                self._traffic.append((begin_ns, begin_ns + round(self._octet_ns * len(octets))))

    def _arriving(self, first_ns: int, octets: bytes) -> _Arrival:
        return _Arrival(first_ns, first_ns + round(self._octet_ns * (len(octets) - 1)), octets)

    def _is_glued(self, t_ns: int) -> bool:
        """Return whether a frame is on the serial line at this time, or ended less than the silence before."""
        since_ns = t_ns - self._silence_ns + _TOLERANCE_NS
        self._traffic = deque(each for each in self._traffic if each[1] > since_ns)
        return any(begin_ns <= t_ns for begin_ns, _ in self._traffic)

    def _taken(self, now_ns: int) -> bytes:
        """Take the octets that have arrived by now."""
        coming, taken = self._coming, b""
        if not coming:
            return taken
        self._coming, self._next_ns = [], NEVER_NS
        for each in coming:
            if now_ns >= each.last_ns:
                taken += each.octets
                continue
            if now_ns >= each.first_ns:
                count = 1 + int((now_ns - each.first_ns) / self._octet_ns)
                taken += each.octets[:count]
                each = self._arriving(each.first_ns + round(self._octet_ns * count), each.octets[count:])
            self._coming.append(each)
            self._next_ns = min(self._next_ns, each.last_ns)
        return taken

    def _lose(self) -> None:
        """Lose all octets that are on their way to the master."""
        self._coming, self._next_ns = [], NEVER_NS

    def _check_alive(self) -> int:
        """Run all events up to the present [ns], and return it; raises BusError when the line is dead."""
        now_ns = self._clock.now_ns()
        self._drives.run(now_ns)
        if self._broken:
            raise self._error(errno.EIO if self.serial else errno.ECONNRESET)
        return now_ns

    def _error(self, number: int) -> Exception:
        return translate(OSError(number, ""), self.name)


# Creation of a simulated Modbus line with a master on it.


class ModbusSimulation(Simulation):
    """The simulation of Modbus lines."""

    kinds = KINDS

    def simulate(
        self, section: BusSection, channel: str, slots: Sequence[DriveOnBus], clock: Clock, seed: int | str, log: Any
    ) -> tuple[ModbusBus, SimulatedLine | None]:
        own = modbus_section(section)
        wire = line_of(own, [modbus_profile(slot.profile) for slot in slots])
        line = SimulatedLine(channel or own.interface, wire, clock, seed, serial=own.serial, echo=own.echo)
        # A clock that steps is no clock of the true motion: what the shaft did at its instants is not known.
        apart = any(isinstance(fault, faults.ClockStep) for slot in slots for fault in slot.faults)
        for slot in slots:
            line.add(slot)
        return ModbusBus(line, clock, own), (None if apart else line)


SIMULATION = ModbusSimulation()

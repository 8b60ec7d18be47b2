"""Simulated drives behind a Modbus server, in real time and in one thread, for masters in other programs.

Theory: the wires are real, or provided by the operating system, so their times are not simulated. Nor is the processing
time of a drive: it answers as soon as it can. The drives are the same as in virtual time. Each timer is served with the
instant at which it was due, and a request with the instant of its arrival. So the lateness of the host does not
accumulate and does not change the motion of the shafts.
"""

import asyncio
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.server.base import ModbusBaseServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from haptic_fieldbus.buses.modbus.transport import port_errors, translate
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, line_of, modbus_section
from haptic_fieldbus.protocols.modbus.profile import modbus_profile
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.bench import LONGEST_REMEMBERED, NAP_NS, frozen, until
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.modbus.drives import KINDS as KINDS
from haptic_fieldbus.sim.modbus.station import RequestServer, starts_no_frame

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
        self._serial = serial

    @property
    def gone(self) -> bool:
        """Return whether the serial device has gone, such as an adapter that was unplugged."""
        return self._serial and not self._connections[-1].transport

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
    Raises BusError when the bus cannot be opened or its device goes away, UsageError when two drives have the same unit
    id, and PlanError for drives that are not made for such a line.
    """
    section, clock = modbus_section(bus.section), MonotonicClock()
    line_of(section, [modbus_profile(slot.profile) for slot in slots])

    async def serve() -> None:
        server = Server(clock, seed, serial=section.serial, longest=LONGEST_REMEMBERED)
        for slot in slots:
            server.requests.drives.add(slot, clock.now_ns()).drive.plant.prepare()
        with device(section) as (own, theirs):
            joined = await listen(server, own, theirs, slots, bus.text)
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
                        if server.gone:
                            raise BusError(f"{bus.text}: the device has gone; plug it in, and host the drives again")
            finally:
                await server.close()

    asyncio.run(serve())
    return 0


async def listen(
    server: Server, own: ModbusSection, theirs: ModbusSection, slots: Sequence[DriveOnBus], name: str
) -> ModbusSection:
    """Let the server listen on its own end; return the end for masters, with the port or device now known.

    `name` is the bus in messages. Raises BusError when the bus cannot be opened.
    """
    errors = port_errors() if own.serial else (OSError, UnicodeError)
    try:
        return await _opened(server, own, theirs, slots)
    except errors as error:
        raise translate(error, name, own.channel if own.serial else None) from error


async def _opened(
    server: Server, own: ModbusSection, theirs: ModbusSection, slots: Sequence[DriveOnBus]
) -> ModbusSection:
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

"""Drives behind pymodbus's servers, which listen, accept and carry octets; requests are carried out here.

The servers' own handlers answer from a table of registers, and the last of several requests in one packet alone. So
each connection has a handler of ours, which gives its octets to the drives with the instant at which they came.
"""

import asyncio
import logging
from collections.abc import Callable
from functools import partial

from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.server.base import ModbusBaseServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from haptic_fieldbus.clock import Clock
from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.drive.broken import until
from haptic_fieldbus.sim.modbus.desk import Desk
from haptic_fieldbus.sim.modbus.station import starts_no_frame

# What pymodbus notes is told by nobody; it must not fall back to standard error.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

SILENCE_NS = 20_000_000
"""Silence after which octets on a serial line belong to no frame any more; longer than adapters hold octets back."""
_NOTHING = SimDevice(0, simdata=SimData(0, datatype=DataType.REGISTERS))
"""Registers that a server must have; nobody reads them."""


class Connection(ServerRequestHandler):
    """One master's connection, or the serial line."""

    def __init__(self, owner: ModbusBaseServer, desk: Desk, clock: Clock, is_dead: Callable[[], bool]) -> None:
        super().__init__(owner, None, None, None)  # type: ignore[no-untyped-call]
        self._desk, self._clock, self._is_dead = desk, clock, is_dead
        self._serial = isinstance(owner, ModbusSerialServer)
        self._octets, self._heard_ns = b"", 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if self._is_dead():
            self.reset()

    def data_received(self, data: bytes) -> None:
        """Carry out the requests in the octets that came, and answer them."""
        now_ns = self._clock.now_ns()
        if self._serial and now_ns > self._heard_ns + SILENCE_NS:
            self._octets = b""
        self._octets, self._heard_ns = self._octets + data, now_ns
        self._desk.rack.run(now_ns)
        while self._octets and not self._is_dead():
            if not self._serial and starts_no_frame(self._octets):
                self.reset()
                return
            used, asked = self._desk.station.next(self._octets)
            if not used:
                return
            self._octets = self._octets[used:]
            held = self._desk.disturbances.released()
            arriving = [] if asked is None else list(self._desk.answer(asked, now_ns))
            for later_ns, octets in [(0, each) for each in held] + arriving:
                self._say(later_ns, octets)

    def reset(self) -> None:
        """End the connection; a serial line only forgets what it has heard."""
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
        self.desk = Desk(self, seed, serial=serial, longest=longest)
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

    # Faults (see `rack.FaultyLine`).

    def disturb(self, fault: faults.LineDisturbance, number: int, t_ns: int) -> None:
        """Disturb the next answers of a drive, or end all connections."""
        if not isinstance(fault, faults.ConnectionReset):
            self.desk.disturbances.add(fault, number)
            return
        self._dead_until_ns = until(t_ns, fault.duration)
        for connection in self._connections:
            connection.reset()

    def host_fault(self, fault: faults.HostFault) -> None:
        """Never called: `resolve` refuses this fault."""

    # Inside.

    def _connected(self, listener: ModbusBaseServer) -> Connection:
        self._connections = [each for each in self._connections if each.transport]
        self._connections.append(Connection(listener, self.desk, self._clock, self._is_dead))
        return self._connections[-1]

    def _is_dead(self) -> bool:
        return self._clock.now_ns() < self._dead_until_ns

    async def _listen(self, listener: "_TcpServer | _SerialServer") -> object:
        """Listen as `listener.listen` does, which keeps to itself why it cannot."""
        self._listener, listener.connected = listener, partial(self._connected, listener)
        found = await listener.call_create()
        transport = found[0] if isinstance(found, tuple) else found
        listener.transport, listener.is_listener = transport, True
        return transport


class _TcpServer(ModbusTcpServer):
    connected: Callable[[], Connection]

    def callback_new_connection(self) -> Connection:
        return self.connected()


class _SerialServer(ModbusSerialServer):
    connected: Callable[[], Connection]

    def callback_new_connection(self) -> Connection:
        return self.connected()

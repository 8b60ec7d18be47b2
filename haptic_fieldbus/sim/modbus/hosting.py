"""Simulated drives behind a Modbus server, in real time and in one thread, for masters in other programs.

Theory: the wires are real, or those of the operating system, so their times are not simulated, and neither is the time
that a drive works on a request: it answers as soon as it can. The drives are the same as in virtual time. Each timer is
served with the instant at which it was due, and a request with the instant at which it came, so the lateness of the
host does not accumulate, and the shafts move as if there were none.
"""

import asyncio
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from haptic_fieldbus.buses.modbus.errors import port_errors, translate
from haptic_fieldbus.clock import MonotonicClock
from haptic_fieldbus.protocols.bus_name import BusName
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, modbus_section
from haptic_fieldbus.protocols.modbus.layout import line_of
from haptic_fieldbus.protocols.modbus.profile import modbus_profile
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.sim.modbus.rack import KINDS as KINDS
from haptic_fieldbus.sim.modbus.server import Server
from haptic_fieldbus.sim.realtime import LONGEST_REMEMBERED, NAP_NS, frozen
from haptic_fieldbus.sim.slot import Slot

PTY = "pty"
"""Channel of a serial bus that is no device: a pair of pseudo-terminals is made, and the other end told."""

PSEUDO_TERMINALS = "/dev/pts/"
WITHOUT_PARITY = (
    "{} is a pseudo-terminal, which has no parity: open it with parity N (none). With even or odd parity programs on "
    "pyserial fail with termios error 22 (Invalid argument), if not at the first opening then at the next"
)


def host(
    bus: BusName,
    slots: Sequence[Slot],
    seed: int,
    ready: Callable[[Slot], None],
    stopped: Callable[[], bool],
    tell: Callable[[str], None] = lambda _sentence: None,
    opened: Callable[[BusName], None] = lambda _bus: None,
) -> int:
    """Host drives until `stopped()` is True; return 0, since no answer is lost here.

    `opened` is called with the bus once it is open, which then has the port or the device that masters join, and
    `ready` for each drive. Raises BusError when the bus cannot be opened, and ValueError when two drives have the same
    unit id. Raises PlanError for drives that are not made for such a line.
    """
    line_of(modbus_section(bus.section), [modbus_profile(slot.profile) for slot in slots])
    asyncio.run(_host(bus, slots, seed, ready, stopped, tell, opened))
    return 0


async def _host(
    bus: BusName,
    slots: Sequence[Slot],
    seed: int,
    ready: Callable[[Slot], None],
    stopped: Callable[[], bool],
    tell: Callable[[str], None],
    opened: Callable[[BusName], None],
) -> None:
    section, clock = modbus_section(bus.section), MonotonicClock()
    errors = port_errors() if section.serial else (OSError,)
    server = Server(clock, seed, serial=section.serial, longest=LONGEST_REMEMBERED)
    for slot in slots:
        server.desk.rack.add(slot, clock.now_ns()).drive.plant.prepare()
    with device(section) as (own, theirs):
        try:
            joined = await listen(server, own, theirs, slots)
        except errors as error:
            raise translate(error, bus.text) from error
        try:
            name = protocol_named(section.protocol).bus_name(joined)
            opened(name)
            if joined.channel.startswith(PSEUDO_TERMINALS):
                tell(WITHOUT_PARITY.format(joined.channel))
            with frozen():
                for slot in slots:
                    ready(slot)
                while not stopped():
                    await asyncio.sleep(NAP_NS * 1e-9)
                    server.desk.rack.run(clock.now_ns())
        finally:
            await server.close()


async def listen(server: Server, own: ModbusSection, theirs: ModbusSection, slots: Sequence[Slot]) -> ModbusSection:
    """Let the server listen on its own end; return the end that masters join, with all that is known now."""
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
    """Yield the end of the line that the drives open, and the one that masters open."""
    if not section.serial or section.channel != PTY:
        yield section, section
        return
    with _cable() as (first, second):
        yield replace(section, channel=first), replace(section, channel=second)


@contextmanager
def _cable() -> Iterator[tuple[str, str]]:
    """Yield the names of two pseudo-terminals: what is written to the one is read from the other."""
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
    """Pass octets on; what the other end does not read is lost, as on a wire."""
    octets = os.read(source, 4096)
    try:
        os.write(target, octets)
    except BlockingIOError:
        return

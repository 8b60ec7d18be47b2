"""Names of Modbus buses, as users and rig files write them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, TypeVar

from annotated_types import Ge, Le

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.drive.fields import STRICT, Measured, NonNegativeTime
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.protocols.modbus import register_traffic
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, ModbusProfile, Parity
from haptic_fieldbus.protocols.modbus.register_traffic import Block, LineTimes, RegisterTraffic, Transaction, blocks
from haptic_fieldbus.protocols.protocol import BusName, Signals, bit_rate
from haptic_fieldbus.signals import Signal

TCP, RTU, SIM_TCP, SIM_RTU = INTERFACES = ("modbus-tcp", "modbus-rtu", "sim-modbus-tcp", "sim-modbus-rtu")
"""First words of bus names, and interfaces in rig files."""
BUS_FORMS = (
    "sim-modbus-tcp, sim-modbus-rtu[@BAUD], modbus-tcp:HOST[:PORT] or modbus-rtu:DEVICE[@BAUD], for example "
    "modbus-tcp:192.168.0.10, modbus-rtu:/dev/ttyUSB0@115200"
)
PORT = 502
"""TCP port of the standard."""
BAUDS = (1200, 20_000_000)
"""Lowest and highest bit rate of a serial line [bit/s]."""
UNITS = range(1, 248)
"""Unit ids of drives (Modbus over serial line 1.02, 2.2); 0 is everybody's."""
EVERYBODY, ITSELF = 0, 255
"""Unit ids of a request that all units obey and none answers, and of the device itself that a TCP connection leads to
(Modbus messaging on TCP/IP 1.0b, 4.4.2.1)."""
SIMULATION_CHANNEL = "sim"


@dataclass(frozen=True)
class ModbusSection(BusSection):
    """Modbus line of a rig: host and port, or a serial device."""

    baud: Annotated[int, Ge(BAUDS[0]), Le(BAUDS[1]), Measured(Quantity.BIT_RATE)] | None = None
    """Bit rate [bit/s]. None: the value after power-on in the profile of the first drive."""
    parity: Literal["none", "even", "odd"] | None = None
    """None: the value of the profile."""
    stop_bits: Literal[1, 2] | None = None
    """None: that of the profile."""
    silence: NonNegativeTime | None = None
    """Silence between two frames [s]. None: the value of the profile, otherwise that of the standard."""
    round_trip: NonNegativeTime | None = None
    """Round-trip time of a request and its answer through network or adapter and both ends [s]. None: 0.25 ms on TCP, 0
    on a serial line."""
    jitter: NonNegativeTime | None = None
    """Largest lateness of the host in a period [s]. None: 0 in the plan, and an assumed time in the limit of a
    real bus."""
    echo: bool = False
    """True: the adapter echoes sent octets, as some two-wire RS-485 adapters do."""
    protocol: ClassVar[str] = "modbus"
    __pydantic_config__: ClassVar[dict[str, object]] = STRICT

    @property
    def simulated(self) -> bool:
        return self.interface in (SIM_TCP, SIM_RTU)

    @property
    def serial(self) -> bool:
        """True on RTU, False on TCP."""
        return self.interface in (RTU, SIM_RTU)

    @property
    def lateness(self) -> float:
        return self.jitter or 0.0

    @property
    def route(self) -> str:
        return f"{self.wires}, round_trip {self.round_trip}"

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of a TCP bus, port 0 for a free one of a host of drives; raises UsageError for none."""
        host, colon, port = self.channel.rpartition(":")
        if not colon or (host.count(":") and not host.endswith("]")):  # an IPv6 address without a port
            return self.channel.strip("[]"), PORT
        if not port.isdecimal() or int(port) > 0xFFFF:
            raise UsageError(f'bus "{self.interface}:{self.channel}": expected a port after the host, 1 to 65535')
        return host.strip("[]"), int(port)

    def in_place_of_real(self) -> "ModbusSection":
        return StandInModbusSection(**vars(self))


@dataclass(frozen=True)
class StandInModbusSection(ModbusSection):
    """The simulated line in the place of a real one of a rig."""

    stands_for_real: ClassVar[bool] = True


def modbus_section(section: BusSection) -> ModbusSection:
    """Return the section as a Modbus line; raises TypeError when it is one of another protocol."""
    if not isinstance(section, ModbusSection):
        raise TypeError(f"{section.interface}:{section.channel} is not a Modbus line")
    return section


def parse_bus(text: str) -> BusName:
    """Parse the name of a Modbus bus; raises UsageError with the known forms."""
    interface, colon, rest = text.partition(":")
    if not colon:
        interface, _, _ = text.partition("@")
        rest = text[len(interface) :]
    if interface not in INTERFACES:
        raise UsageError(f'no bus "{text}". Buses are {BUS_FORMS}')
    simulated, serial = interface in (SIM_TCP, SIM_RTU), interface in (RTU, SIM_RTU)
    channel, at, digits = rest.rpartition("@") if serial and "@" in rest else (rest, "", "")
    if simulated and channel not in ("", SIMULATION_CHANNEL):
        raise UsageError(f'bus "{text}": a simulated bus has no channel; write {interface}')
    if not simulated and not channel:
        raise UsageError(f'bus "{text}" has no channel. Buses are {BUS_FORMS}')
    rate = bit_rate(digits) if at else None
    if at and (rate is None or not BAUDS[0] <= rate <= BAUDS[1]):
        raise UsageError(f'bus "{text}": expected the bit rate in bit/s after @, {BAUDS[0]} to {BAUDS[1]}')
    section = ModbusSection(interface, channel or SIMULATION_CHANNEL, rate)
    if interface == TCP:
        _ = section.address
    return BusName(text, section)


def wanted_unit(unit: int, *, serial: bool) -> str:
    """Return what the unit id of a drive must be on a line, in words; empty when `unit` is one."""
    if unit in UNITS or (unit == ITSELF and not serial):
        return ""
    all_obey = "; 0 is broadcast: all units follow it, and none answers" if unit == EVERYBODY else ""
    itself = "" if serial else f", or {ITSELF} for the device itself"
    return f"a whole number from {UNITS[0]} to {UNITS[-1]}{itself}{all_obey}"


def in_place_of(section: ModbusSection, named: BusName, channel: str | None) -> ModbusSection:
    """Return the `named` bus in the place of `section` of a rig; `channel`, unless None, replaces the named channel.

    Raises UsageError when the named bus is no Modbus line.
    """
    new, own = named.section, f"{section.interface}:{section.channel}"
    if not isinstance(new, ModbusSection):
        raise UsageError(f'bus "{named.text}" is not a Modbus line, but {own} of the rig is')
    found = replace(section, interface=new.interface, channel=channel or new.channel, baud=new.baud or section.baud)
    return found.in_place_of_real() if found.simulated and not section.simulated else found


# Line and registers of one axis: times of the line from rig and profile, and which registers share a request.


Value = TypeVar("Value")
FRAME_BITS = 9
"""Start bit and eight data bits of a character."""


def line_of(section: ModbusSection, profiles: Sequence[ModbusProfile]) -> LineTimes:
    """Return the times of the line on which these drives hang; what the rig leaves open is as after their power-on.

    Raises PlanError when a drive is not made for such a line, or the drives differ in what the rig leaves open.
    """
    transport = "rtu" if section.serial else "tcp"
    for profile in profiles:
        if transport not in profile.line.transports:
            has = " and ".join(profile.line.transports).upper()
            raise PlanError(f"{profile.title} supports Modbus {has}, but {section.interface} is {transport.upper()}")
    if not section.serial:
        return register_traffic.tcp_line(section.round_trip)
    baud, parity, stops = characters(section, profiles)
    bits = FRAME_BITS + int(parity != "none") + stops
    silences = [register_traffic.serial_line(baud, bits, each.line.silence).silence for each in profiles]
    silence = max(silences) if section.silence is None else section.silence
    return register_traffic.serial_line(baud, bits, silence, section.round_trip or 0.0)


def characters(section: ModbusSection, profiles: Sequence[ModbusProfile]) -> tuple[int, Parity, int]:
    """Return bit rate [bit/s], parity and number of stop bits of a serial line: those of the rig, else of the drives.

    Raises PlanError when the drives differ in what the rig leaves open.
    """
    baud, parity, stops = section.baud, section.parity, section.stop_bits
    return (
        _one("baud", (each.line.baud for each in profiles)) if baud is None else baud,
        _one("parity", (each.line.parity for each in profiles)) if parity is None else parity,
        _one("stop_bits", (each.line.stop_bits for each in profiles)) if stops is None else stops,
    )


def _one(key: str, values: Iterable[Value]) -> Value:
    """Return the value that all drives have; raises PlanError when they differ."""
    first, *others = dict.fromkeys(values)
    if others:
        found = ", ".join(str(each) for each in (first, *others))
        raise PlanError(f"the drives of one line have different {key} after power-on ({found}); set it in the rig")
    return first


def lay_out_registers(unit: int, profile: ModbusProfile, line: LineTimes, incoming: Signals) -> RegisterTraffic:
    """Return the blocks of one unit, the one with the motion first; raises ImageTooLargeError."""
    written = blocks(profile, (Signal.CONTROLWORD, Signal.TARGET_TORQUE), profile.line.longest_write, 0)
    set_point = next(block for block in written if block.has(Signal.TARGET_TORQUE))
    command = next((block for block in written if block is not set_point), None)
    reads, watching = _reads(profile, line, incoming), _watching(profile, line, incoming)
    ways = _unwatched(profile, watching or reads)
    register = profile.torque.target
    asked = replace(profile.mapped(Signal.TARGET_TORQUE, register), signal=Signal.TARGET_ASKED)
    is_asked = bool(ways) and profile.line.reading is not None
    target = Block(register.address, register.count, (asked,), (0,)) if is_asked else None
    return RegisterTraffic(unit, reads, set_point, command, watching=watching, read_back=target, read_back_ways=ways)


def _reads(profile: ModbusProfile, line: LineTimes, incoming: Signals) -> tuple[Block, ...]:
    reads = blocks(profile, incoming, profile.line.longest_read, largest_gap(profile, line))
    motion = Signal.POSITION if Signal.POSITION in incoming else Signal.VELOCITY
    return tuple(sorted(reads, key=lambda block: not block.has(motion)))


def _watching(profile: ModbusProfile, line: LineTimes, incoming: Signals) -> tuple[Block, ...]:
    """Return the blocks with torque actual added to the motion; none if it is there already or impossible."""
    if profile.echo is None or Signal.TORQUE_ACTUAL in incoming or profile.torque.actual is None:
        return ()
    watching = _reads(profile, line, (*incoming, Signal.TORQUE_ACTUAL))
    return watching if watching[0].has(Signal.TORQUE_ACTUAL) else ()


def _unwatched(profile: ModbusProfile, reads: tuple[Block, ...]) -> tuple[Transaction, ...]:
    """Return the ways by which no block that is read shows a set-point of another master.

    Where a request reads before another one writes, the echo shows it. Function 23 writes first: torque actual, read by
    the same request, still shows it, since it follows the set-point with the lag of the torque loop.
    """
    if profile.echo is None:
        return tuple(Transaction)
    return () if reads[0].has(Signal.TORQUE_ACTUAL) else (Transaction.READ_WRITE,)


def largest_gap(profile: ModbusProfile, line: LineTimes) -> int:
    """Return the largest gap that is quicker to read through than to skip by a second request [registers]."""
    if line.octet == 0.0:
        return profile.line.longest_read
    request = register_traffic.RegisterRequest(READ_HOLDING, Block(0, 0, (), ()))
    alone = line.exchange(request, profile.line.answer_time) + line.silence
    return math.floor(alone / (2 * line.octet))

"""Line and registers of one axis: times of the line from rig and profile, and which registers share a request."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.protocols.modbus import register_traffic
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, ModbusProfile, Parity
from haptic_fieldbus.protocols.modbus.register_traffic import Block, LineTimes, RegisterTraffic, Transaction, blocks
from haptic_fieldbus.protocols.protocol import Signals
from haptic_fieldbus.signals import Signal

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

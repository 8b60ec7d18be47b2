"""Line and registers of one axis: times of the line from rig and profile, and which registers share a request."""

import math
from collections.abc import Iterable, Sequence
from typing import TypeVar

from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.protocols.modbus.line import LineTimes, serial_line, tcp_line
from haptic_fieldbus.protocols.modbus.profile import READ_HOLDING, ModbusProfile, Parity
from haptic_fieldbus.protocols.modbus.register_traffic import RegisterTraffic
from haptic_fieldbus.protocols.modbus.requests import Block, RegisterRequest, blocks
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
            raise PlanError(f"{profile.title} speaks Modbus {has}, but {section.interface} is {transport.upper()}")
    if not section.serial:
        return tcp_line(section.round_trip)
    baud, parity, stops = characters(section, profiles)
    bits = FRAME_BITS + int(parity != "none") + stops
    own = [each.line.silence for each in profiles]
    silences = [serial_line(baud, bits, silence).silence for silence in own]
    silence = max(silences) if section.silence is None else section.silence
    return serial_line(baud, bits, silence, section.round_trip or 0.0)


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
        raise PlanError(f"the drives of one line differ in their {key} after power-on ({found}); give it in the rig")
    return first


def lay_out_registers(
    unit: int, profile: ModbusProfile, line: LineTimes, incoming: Sequence[Signal]
) -> RegisterTraffic:
    """Return the blocks of one unit, the one with the motion first; raises ImageTooLargeError."""
    section = profile.line
    reads = blocks(profile, incoming, section.longest_read, largest_gap(profile, line))
    motion = Signal.POSITION if Signal.POSITION in incoming else Signal.VELOCITY
    reads = tuple(sorted(reads, key=lambda block: not block.has(motion)))
    written = blocks(profile, (Signal.CONTROLWORD, Signal.TARGET_TORQUE), section.longest_write, 0)
    if len(written) == 1:
        return RegisterTraffic(unit, reads, written[0])
    set_point = next(block for block in written if block.has(Signal.TARGET_TORQUE))
    command = next(block for block in written if block is not set_point)
    return RegisterTraffic(unit, reads, set_point, command)


def largest_gap(profile: ModbusProfile, line: LineTimes) -> int:
    """Return the most registers that are read through sooner than a request of their own is exchanged."""
    if line.octet == 0.0:
        return profile.line.longest_read
    alone = line.exchange(RegisterRequest(READ_HOLDING, Block(0, 0, (), ())), profile.line.answer_time) + line.silence
    return math.floor(alone / (2 * line.octet))

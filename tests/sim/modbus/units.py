"""Simulated Modbus drives for tests: units of the generic profile and of profiles written here."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from struct import pack, unpack
from typing import Any

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, modbus_profile
from haptic_fieldbus.protocols.modbus.register_traffic import serial_line, tcp_line
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.modbus.drives import SimulatedUnits
from haptic_fieldbus.sim.modbus.line import SimulatedLine
from haptic_fieldbus.sim.modbus.registers import Refusal

GENERIC = modbus_profile(load_profile("generic_cia402_modbus"))
STATUS, DEMAND, POSITION, ACTUAL, ERROR, VELOCITY = 0x100, 0x101, 0x102, 0x104, 0x105, 0x106
COMMAND, TARGET, MODE, LIMIT, WATCHDOG = 0x200, 0x201, 0x202, 0x203, 0x204
RATED, MODE_SHOWN, SERIAL = 0x308, 0x30A, 0x306
"""Registers of the generic drive."""
MS = 1_000_000
NUMBER = 3


def slot(
    profile: ModbusProfile = GENERIC, *these: faults.Fault, number: int = NUMBER, hand: str = "none"
) -> DriveOnBus:
    """A drive on the shipped bench."""
    axis = default_axis(Workspace.LINEAR, bus="bus", node=number, profile=profile.name)
    return DriveOnBus(number, profile, axis, hand_named(hand), these)


class NoLine:
    """A line on which nothing of its own happens."""

    def __init__(self) -> None:
        self.happened: list[faults.AnswerFault | faults.HostFault] = []

    def inject(self, fault: faults.AnswerFault | faults.HostFault, number: int, t_ns: int) -> None:
        self.happened.append(fault)


class Driven:
    """One drive that is read and written at its own time."""

    def __init__(self, profile: ModbusProfile = GENERIC, *these: faults.Fault, hand: str = "none") -> None:
        self.line = NoLine()
        self.drives = SimulatedUnits(self.line.inject, seed=1)
        self.unit = self.drives.add(slot(profile, *these, hand=hand), 0)
        self.t_ns = 0

    def wait(self, milliseconds: float) -> None:
        self.t_ns += round(milliseconds * MS)
        self.drives.run(self.t_ns)

    def read(self, address: int, count: int = 1, function: int = 3) -> list[int] | Refusal:
        outcome = self.unit.read(function, address, count, self.t_ns)
        return outcome if isinstance(outcome, Refusal) else list(unpack(f">{count}H", outcome))

    def value(self, address: int) -> int:
        words = self.read(address)
        assert isinstance(words, list)
        return words[0]

    def write(self, address: int, *values: int) -> Refusal | None:
        return self.unit.write(address, pack(f">{len(values)}H", *values), self.t_ns)

    def state(self) -> State:
        return self.unit.drive.power.state

    def enable(self) -> None:
        """Enable the generic drive in cyclic torque mode."""
        self.write(MODE, 10)
        for word in (6, 7, 15):
            self.write(COMMAND, word)


def virtual_line(
    *these: faults.Fault, serial: bool = True, numbers: Sequence[int] = (NUMBER,), echo: bool = False
) -> tuple[SimulatedLine, VirtualClock]:
    """A line with generic drives, RTU of 115200 bit/s with 11 bits a character, or TCP."""
    clock = VirtualClock()
    wire = serial_line(115200, 11, None) if serial else tcp_line(None)
    line = SimulatedLine("line", wire, clock, seed=1, serial=serial, echo=echo)
    for number in numbers:
        line.add(slot(GENERIC, *these, number=number))
    return line, clock


def changed(profile: ModbusProfile = GENERIC, **values: Any) -> ModbusProfile:
    """The profile with other facts of its line."""
    return replace(profile, line=replace(profile.line, **values))


def signed(words: Iterable[int]) -> int:
    """The signed value of registers, the high one first."""
    return int.from_bytes(b"".join(word.to_bytes(2, "big") for word in words), "big", signed=True)

"""Creation of a simulated Modbus line with a master on it."""

from collections.abc import Sequence
from typing import Any

from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.protocols.modbus.bus import modbus_section
from haptic_fieldbus.protocols.modbus.layout import line_of
from haptic_fieldbus.protocols.modbus.profile import modbus_profile
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.modbus.line import SimulatedLine
from haptic_fieldbus.sim.modbus.rack import KINDS
from haptic_fieldbus.sim.simulation import Simulation
from haptic_fieldbus.sim.slot import Slot


class ModbusSimulation(Simulation):
    """The simulation of Modbus lines."""

    kinds = KINDS

    def simulate(
        self, section: BusSection, channel: str, slots: Sequence[Slot], clock: Clock, seed: int | str, log: Any
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

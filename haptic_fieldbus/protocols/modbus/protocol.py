"""Modbus behind the interface of `protocols.protocol`."""

from dataclasses import replace

from haptic_fieldbus.defaults import DEFAULT_MODBUS_DRIVE, DEFAULT_RATE, SIMULATION
from haptic_fieldbus.documents import Document
from haptic_fieldbus.drive.profile import DriveProfile, PowerTable
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.protocols.modbus import bus, profile
from haptic_fieldbus.protocols.modbus.bus import lay_out_registers, line_of
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, modbus_profile
from haptic_fieldbus.protocols.modbus.register_traffic import RegisterTraffic
from haptic_fieldbus.protocols.modbus.traffic import ModbusMember, ModbusTraffic, possible_ways
from haptic_fieldbus.protocols.protocol import BusName, FieldbusProtocol, Members, Signals, traffic_as
from haptic_fieldbus.protocols.traffic import HostTimes


class Modbus(FieldbusProtocol):
    """Modbus on TCP and RTU, the simulated lines included."""

    name = "modbus"
    profile: type[DriveProfile] = ModbusProfile
    section: type[BusSection] = bus.ModbusSection
    nodes = bus.UNITS
    default_drive = DEFAULT_MODBUS_DRIVE

    def wanted_node(self, node: int, interface: str) -> str:
        return bus.wanted_unit(node, serial=interface in (bus.RTU, bus.SIM_RTU))

    def simulated_bus(self, profile: DriveProfile) -> str:
        return bus.SIM_TCP if "tcp" in modbus_profile(profile).line.transports else bus.SIM_RTU

    def check_profile(self, document: Document) -> None:
        profile.check_profile(document)

    def parse_bus(self, text: str) -> BusName:
        return bus.parse_bus(text)

    def bus_name(self, section: BusSection) -> BusName:
        own = bus.modbus_section(section)
        channel = "" if own.simulated else f":{own.channel}"
        baud = f"@{own.baud}" if own.baud is not None else ""
        return BusName(f"{own.interface}{channel}{baud}", own)

    def in_place_of(self, section: BusSection, named: BusName, channel: str | None) -> BusSection:
        own = bus.modbus_section(section)
        if named.text == SIMULATION:  # the simulated line of the same kind
            line = bus.ModbusSection(bus.SIM_RTU if own.serial else bus.SIM_TCP, bus.SIMULATION_CHANNEL)
            named = BusName(SIMULATION, line)
        return bus.in_place_of(own, named, channel)

    def power_table(self, profile: DriveProfile) -> PowerTable:
        power = modbus_profile(profile).power
        return CIA402 if power.table == "cia402" else PowerTable(power.rows, power.off)

    def axis_traffic(
        self, axis: RigAxis, section: BusSection, profile: DriveProfile, incoming: Signals, outgoing: Signals
    ) -> RegisterTraffic:
        """Return the registers of one axis, without requests until the traffic of its line is known.

        Raises PlanError when the drive is not made for this line (ImageTooLargeError when it cannot carry a signal),
        UsageError for a profile of another protocol.
        """
        own = modbus_profile(profile)
        return lay_out_registers(axis.node, own, line_of(bus.modbus_section(section), [own]), incoming)

    def bus_traffic(self, section: BusSection, members: Members, rate: float, waiting: float) -> ModbusTraffic:
        return self.ways(section, members, rate, waiting)[0]

    def ways(
        self, section: BusSection, members: Members, rate: float | None, waiting: float
    ) -> tuple[ModbusTraffic, ...]:
        """Return the ways that fit, the one whose torque is the youngest first; when none fits, the fastest alone.

        Without a rate each has its own sustained one. Raises PlanError when there is no way.
        """
        own = tuple(
            ModbusMember(name, modbus_profile(profile), traffic_as(RegisterTraffic, "registers", traffic))
            for name, (profile, traffic) in members.items()
        )
        line = bus.modbus_section(section)
        # What the rig states of the way to the line is a part of its round trip.
        latency = None if line.round_trip is None else 0.0
        host = HostTimes(latency, line.jitter, line.simulated and not line.stands_for_real)
        wire = line_of(line, [member.profile for member in own])
        found = [ModbusTraffic(own, wire, way, DEFAULT_RATE, waiting, host) for way in possible_ways(own)]
        if not found:
            titles = ", ".join(dict.fromkeys(each.profile.title for each in own))
            fault = "the drives of the line share no function codes that read feedback and write set-points"
            raise PlanError(f"{titles}: {fault}; expected 23, or 3 with 16 or 6")
        at_rate = [replace(each, rate=each.sustained_rate if rate is None else rate) for each in found]
        fitting = [each for each in at_rate if each.fits] or [max(at_rate, key=lambda each: each.highest_rate)]
        return tuple(sorted(fitting, key=lambda each: each.age))


PROTOCOL = Modbus()

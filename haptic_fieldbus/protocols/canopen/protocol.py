"""CANopen as planning knows it."""

from collections.abc import Sequence
from pathlib import Path

from haptic_fieldbus.documents import Document
from haptic_fieldbus.drive.power import PowerTable
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.protocols.bus_name import BusName
from haptic_fieldbus.protocols.canopen import bus, checks
from haptic_fieldbus.protocols.canopen.pdo import SYNCHRONOUS_TYPES, Direction, lay_out
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.canopen.traffic import BusMember, CanTraffic, PdoTraffic
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.protocols.protocol import FieldbusProtocol, Members
from haptic_fieldbus.protocols.traffic import AxisTraffic
from haptic_fieldbus.signals import Signal


class Canopen(FieldbusProtocol):
    """CANopen on any python-can interface, and the simulated one."""

    name = "canopen"
    profile: type[DriveProfile] = CanopenProfile
    section: type[BusSection] = bus.CanSection
    nodes = bus.NODES
    bus_forms = bus.BUS_FORMS

    def vendor_profile(self, path: str | Path) -> DriveProfile:
        """Out of an EDS or DCF."""
        from haptic_fieldbus.eds import load_eds
        from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds

        return profile_from_eds(load_eds(path))

    def check_profile(self, document: Document) -> None:
        checks.check_profile(document)

    def parse_bus(self, text: str) -> BusName:
        return bus.parse_bus(text)

    def bus_name(self, section: BusSection) -> BusName:
        own = bus.can_section(section)
        return bus.parse_bus(f"{own.interface}:{own.channel}@{own.bitrate}")

    def in_place_of(self, section: BusSection, named: BusName, channel: str | None) -> BusSection:
        return bus.in_place_of(bus.can_section(section), named, channel)

    def power_table(self, profile: DriveProfile) -> PowerTable:
        return CIA402

    def axis_traffic(
        self, axis: RigAxis, profile: DriveProfile, incoming: Sequence[Signal], outgoing: Sequence[Signal]
    ) -> PdoTraffic:
        """Type 1 answers every SYNC; an event-driven RPDO acts on reception, where the drive has one."""
        own = canopen_profile(profile)
        pdo, entries = own.pdo, own.entries()
        if 1 not in pdo.tpdo_types:
            raise PlanError(f"no TPDO transmission type of {pdo.tpdo_types} answers every SYNC; 1 is needed")
        event_driven = [kind for kind in pdo.rpdo_types if kind not in SYNCHRONOUS_TYPES]
        rpdo_type = max(event_driven) if event_driven else min(pdo.rpdo_types)
        return PdoTraffic(
            axis.node,
            lay_out(Direction.TPDO, entries, incoming, node=axis.node, transmission_type=1, pdos=pdo.tpdos,
                    entries=pdo.entries),
            lay_out(Direction.RPDO, entries, outgoing, node=axis.node, transmission_type=rpdo_type, pdos=pdo.rpdos,
                    entries=pdo.entries),
        )  # fmt: skip

    def bus_traffic(self, section: BusSection, members: Members, rate: float, waiting: float) -> CanTraffic:
        own = tuple(
            BusMember(name, canopen_profile(profile), _pdos(traffic)) for name, (profile, traffic) in members.items()
        )
        return CanTraffic(own, bus.can_section(section).bitrate, rate, waiting)


def _pdos(traffic: AxisTraffic) -> PdoTraffic:
    """What CANopen made itself; TypeError for another protocol's."""
    if not isinstance(traffic, PdoTraffic):
        raise TypeError(f"expected PDOs, not {type(traffic).__name__}")
    return traffic


PROTOCOL = Canopen()

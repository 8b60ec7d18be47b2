"""CANopen behind the interface of `protocols.protocol`."""

from dataclasses import replace
from pathlib import Path

from haptic_fieldbus.documents import Document
from haptic_fieldbus.drive.profile import DriveProfile, PowerTable
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.protocols.canopen import bus, profile
from haptic_fieldbus.protocols.canopen.pdo import SYNCHRONOUS_TYPES, Direction, lay_out
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.canopen.traffic import CanMember, CanTraffic, PdoTraffic, asked_signals
from haptic_fieldbus.protocols.canopen.watch_traffic import period_objects
from haptic_fieldbus.protocols.cia402 import with_mode_bits
from haptic_fieldbus.protocols.protocol import BusName, FieldbusProtocol, Members, Signals, traffic_as
from haptic_fieldbus.protocols.traffic import HostTimes
from haptic_fieldbus.signals import Signal


class Canopen(FieldbusProtocol):
    """CANopen on any interface of python-can, the simulated one included."""

    name = "canopen"
    profile: type[DriveProfile] = CanopenProfile
    section: type[BusSection] = bus.CanSection
    nodes = bus.NODES
    fits_profiles = True

    def vendor_profile(self, path: str | Path) -> DriveProfile:
        """Return the profile described by an EDS or DCF; raises EdsError."""
        # Imported here, because a run with a shipped profile needs no EDS reader.
        from haptic_fieldbus.eds import load_eds
        from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds

        return profile_from_eds(load_eds(path))

    def check_profile(self, document: Document) -> None:
        profile.check_profile(document)

    def parse_bus(self, text: str) -> BusName:
        return bus.parse_bus(text)

    def bus_name(self, section: BusSection) -> BusName:
        # Parsed anew, so that a bus of a rig obeys the same rules as one that is named.
        own = bus.can_section(section)
        return replace(bus.parse_bus(f"{own.interface}:{own.channel}@{own.bitrate}"), section=own)

    def in_place_of(self, section: BusSection, named: BusName, channel: str | None) -> BusSection:
        return bus.in_place_of(bus.can_section(section), named, channel)

    def power_table(self, profile: DriveProfile) -> PowerTable:
        return with_mode_bits(canopen_profile(profile).torque.controlword)

    def axis_traffic(
        self, axis: RigAxis, section: BusSection, profile: DriveProfile, incoming: Signals, outgoing: Signals
    ) -> PdoTraffic:
        """Return the PDOs of one axis, which are the same on every CAN bus.

        Raises ImageTooLargeError when they do not fit into the drive's PDOs, PlanError when no TPDO can answer every
        SYNC, UsageError for a profile of another protocol.
        """
        own = canopen_profile(profile)
        pdo, entries = own.pdo, own.entries()
        mapped = [signal for signal in incoming if signal is not Signal.TARGET_ASKED]
        if 1 not in pdo.tpdo_types:
            raise PlanError(f"no TPDO transmission type of {pdo.tpdo_types} answers every SYNC; 1 is needed")
        # An event-driven RPDO may act on reception; a synchronous one waits for the next SYNC, a whole period.
        event_driven = [kind for kind in pdo.rpdo_types if kind not in SYNCHRONOUS_TYPES]
        rpdo_type = max(event_driven) if event_driven else min(pdo.rpdo_types)
        return PdoTraffic(
            axis.node,
            lay_out(Direction.TPDO, entries, mapped, node=axis.node, transmission_type=1,
                    room=pdo.room(Direction.TPDO), fixed=pdo.tpdo_fixed),
            lay_out(Direction.RPDO, entries, outgoing, node=axis.node, transmission_type=rpdo_type,
                    room=pdo.room(Direction.RPDO), fixed=pdo.rpdo_fixed),
            asked=asked_signals(own) if len(mapped) < len(incoming) else (),
            life_guarding=own.link_loss.life_guarding,
        )  # fmt: skip

    def bus_traffic(self, section: BusSection, members: Members, rate: float, waiting: float) -> CanTraffic:
        own = tuple(
            CanMember(name, canopen_profile(profile), traffic_as(PdoTraffic, "PDOs", traffic))
            for name, (profile, traffic) in members.items()
        )
        for member in own:
            period_objects(member.profile, rate)  # refuses a period that the drive cannot take
        line = bus.can_section(section)
        if any(member.traffic.node == line.master_node for member in own):
            raise PlanError(f"master_node {line.master_node} of the bus is the node-ID of one of its drives")
        host = HostTimes(line.adapter_latency, line.jitter, line.simulated and not line.stands_for_real)
        return CanTraffic(
            own, line.bitrate, rate, waiting, listening=line.listen, chosen_master_node=line.master_node, host=host
        )


PROTOCOL = Canopen()

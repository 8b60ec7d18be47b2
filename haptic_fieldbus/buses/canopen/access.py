"""Opening CANopen buses on any python-can interface."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

from haptic_fieldbus.buses.access import BusAccess
from haptic_fieldbus.buses.canopen.adapter import adapter_checks
from haptic_fieldbus.buses.canopen.foreign import OneMaster
from haptic_fieldbus.buses.canopen.frames import FrameLog, frame_logs
from haptic_fieldbus.buses.canopen.listening import listen
from haptic_fieldbus.buses.canopen.looking import Looking
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.buses.canopen.opening import open_can
from haptic_fieldbus.buses.canopen.round_trip import QUESTIONS, round_trip_checks, round_trips
from haptic_fieldbus.buses.canopen.scanning import scan_bus
from haptic_fieldbus.buses.canopen.setup import NO_ANSWER_ADVICE
from haptic_fieldbus.buses.canopen.wire import ECHOING, Wire
from haptic_fieldbus.buses.found import Check, Scan
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.drive.profile import STANDARD, DriveProfile
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.drive.units import RATED_TORQUE_UNITS
from haptic_fieldbus.errors import BusError, BusTimeoutError, DocumentError, UsageError
from haptic_fieldbus.protocols.canopen.bus import NODES, CanSection, can_section
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.canopen.traffic import MASTER_NODES
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.folders import known_names


class CanopenAccess(BusAccess):
    """The I/O half of CANopen; its buses are opened by python-can, its logs take CAN frames."""

    def logs(
        self, record: Path | None, buses: Sequence[str], *, simulated: bool
    ) -> AbstractContextManager[Mapping[str, FrameLog]]:
        return frame_logs(record, buses, simulated=simulated)

    def open_bus(self, section: BusSection, clock: Clock, log: FrameLog | None) -> CanopenBus:
        return CanopenBus(open_can(can_section(section)), clock, log, owned=True, echoes=section.interface in ECHOING)

    def rated_torque(self, section: BusSection, name: str, axis: RigAxis) -> float | None:
        profile = load_profile(axis.profile)
        if not isinstance(profile, CanopenProfile) or profile.torque.rated is None:
            return None
        mapped = profile.torque.rated
        with _asked(can_section(section), {name: (axis, profile)}) as nodes:
            raw = nodes[name].optional(mapped.entry)
        return None if raw is None else raw * RATED_TORQUE_UNITS[mapped.unit]

    def fitted(self, section: BusSection, axes: Mapping[str, RigAxis]) -> Mapping[str, DriveProfile]:
        loaded = {name: (axis, canopen_profile(load_profile(axis.profile))) for name, axis in axes.items()}
        general = {name: each for name, each in loaded.items() if each[1].drive.evidence == STANDARD}
        if not general:
            return {}
        # Imported here, because a run with the profile of a drive needs no reader of object dictionaries.
        from haptic_fieldbus.buses.canopen.fitting import fit_to_drive

        with _asked(can_section(section), general) as nodes:
            return {name: fit_to_drive(profile, nodes[name]) for name, (_, profile) in general.items()}

    def scan(
        self, section: BusSection, axes: Mapping[str, RigAxis], profiles: str | Path | None, nodes: Sequence[int] = ()
    ) -> Scan:
        own = can_section(section)
        with opened(own, axes) as wire:
            return scan_bus(wire, own.listen, own.bitrate, _canopen_profiles(profiles), nodes or NODES)

    @contextmanager
    def onlooker(self, section: BusSection, axes: Mapping[str, RigAxis]) -> Iterator[Looking]:
        own = can_section(section)
        drives = {name: (axis.node, canopen_profile(load_profile(axis.profile))) for name, axis in axes.items()}
        with opened(own, axes) as wire:
            yield Looking(wire, drives, own.listen, own.master_node or MASTER_NODES[0])

    def checks(self, section: BusSection, axes: Mapping[str, RigAxis], rate: float) -> tuple[Check, ...]:
        own = can_section(section)
        told = tuple(adapter_checks(own))
        try:
            with opened(own, axes) as wire:
                return Check("adapter", True, f"{wire.name} is open"), *told, *_on_the_bus(wire, own, axes, rate)
        except BusError as error:
            return Check("adapter", False, str(error), "see the other checks of the adapter"), *told


@contextmanager
def opened(section: CanSection, axes: Mapping[str, RigAxis]) -> Iterator[Wire]:
    """Open a bus for as long as the block lasts; a simulated one has the drives of these axes, in real time.

    Raises UsageError or BusError.
    """
    name = f"{section.interface}:{section.channel}"
    if section.simulated:
        section = replace(section, channel=",".join(f"{axis.profile}@{axis.node}" for axis in axes.values()))
    can_bus = open_can(section)
    # A multicast bus that cannot be kept apart from others says so in its name.
    name = can_bus.channel_info if section.interface in ECHOING else name
    try:
        yield Wire(can_bus, MonotonicClock(), name, echoes=section.interface in ECHOING)
    finally:
        can_bus.shutdown()


@contextmanager
def _asked(section: CanSection, drives: Mapping[str, tuple[RigAxis, CanopenProfile]]) -> Iterator[dict[str, Node]]:
    """Open a bus to ask drives by SDO before a plan is made, once it is heard that nobody else commands.

    Raises UsageError, BusError or ForeignMasterError.
    """
    can_bus = open_can(section)
    try:
        wire = Wire(can_bus, MonotonicClock(), can_bus.channel_info, echoes=section.interface in ECHOING)
        guarded = [axis.node for axis, profile in drives.values() if profile.link_loss.life_guarding]
        one = OneMaster([axis.node for axis, _ in drives.values()], section.master_node or MASTER_NODES[0], guarded)
        listen(wire, section.listen, one, wire.name).refuse(one.master_node)
        yield {name: Node(wire, axis.node, f"node {axis.node} (axis {name})") for name, (axis, _) in drives.items()}
    except BusTimeoutError as error:
        raise BusTimeoutError(f"{error}. {NO_ANSWER_ADVICE}") from error
    finally:
        can_bus.shutdown()


def _on_the_bus(wire: Wire, section: CanSection, axes: Mapping[str, RigAxis], rate: float) -> tuple[Check, ...]:
    """Check that nobody else commands, and only then ask a drive for the round trip; raises BusError."""
    nodes = [axis.node for axis in axes.values()]
    master_node = section.master_node or MASTER_NODES[0]
    heard = listen(wire, section.listen, OneMaster(nodes, master_node), wire.name)
    heard.refuse_noise()
    if heard.masters:
        advice = "end the other master; while it is there nothing is asked, and the round trip is not measured"
        return Check("other_masters", False, heard.sentence(), advice), Check("round_trip", None, "not measured")
    alone = Check("other_masters", True, "none heard")
    node = nodes[0]
    return alone, *round_trip_checks(node, round_trips(wire, node), QUESTIONS, rate)


def _canopen_profiles(profiles: str | Path | None) -> list[CanopenProfile]:
    """Return all profiles of CANopen drives that can be read."""
    found = []
    for name in known_names(profiles):
        try:
            profile = load_profile(name, profiles)
        except (DocumentError, UsageError):
            continue  # `profiles list` tells what is wrong with it
        if isinstance(profile, CanopenProfile):
            found.append(profile)
    return found


ACCESS = CanopenAccess()

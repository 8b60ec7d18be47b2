"""Opening CANopen buses on any python-can interface."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from haptic_fieldbus.buses.access import BusAccess
from haptic_fieldbus.buses.canopen.foreign import OneMaster
from haptic_fieldbus.buses.canopen.frames import FrameLog, frame_logs
from haptic_fieldbus.buses.canopen.listening import listen
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.buses.canopen.opening import open_can
from haptic_fieldbus.buses.canopen.setup import NO_ANSWER_ADVICE
from haptic_fieldbus.buses.canopen.wire import ECHOING, Wire
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.drive.rig import BusSection, RigAxis
from haptic_fieldbus.drive.units import RATED_TORQUE_UNITS
from haptic_fieldbus.errors import BusTimeoutError
from haptic_fieldbus.protocols.canopen.bus import can_section
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.protocols.canopen.traffic import MASTER_NODES
from haptic_fieldbus.protocols.catalogue import load_profile


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
        own = can_section(section)
        can_bus = open_can(own)
        try:
            wire = Wire(can_bus, MonotonicClock(), can_bus.channel_info, echoes=own.interface in ECHOING)
            guarded = [axis.node] if profile.link_loss.life_guarding else []
            one = OneMaster([axis.node], own.master_node or MASTER_NODES[0], guarded)
            listen(wire, own.listen, one, wire.name).refuse(one.master_node)
            raw = Node(wire, axis.node, f"node {axis.node} (axis {name})").read(mapped.entry)
        except BusTimeoutError as error:
            raise BusTimeoutError(f"{error}. {NO_ANSWER_ADVICE}") from error
        finally:
            can_bus.shutdown()
        return raw * RATED_TORQUE_UNITS[mapped.unit]


ACCESS = CanopenAccess()

"""Creation of a simulated CAN bus with a master on it."""

from collections.abc import Sequence

from haptic_fieldbus.buses.canopen.frames import CAN_ID_MASK, ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, FrameLog
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.wire import OURS, PythonCanPort, Received
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.protocols.canopen.bus import can_section
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.drives import KINDS
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import ClockStep
from haptic_fieldbus.sim.simulation import HostClock, Simulation, truth_of


class WorldPort(PythonCanPort):
    """The port of a master to a simulated wire: the same frames as through python-can, without its messages."""

    def __init__(self, bus: SimulatedBus) -> None:
        super().__init__(bus)
        self._send, self._receive, self._controller = bus.pace.send, bus.pace.receive, bus.controller

    def send(self, can_id: int, data: bytes | bytearray) -> None:
        if can_id <= CAN_ID_MASK:  # no flag
            frame = Frame(can_id, bytes(data))
        else:
            extended, remote = bool(can_id & EXTENDED_FLAG), bool(can_id & REMOTE_FLAG)
            frame = Frame(can_id & CAN_ID_MASK, bytes(len(data)) if remote else bytes(data), extended, remote)
        self._send(self._controller, frame, None)

    def receive(self, seconds: float) -> Received | None:
        if (received := self._receive(self._controller, seconds, None)) is None:
            return None
        _, (can_id, data, extended, remote), own, error = received
        if own:
            return OURS
        if extended or remote or error:
            can_id |= EXTENDED_FLAG * extended | REMOTE_FLAG * remote | ERROR_FLAG * error
        return can_id, data


class CanSimulation(Simulation):
    """The simulation of CAN buses."""

    kinds = KINDS

    def simulate(
        self,
        section: BusSection,
        channel: str,
        slots: Sequence[DriveOnBus],
        clock: Clock,
        seed: int | str,
        log: FrameLog | None,
    ) -> tuple[CanopenBus, World | None]:
        own = can_section(section)
        world = World(truth_of(clock), own.bitrate, seed)
        world.adapter_ns = round((own.adapter_latency or 0.0) * 1e9)
        world.host = clock if isinstance(clock, HostClock) else None
        # A clock that steps is no clock of the true motion: what the shaft did at its instants is not known.
        apart = any(isinstance(fault, ClockStep) for slot in slots for fault in slot.faults)
        for slot in slots:
            world.add(slot)
        bus = SimulatedBus(channel, world=world)
        return CanopenBus(bus, clock, log, owned=True, port=WorldPort(bus)), (None if apart else world)


SIMULATION = CanSimulation()

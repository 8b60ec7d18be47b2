"""Creation of a simulated CAN bus with a master on it."""

from collections.abc import Sequence

from haptic_fieldbus.buses.canopen.frames import FrameLog
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.protocols.canopen.bus import can_section
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.drives import KINDS
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import ClockStep
from haptic_fieldbus.sim.host import HostClock, truth_of
from haptic_fieldbus.sim.simulation import Simulation


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
        return CanopenBus(SimulatedBus(channel, world=world), clock, log, owned=True), (None if apart else world)


SIMULATION = CanSimulation()

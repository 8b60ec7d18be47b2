"""The interface to simulated buses with their drives, for a run in virtual time."""

from collections.abc import Sequence
from typing import Any, Protocol

from haptic_fieldbus.assessing.recording import Truth
from haptic_fieldbus.buses.bus import StepwiseBus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import HandFault, HostFault, kinds_of


class Simulation(Protocol):
    """The part of a protocol that simulates its buses and drives."""

    @property
    def kinds(self) -> frozenset[str]:
        """Kinds of faults that its buses and drives may have; by default the kinds that need neither bus nor link."""
        return kinds_of(HostFault) | kinds_of(HandFault)

    def simulate(
        self, section: BusSection, channel: str, slots: Sequence[DriveOnBus], clock: Clock, seed: int | str, log: Any
    ) -> tuple[StepwiseBus, Truth | None]:
        """Return a bus with these drives, and their true motion, None where it is not known.

        `channel` is the name of the bus in messages.
        """

"""Simulated buses with their drives, for a run in virtual time."""

from collections.abc import Sequence
from typing import Any, Protocol

from haptic_fieldbus.assessing.recording import Truth
from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.sim.slot import Slot


class Simulation(Protocol):
    """The half of a protocol that simulates its buses and drives."""

    def simulate(
        self, section: BusSection, channel: str, slots: Sequence[Slot], clock: Clock, seed: int | str, log: Any
    ) -> tuple[Bus, Truth | None]:
        """A bus with these drives, and their true motion where it is known; `channel` is what messages call it."""

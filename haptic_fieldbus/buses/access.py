"""How the buses of one protocol are opened, and what is asked of a drive before a plan is made."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, Protocol

from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection, RigAxis


class BusAccess(Protocol):
    """The half of a protocol that does I/O; a log is its own kind of value, passed on unseen."""

    def logs(self, record: Path | None, buses: Sequence[str]) -> AbstractContextManager[Mapping[str, Any]]:
        """What takes down the traffic of each of these buses; nothing where the file holds something else."""
        return nullcontext({})

    def open_bus(self, section: BusSection, clock: Clock, log: Any) -> Bus:
        """A real bus; raises UsageError or BusError."""

    def rated_torque(self, section: BusSection, name: str, axis: RigAxis) -> float | None:
        """What the drive itself says [N·m]; None where it has no such object. Raises BusError."""
        return None

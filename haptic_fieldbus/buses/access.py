"""Opening the buses of one protocol, and the questions to a drive that come before a plan."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, Protocol

from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection, RigAxis


class BusAccess(Protocol):
    """The half of a protocol that does I/O.

    Each protocol has its own type of traffic log. Callers only pass a log from `logs` to `open_bus`.
    """

    def logs(
        self, record: Path | None, buses: Sequence[str], *, simulated: bool
    ) -> AbstractContextManager[Mapping[str, Any]]:
        """Open a traffic log for each named bus; an empty mapping when `record` is not a file of traffic.

        Unless the buses are `simulated`, the log must not make the loop wait.
        """
        return nullcontext({})

    def open_bus(self, section: BusSection, clock: Clock, log: Any) -> Bus:
        """Open a real bus; raises UsageError for impossible settings, BusError when it cannot be opened."""

    def rated_torque(self, section: BusSection, name: str, axis: RigAxis) -> float | None:
        """Read the rated torque from the drive [N·m]; None when its profile names no object for it.

        Raises UsageError or BusError, as `open_bus` does, and BusError when the drive does not answer.
        """
        return None

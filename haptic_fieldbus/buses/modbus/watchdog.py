"""The drive's own watch on its master: armed when the exchange begins, and put back when a drive has been freed.

It is armed last, so that it does not run out while other drives are configured. Set-points feed it; questions do not.
"""

from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.modbus.profile import Register, WatchdogSection

STEPS_PER_SECOND = {"ms": 1e3, "s": 1.0}
"""Unit of the register → steps in a second."""


class DriveWatch:
    """The watch of one drive, set to `seconds`."""

    def __init__(self, unit: UnitClient, section: WatchdogSection, seconds: float) -> None:
        self._unit, self._section = unit, section
        if section.time.unit not in STEPS_PER_SECOND:
            wrong = f"unit {section.time.unit!r} of {section.time} is not one of {', '.join(STEPS_PER_SECOND)}"
            raise BusConfigurationError(f"{unit.label}: {wrong}")
        self._steps = round(seconds * STEPS_PER_SECOND[section.time.unit])
        self._before: int | None = None
        self.words = f"on link loss {section.reaction} within {round(1e3 * seconds)} ms"

    def prepare(self) -> None:
        """Choose the reaction, and note the time of before; raises BusError."""
        for each in self._section.writes:
            self._unit.ensure(each, each.value)
        self._before = self._unit.read(self._section.time)

    def arm(self) -> None:
        """Set the time, and read it back; raises BusError, BusConfigurationError when the drive has another."""
        self._unit.write(self._section.time, self._steps)

    @property
    def disarming(self) -> tuple[tuple[Register, int], ...]:
        """Registers and values that put back what was there before."""
        return () if self._before is None else ((self._section.time, self._before),)

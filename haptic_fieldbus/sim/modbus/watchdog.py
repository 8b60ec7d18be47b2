"""The drive's watch on its master: a time within which a target torque must be written.

Theory: the time counts from each request that writes the target, from *operation enabled*, and from the writing of the
time itself. A time of 0 switches the watch off. When it is over the drive reacts once, as to a lost link (CiA 402-2,
6007h), and waits for the next of these.
"""

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.drive.dictionary import Entry

UNITS = {"ms": 1_000_000, "s": 1_000_000_000}
"""Units of the time → ns."""


class Watchdog:
    """One watch; times [ns]."""

    def __init__(self, time: Entry, unit: str) -> None:
        self.time = time
        self.due_ns = NEVER_NS
        self.factor: float | None = 1.0
        """How many times as late as it was set the watch acts; None: never."""
        self._unit_ns = UNITS[unit]

    def restart(self, t_ns: int) -> None:
        """Count from this instant on."""
        on = self.time.value and self.factor is not None
        self.due_ns = t_ns + round(self.time.value * self._unit_ns * (self.factor or 0.0)) if on else NEVER_NS

    def expired(self, t_ns: int) -> bool:
        """Return whether the time is over, once."""
        if self.due_ns > t_ns:
            return False
        self.due_ns = NEVER_NS
        return True

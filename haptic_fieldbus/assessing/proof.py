"""Proof of the guard of one drive, which was left alone at zero torque."""

from dataclasses import dataclass

from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.protocols.traffic import Json


@dataclass(frozen=True)
class Proof:
    """What came of leaving a drive alone; times in s."""

    axis: str
    guard: float
    """Time for which the guard of the drive is set."""
    earliest: float
    """Time from which on it may be its guard that acts; what is off sooner was switched off by something else."""
    allowed: float
    """Time within which it must be seen off."""
    enabled: float
    """Time from our last write at which the drive was still seen in *operation enabled*."""
    off: float | None
    """Time from our last write at which it was first seen in another state; None: it never was."""
    between: float
    """Longest time between two looks at it when this computer is not late."""

    @property
    def holds(self) -> bool:
        """True when the drive was seen off in time, and not before its guard can act."""
        return self.off is not None and self.earliest <= self.off <= self.allowed

    @property
    def early(self) -> bool:
        """True when the drive was off before its guard can act, which says nothing about the guard."""
        return self.off is not None and self.off < self.earliest

    @property
    def missed(self) -> bool:
        """True when this computer was late, and nobody looked at the time that matters."""
        off = self.off
        return off is not None and self.enabled <= self.allowed < off and off - self.enabled > self.between

    def __str__(self) -> str:
        """Return the outcome in words."""
        asked = f"asked for were {exactly(1e3 * self.guard)} ms"
        if self.off is None:
            seen = rounded(1e3 * self.enabled)
            return f"axis {self.axis} did not let go in {seen} ms when it was left alone at zero torque; {asked}"
        return f"axis {self.axis} let go {rounded(1e3 * self.off)} ms after it was left alone at zero torque; {asked}"

    def to_json(self) -> Json:
        """Return the object of `run --json`; None for the time of a drive that never let go."""
        measured = None if self.off is None else 1e3 * self.off
        return {"axis": self.axis, "guard_ms": 1e3 * self.guard, "measured_ms": measured}

"""How quiet the machine was while times were taken: its load, the share of a processor, and the spread of costs."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.study.measure.timing import Cost

LOADED, INTERRUPTED, SCATTERED = 0.7, 0.97, 0.1
"""Load of a core from which, share of a processor up to which, and spread of costs from which a machine is busy."""


def load_average() -> float | None:
    """Return the number of programs that wanted a processor in the last minute; None where the system has none."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None


@dataclass(frozen=True)
class Quiet:
    """What disturbs times of a machine."""

    load: float | None
    """Load average before the first measurement; None where the system has none."""
    cores: int
    running: float
    """Share of the time of all timed calls in which they had a processor."""
    spread: float
    """Median over the timed calls of the distance of their outer quartiles, as a share of their median."""

    @classmethod
    def of(cls, load: float | None, costs: Sequence[Cost]) -> "Quiet":
        """Return how quiet it was at this load while these costs, one or more, were taken."""
        running = sum(cost.ran_ns for cost in costs) / sum(cost.lasted_ns for cost in costs)
        return cls(load, os.cpu_count() or 1, min(running, 1.0), median(cost.spread for cost in costs))

    @property
    def busy(self) -> bool:
        """True when costs are not those of the machine alone."""
        loaded = self.load is not None and self.load > LOADED * self.cores
        return loaded or self.running < INTERRUPTED or self.spread > SCATTERED

    def words(self) -> str:
        """Return the three figures as words."""
        loaded = "" if self.load is None else f"load {rounded(self.load, 2)} on {self.cores} cores, "
        return f"{loaded}{percent(self.running)} of a processor, half of the repeats within {percent(self.spread)}"

    def warning(self) -> str:
        """Return a warning and what to do; empty on a quiet machine."""
        if not self.busy:
            return ""
        return (
            f"This machine was busy ({self.words()}): costs are too high, errors and stability as they are. Report "
            "again when nothing else runs."
        )

"""What the loop notes of a run while it goes: counts, instants, times of each period."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.record import Record

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.planning.live_changes import Applied

SAMPLES = ("period_ns", "age_ns", "compute_ns")


@dataclass
class LoopReport:
    """What a run was; filled while it runs, so that it can be read after a trip too."""

    cycles: int = 0
    """Periods in operation enabled."""
    missed: int = 0
    """Periods that were slept through."""
    first_ns: int | None = None
    enabled_at_ns: int | None = None
    last_ns: int | None = None
    """Latch instants of the first period, of the first in operation enabled, and of the last."""
    period_ns: int = 0
    interrupted: bool = False
    released: bool = False
    """Did every drive confirm at the end that its motor is off?"""
    changes: "list[Applied]" = field(default_factory=list)
    samples: Record = field(default_factory=lambda: Record(SAMPLES, 1), repr=False)
    """Of the periods in operation enabled; the host's computing time is reported and never acts."""

    def sample(self, name: str) -> NDArray[np.float64]:
        """`period_ns`, `age_ns` (of the oldest feedback when it was used) or `compute_ns`; shape (periods,)."""
        return self.samples.column(name)

    @property
    def duration(self) -> float:
        """[s]; from operation enabled to the end of the last period."""
        if self.enabled_at_ns is None or self.last_ns is None:
            return 0.0
        return (self.last_ns + self.period_ns - self.enabled_at_ns) * 1e-9

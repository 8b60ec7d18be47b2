"""Notes that the loop takes during a run: counts, instants, and four times of each period."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.assessing.record import Record

if TYPE_CHECKING:  # imported for its type alone: a run without changes never loads `tuning`
    from haptic_fieldbus.planning.live_changes import Applied

SAMPLES = ("period_ns", "age_ns", "compute_ns", "lateness_ns")

LATE_SHARE = 0.1
"""Share of the period by which a period may begin late before it counts as late."""


@dataclass
class LoopReport:
    """Counts and times of one run; the loop fills it period by period, so it is complete up to a trip too."""

    cycles: int = 0
    """Number of periods in operation enabled."""
    missed: int = 0
    """Number of periods skipped from operation enabled on, because the loop woke up too late for them."""
    late: int = 0
    """Number of periods in operation enabled that began late by more than a tenth of the period."""
    first_ns: int | None = None
    """Latch instant of the first period."""
    enabled_at_ns: int | None = None
    """Latch instant of the first period in operation enabled; None when that state was never reached."""
    last_ns: int | None = None
    """Latch instant of the last period."""
    period_ns: int = 0
    interrupted: bool = False
    """True when Ctrl-C, SIGTERM or SIGHUP ended the run."""
    released: bool = False
    """True when every drive confirmed at the end that its motor is off."""
    foreign_load: Mapping[str, float] = field(default_factory=dict)
    """By axis, the share of its bus that frames of other devices took."""
    changes: "list[Applied]" = field(default_factory=list)
    # A capacity of 1 is a placeholder: the loop replaces this record once it knows the number of periods.
    samples: Record = field(default_factory=lambda: Record(SAMPLES, 1), repr=False)
    """One row of `SAMPLES` for each period in operation enabled; of a very long run, for the last ones."""

    def count(self, latch_ns: int, length_ns: int, age_ns: int, compute_ns: int, lateness_ns: int) -> int:
        """Take down one period in operation enabled; return the latch instant of the first one."""
        if self.enabled_at_ns is None:
            self.enabled_at_ns = latch_ns
        self.samples.push((length_ns, age_ns, compute_ns, lateness_ns))
        self.cycles += 1
        if lateness_ns > LATE_SHARE * self.period_ns:
            self.late += 1
        return self.enabled_at_ns

    def sample(self, name: str) -> NDArray[np.float64]:
        """Return one column of `samples` [ns], shape `(n_periods,)`.

        `name` is `period_ns`, `age_ns` (age of the oldest feedback when it was used), `compute_ns` (computing time of
        the host) or `lateness_ns` (from the planned to the real begin). Raises ValueError for another name.
        """
        return self.samples.column(name)

    @property
    def duration(self) -> float:
        """Time from operation enabled to the end of the last period [s]; 0 when the drives were never enabled."""
        if self.enabled_at_ns is None or self.last_ns is None:
            return 0.0
        # `last_ns` is the beginning of the last period, so that period itself is added.
        return (self.last_ns + self.period_ns - self.enabled_at_ns) * 1e-9

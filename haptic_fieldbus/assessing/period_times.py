"""How punctual each period of a run in real time was, for the picture of the run."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # imported for its type alone: a plan that is not run never loads it
    from haptic_fieldbus.assessing.loop_report import LoopReport


@dataclass(frozen=True, eq=False)
class PeriodTimes:
    """How late each period began, and how old its feedback was when it was used [s]; all of shape `(n_periods,)`."""

    times: NDArray[np.float64]
    """[s from *operation enabled*]"""
    lateness: NDArray[np.float64]
    age: NDArray[np.float64]

    @classmethod
    def of(cls, report: "LoopReport") -> "PeriodTimes":
        """Return the times of the periods that the report holds; of a very long run these are the last ones."""
        lengths = report.sample("period_ns")
        times = report.duration - np.cumsum(lengths[::-1])[::-1] * 1e-9
        return cls(times, report.sample("lateness_ns") * 1e-9, report.sample("age_ns") * 1e-9)

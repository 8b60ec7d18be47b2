"""Record of the loop during a run: counts, instants, and four times of each period."""

import struct
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_fieldbus.protocols.traffic import Json
from haptic_fieldbus.signals import LinkFlag

if TYPE_CHECKING:
    from haptic_fieldbus.planning.live_changes import Change, RampingChange


# Record of a run: rows of numbers in a preallocated ring buffer.


class Record:
    """Ring buffer of the last `capacity` rows; a push is one `struct` call into memory allocated beforehand."""

    def __init__(self, columns: Sequence[str], capacity: int) -> None:
        self.columns = tuple(columns)
        self.capacity = capacity
        self.pushed = 0
        """Number of rows pushed so far; the ring holds the last `capacity` of them."""
        self.followers: list[Callable[[Sequence[float]], object]] = []
        """Functions that get each row after it was pushed."""
        # The whole ring is touched here, so that no push in the loop allocates memory.
        self._values = array("d", [0.0]) * (len(self.columns) * capacity)
        row = struct.Struct(f"{len(self.columns)}d")
        self._pack_into, self._unpack_from, self._size = row.pack_into, row.unpack_from, row.size

    def __len__(self) -> int:
        return min(self.pushed, self.capacity)

    def push(self, row: Sequence[float]) -> None:
        """Append one row, in the order of `columns`; a full ring overwrites its oldest row.

        Raises `struct.error` when the row has another length than `columns`.
        """
        self._pack_into(self._values, self.pushed % self.capacity * self._size, *row)
        self.pushed += 1
        for follow in self.followers:
            follow(row)

    @property
    def last(self) -> tuple[float, ...]:
        """The row pushed last; zeros before the first push."""
        return self._unpack_from(self._values, (self.pushed - 1) % self.capacity * self._size)

    def rows(self) -> NDArray[np.float64]:
        """Return a copy of all rows held, oldest first, shape `(n_rows, n_columns)`."""
        table = self._table()
        if self.pushed <= self.capacity:
            return table[: self.pushed].copy()
        # The oldest row stands where the next push would write; `roll` copies, so the ring is not aliased.
        return np.roll(table, -(self.pushed % self.capacity), axis=0)

    def column(self, name: str, first: int = 0) -> NDArray[np.float64]:
        """Return one column from row number `first` on, oldest value first, shape `(n_rows,)`.

        Raises ValueError for an unknown name.
        """
        return np.asarray(self._table()[self._held(first), self.columns.index(name)])

    def since(self, first: int) -> NDArray[np.float64]:
        """Return a copy of the rows from number `first` on, counted from the first push; some may be overwritten."""
        return self._table()[self._held(first)]

    def _held(self, first: int) -> NDArray[np.int64]:
        """Return the ring positions of the rows from number `first` on, as far as they are held."""
        return np.arange(max(first, self.pushed - self.capacity), self.pushed) % self.capacity

    def _table(self) -> NDArray[np.float64]:
        return np.frombuffer(self._values).reshape(self.capacity, len(self.columns))


SAMPLES = ("period_ns", "age_ns", "compute_ns", "lateness_ns")

LATE_SHARE = 0.1
"""Lateness from which a period counts as late, as a share of the period."""


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
    late_faults: Mapping[str, tuple[LinkFlag, int]] = field(default_factory=dict)
    """By axis, the fault that its drive told after the last period of a run without a trip, with its code."""
    foreign_load: Mapping[str, float] = field(default_factory=dict)
    """By axis, the share of its bus that frames of other devices took."""
    changes: "list[RampingChange]" = field(default_factory=list)
    unmade: "tuple[Change, ...]" = ()
    """Due changes that never began."""
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


# What a report of these times shows: their distributions, and for the picture of the run each period.


@dataclass(frozen=True)
class Percentiles:
    """Percentiles and maximum of a time [µs]."""

    p50: float
    p99: float
    p999: float
    max: float

    @classmethod
    def of(cls, values_ns: ArrayLike) -> "Percentiles | None":
        """Return the percentiles of durations [ns] of shape `(n,)`; None when there are none."""
        values = np.sort(np.asarray(values_ns, dtype=float))
        if values.size == 0:
            return None
        # `np.percentile` imports `numpy.ma`, which nothing else of a run needs.
        shares = np.array([0.5, 0.99, 0.999, 1.0])
        p50, p99, p999, largest = np.interp(shares * (values.size - 1), np.arange(values.size), values) / 1e3
        return cls(float(p50), float(p99), float(p999), float(largest))

    def to_json(self) -> Json:
        return dict(vars(self))


@dataclass(frozen=True)
class Timing:
    """Distributions [µs] of the period, of the age of the feedback at its use, of the computing time and of the
    lateness.

    None without periods in operation enabled. The computing time is a report only: simulations use the constant of the
    plan. For a run of more than 500000 periods, the distributions cover the last 500000.
    """

    period_us: Percentiles | None
    age_us: Percentiles | None
    compute_us: Percentiles | None
    lateness_us: Percentiles | None = None
    late: int = 0
    """Number of periods that began more than a tenth of the period late."""

    def to_json(self) -> Json:
        times = {name: each.to_json() if isinstance(each, Percentiles) else None for name, each in vars(self).items()}
        return {**times, "late": self.late}


@dataclass(frozen=True, eq=False)
class PeriodTimes:
    """Lateness of each period, and age of its feedback at its use [s]; all of shape `(n_periods,)`."""

    times: NDArray[np.float64]
    """[s from *operation enabled*]"""
    lateness: NDArray[np.float64]
    age: NDArray[np.float64]

    @classmethod
    def of(cls, report: LoopReport) -> "PeriodTimes":
        """Return the times of the periods that the report holds; of a very long run these are the last ones."""
        lengths = report.sample("period_ns")
        times = report.duration - np.cumsum(lengths[::-1])[::-1] * 1e-9
        return cls(times, report.sample("lateness_ns") * 1e-9, report.sample("age_ns") * 1e-9)

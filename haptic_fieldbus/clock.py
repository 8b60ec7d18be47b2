"""Time for loop, buses and simulated drives: real, or virtual and deterministic.

All times are whole nanoseconds since an arbitrary origin.
"""

import time
from typing import Protocol


class Clock(Protocol):
    """A source of time; a run waits only through it."""

    name: str

    def now_ns(self) -> int:
        """Return the present time [ns]."""

    def sleep_until(self, deadline_ns: int) -> int:
        """Wait for the deadline; return the lateness [ns], 0 when on time or early."""

    def compute(self, duration_ns: int) -> None:
        """Account for computing time [ns]: virtual time advances by it, real time has advanced by itself."""


class MonotonicClock:
    """The machine's monotonic clock."""

    name = "monotonic"

    now_ns = staticmethod(time.monotonic_ns)

    def sleep_until(self, deadline_ns: int) -> int:
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
        return max(0, time.monotonic_ns() - deadline_ns)

    def compute(self, duration_ns: int) -> None:
        """Do nothing: real computing time has passed already."""


class VirtualClock:
    """A clock that advances only when a caller waits or computes, and then at once."""

    name = "virtual"

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> int:
        lateness_ns = self._now_ns - deadline_ns
        if lateness_ns > 0:
            return lateness_ns
        self._now_ns = deadline_ns
        return 0

    def compute(self, duration_ns: int) -> None:
        self._now_ns += duration_ns

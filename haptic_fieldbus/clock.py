"""Time for loop, buses and simulated drives: real, or virtual and deterministic.

All times are integer nanoseconds since an arbitrary origin.
"""

import time
from typing import Protocol


class Clock(Protocol):
    """Where time comes from; everything that waits, waits here."""

    name: str

    def now_ns(self) -> int: ...

    def sleep_until(self, deadline_ns: int) -> int:
        """Wait for the deadline; returns the lateness [ns], 0 when on time or early."""

    def compute(self, duration_ns: int) -> None:
        """Account for computing time: passes by itself in real time, is added in virtual time."""


class MonotonicClock:
    """The machine's monotonic clock."""

    name = "monotonic"

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> int:
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
        return max(0, time.monotonic_ns() - deadline_ns)

    def compute(self, duration_ns: int) -> None:
        """Real computing time has passed already."""


class VirtualClock:
    """Time that jumps: it stands still until somebody waits."""

    name = "virtual"

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> int:
        lateness_ns = max(0, self._now_ns - deadline_ns)
        self._now_ns = max(self._now_ns, deadline_ns)
        return lateness_ns

    def compute(self, duration_ns: int) -> None:
        self._now_ns += duration_ns

"""The interface to simulated buses with their drives, for a run in virtual time.

`HostClock` is the clock of a computer with faults (late, paused, stepped clock), on top of the true virtual time. The
simulated worlds live in the true time, `truth`; the loop and the master see this clock. Without a fault both are the
same.
"""

from collections.abc import Iterator, Sequence
from itertools import repeat
from typing import Any, Protocol

from haptic_fieldbus.assessing.recording import Truth
from haptic_fieldbus.buses.bus import StepwiseBus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.drive.rig import BusSection
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import ClockStep, HandFault, HostFault, HostLate, HostPaused, SlowCompute, kinds_of


class HostClock:
    """The clock of the host; faults act on its next waits and periods."""

    def __init__(self, truth: Clock, lateness: Iterator[int] | None = None) -> None:
        """`lateness` gives the lateness of each wait [ns]; None: no wait is late."""
        self.truth = truth
        self._lateness = repeat(0) if lateness is None else lateness
        self.name = truth.name
        self._offset_ns = 0
        self._late: list[int] = []
        """Lateness [ns] of the next waits."""
        self._slow: list[int] = []
        """Further computing time [ns] of the next periods."""
        self._happened: list[HostFault] = []

    def now_ns(self) -> int:
        return self.truth.now_ns() + self._offset_ns

    def sleep_until(self, deadline_ns: int) -> int:
        late_ns = (self._late.pop(0) if self._late else 0) + next(self._lateness)
        return late_ns + self.truth.sleep_until(deadline_ns + late_ns - self._offset_ns)

    def compute(self, duration_ns: int) -> None:
        self.truth.compute(duration_ns + (self._slow.pop(0) if self._slow else 0))

    def happen(self, fault: HostFault) -> None:
        """Apply a fault now, once, even if several buses report it."""
        if any(fault is each for each in self._happened):
            return
        self._happened.append(fault)
        match fault:
            case HostLate(delay=delay, count=count):
                self._late += [round(delay * 1e9)] * min(count, 1_000_000)
            case HostPaused(duration=duration):
                self._late.append(round(duration * 1e9))
            case SlowCompute(extra=extra, count=count):
                self._slow += [round(extra * 1e9)] * min(count, 1_000_000)
            case ClockStep(step=step):
                self._offset_ns += round(step * 1e9)


def truth_of(clock: Clock) -> Clock:
    """Return the clock of the simulated worlds for the clock of a host."""
    return clock.truth if isinstance(clock, HostClock) else clock


class Simulation(Protocol):
    """The part of a protocol that simulates its buses and drives."""

    @property
    def kinds(self) -> frozenset[str]:
        """Kinds of faults that its buses and drives may have; by default the kinds that need neither bus nor link."""
        return kinds_of(HostFault) | kinds_of(HandFault)

    def simulate(
        self, section: BusSection, channel: str, slots: Sequence[DriveOnBus], clock: Clock, seed: int | str, log: Any
    ) -> tuple[StepwiseBus, Truth | None]:
        """Return a bus with these drives, and their true motion, None where it is not known.

        `channel` is the name of the bus in messages.
        """

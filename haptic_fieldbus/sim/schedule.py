"""The schedule of the faults of a bench: each happens once, `at` seconds after *operation enabled*.

A drive may be enabled more than once, for example for the watchdog test and then for the run. So the time counts anew
from each *operation enabled*. Until the first fault has happened, it stops counting when the drive is freed. After
that, the other faults keep their times, even if a fault frees the drive.
"""

import gc
import heapq
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.faults import AnswerFault, ConnectionReset, DriveFaultKind, HostFault, LineFault

# Planned actions of a simulated world, each called at its instant.

Action = Callable[[int], None]
"""Called with the instant [ns] for which it was planned."""
Plan = Callable[[int, Action], None]
"""Plan to call an action at an instant [ns], with that instant."""


class TimerQueue:
    """Actions by their instants; those of one instant are called in the order in which they were planned."""

    def __init__(self) -> None:
        self.due_ns = NEVER_NS
        """Instant of the next action; NEVER_NS when there is none."""
        self._waiting: list[tuple[int, int, Action]] = []
        # Orders actions of the same instant by age; callables cannot be compared.
        self._planned = 0

    def plan(self, t_ns: int, action: Action) -> None:
        """Plan to call `action` at an instant, with that instant."""
        self._planned += 1
        heapq.heappush(self._waiting, (t_ns, self._planned, action))
        self.due_ns = self._waiting[0][0]

    def run(self, t_ns: int) -> None:
        """Call all due actions, also those planned meanwhile."""
        while self.due_ns <= t_ns:
            _, _, action = heapq.heappop(self._waiting)
            self.due_ns = self._waiting[0][0] if self._waiting else NEVER_NS
            action(t_ns)


# What drives that are hosted in real time need, on any bus.

LONGEST_REMEMBERED = 1000
"""Least number of latest motion segments that are kept; no caller needs more."""
NAP_NS = 100_000_000
"""Longest wait, so that a request to stop is noticed soon."""


@contextmanager
def frozen() -> Iterator[None]:
    """Keep what exists now out of garbage collection inside the block, so that a collection has little to do.

    If the surrounding program had frozen objects, all stay frozen, because theirs cannot be told apart.
    """
    theirs = gc.get_freeze_count()
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        if not theirs:
            gc.unfreeze()


TimedFault = DriveFaultKind | LineFault | AnswerFault | HostFault


@dataclass(eq=False)
class _Waiting:
    """A fault that is planned, unless it was cancelled."""

    fault: TimedFault
    node: int
    cancelled: bool = False

    def concerns(self, fault: TimedFault, node: int) -> bool:
        """Return whether this is the same fault; of the same drive, unless it is a fault of the bus or of the host."""
        return self.fault is fault and (self.node == node or isinstance(fault, LineFault | ConnectionReset | HostFault))


class FaultSchedule:
    """The faults of all drives of a bus, by node-ID; those of the bus and of the host count from its first drive."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._waiting: list[_Waiting] = []
        self._happened: list[_Waiting] = []

    def begin(
        self, faults: Iterable[TimedFault], node: int, action: Callable[[TimedFault], Callable[[int], None]], t_ns: int
    ) -> None:
        """Plan the faults of a drive that is in *operation enabled* from now on; `action` returns their effects.

        Faults that have happened, or wait for another drive, are left out.
        """
        self._cancel(node)
        for fault in faults:
            if not any(each.concerns(fault, node) for each in (*self._happened, *self._waiting)):
                waiting = _Waiting(fault, node)
                self._waiting.append(waiting)
                self._plan(t_ns + round(fault.at * 1e9), partial(self._happen, waiting, action(fault)))

    def freed(self, node: int) -> None:
        """Note that torque of a drive has ended."""
        if not self._happened:
            self._cancel(node)

    def _cancel(self, node: int) -> None:
        for waiting in self._waiting:
            waiting.cancelled |= waiting.node == node
        self._waiting = [waiting for waiting in self._waiting if not waiting.cancelled]

    def _happen(self, waiting: _Waiting, act: Callable[[int], None], t_ns: int) -> None:
        if not waiting.cancelled:
            self._waiting.remove(waiting)
            self._happened.append(waiting)
            act(t_ns)

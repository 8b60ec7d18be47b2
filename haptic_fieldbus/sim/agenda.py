"""Planned actions of a simulated world, each called at its instant."""

import heapq
from collections.abc import Callable

from haptic_fieldbus.sim import NEVER_NS

Action = Callable[[int], None]
"""Called with the instant [ns] for which it was planned."""
Plan = Callable[[int, Action], None]
"""Plan to call an action at an instant [ns], with that instant."""


class Agenda:
    """Actions by their instants; those of one instant are called in the order in which they were planned."""

    def __init__(self) -> None:
        self._waiting: list[tuple[int, int, Action]] = []
        # Orders actions of the same instant by age; callables cannot be compared.
        self._planned = 0

    @property
    def due_ns(self) -> int:
        """Return the instant of the next action; NEVER_NS when there is none."""
        return self._waiting[0][0] if self._waiting else NEVER_NS

    def plan(self, t_ns: int, action: Action) -> None:
        """Plan to call `action` at an instant, with that instant."""
        self._planned += 1
        heapq.heappush(self._waiting, (t_ns, self._planned, action))

    def run(self, t_ns: int) -> None:
        """Call all actions that are due, those included that are planned meanwhile."""
        while self.due_ns <= t_ns:
            heapq.heappop(self._waiting)[2](t_ns)

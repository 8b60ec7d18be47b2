"""Simulated time at a pace, and handles of a simulation that are led: what a page, or a recorded run, does to one."""

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from time import monotonic_ns
from typing import Any, Protocol

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.axis import AxisCycle

SLACK_NS = 2_000_000
"""By how much simulated time may be ahead of real time, so that not every period sleeps."""
BEHIND_NS = 100_000_000
"""By how much a slow computer may fall behind before the simulated time is no longer made up for."""
MOST_STEPS = 10_000
"""Largest number of periods that a paused simulation is still to go on."""
POLL = 0.25
"""Longest time between two looks at the pace [s]."""
MOST_LED = 100_000
"""Largest number of recorded commands of a hand, some minutes of dragging without a rest."""
FORGOTTEN: Any = object()
Led = tuple[int, str, float | str | None]
"""A command to the hand of a simulation: number of the period after which it acts; axis and place that the hand pulls
to, none where it lets go; or no axis and the name of the hand that takes all handles."""


class SimulatedTime(VirtualClock):
    """Virtual time that follows real time, faster or slower, or stands still; nothing in it depends on the pace."""

    def __init__(self) -> None:
        super().__init__()
        self.speed, self.paused = 1.0, False
        self.period_ns = 1_000_000
        """Period of the loop, which is what one step lets pass."""
        self._until_ns = 0
        """Time up to which a paused simulation may go on."""
        self.leaving: Callable[[], bool] = lambda: False
        """Whether the run is to end, which waits for no pace."""
        self.changed = threading.Event()
        self._anchor = (self.now_ns(), monotonic_ns())

    def sleep_until(self, deadline_ns: int) -> int:
        while not self.leaving() and (wait_ns := self._ahead_ns(deadline_ns)) > 0:
            self.changed.clear()
            self.changed.wait(min(wait_ns * 1e-9, POLL))
        return super().sleep_until(deadline_ns)

    def set(self, *, speed: float | None = None, paused: bool | None = None, steps: int = 0) -> None:
        """Change the pace; any thread may call it. A simulation that is paused goes on by `steps` periods."""
        now_ns = self.now_ns()
        self.speed = self.speed if speed is None else min(max(speed, 0.001), 10.0)
        if paused is not None and paused is not self.paused:
            self._until_ns, self.paused = now_ns, paused
        further = max(self._until_ns, now_ns) + max(0, steps) * self.period_ns
        self._until_ns = min(further, now_ns + MOST_STEPS * self.period_ns)
        self._anchor = (now_ns, monotonic_ns())
        self.changed.set()

    def _ahead_ns(self, deadline_ns: int) -> float:
        """Return how long a deadline has to be waited for [ns]."""
        if self.paused:
            self._anchor = (self.now_ns(), monotonic_ns())
            # Not each wait is a period: the world behind a simulated bus waits for each of its events.
            return 0 if deadline_ns <= self._until_ns else math.inf
        virtual_ns, real_ns = self._anchor
        ahead_ns = (deadline_ns - virtual_ns) / self.speed - (monotonic_ns() - real_ns)
        if ahead_ns < -BEHIND_NS:
            self._anchor = (deadline_ns, monotonic_ns())
        return ahead_ns if ahead_ns > SLACK_NS else 0


class Handle(Protocol):
    """The handle of a simulated axis, as a hand takes it; efforts and places are in the workspace."""

    def pull(self, position: float, target: float, period: float) -> None:
        """Pull towards a place with a spring."""

    def let_go(self) -> None:
        """Let go."""

    def take(self, hand: str) -> None:
        """Let the hand of this name take the handle."""


class Leading:
    """The handles of a run, led by commands of a page, of a recorded run, or both; what has acted is kept."""

    def __init__(self, handles: Mapping[str, Handle], recorded: Sequence[Led], hand: str) -> None:
        self.handles = handles
        self.hand = hand
        """Name of the hand that a person chose last."""
        self.acted: list[Led] | None = []
        """Commands with the periods in which they acted; None: too many to keep."""
        self._recorded = deque(recorded)
        self._asked: dict[str, float | str | None] = {}
        self._pulls: dict[str, float] = {}
        self._number = 0

    # Any thread.

    def pull(self, axis: str, target: float | None) -> None:
        """Pull the handle of an axis towards a place from now on [m or rad]; None lets go."""
        self._asked[axis] = target

    def take(self, hand: str) -> None:
        """Let a hand of this name take all handles."""
        self._asked.clear()
        self._asked[""] = self.hand = hand

    def let_go(self) -> None:
        """Let all handles go that are pulled."""
        self._asked |= dict.fromkeys([*self._pulls, *filter(None, [*self._asked])])

    # The thread of the loop.

    def act(self, axes: Mapping[str, AxisCycle], period: float) -> None:
        """Let the hands act; called once a period, after its row."""
        while self._recorded and self._recorded[0][0] <= self._number:
            self._obey(*self._recorded.popleft()[1:])
        if self._asked:
            for axis in [*self._asked]:
                # A hand that takes all handles at this moment has forgotten what was asked for.
                to = self._asked.pop(axis, FORGOTTEN)
                # The hand of the simulation stays at a handle that nobody has pulled: a page that goes says "let go".
                if to is not FORGOTTEN and (to is not None or axis in self._pulls):
                    self._obey(axis, to)
        for axis, target in self._pulls.items():
            if axes[axis].state.begun:
                self.handles[axis].pull(axes[axis].state.position, target, period)
        self._number += 1

    def _obey(self, axis: str, to: float | str | None) -> None:
        if isinstance(to, str):
            self._pulls.clear()
            for handle in self.handles.values():
                handle.take(to)
        elif to is None:
            self._pulls.pop(axis, None)
            self.handles[axis].let_go()
        elif self._pulls.get(axis) == to:
            return
        else:
            self._pulls[axis] = to
        if self.acted is not None:
            self.acted.append((self._number, axis, to))
            if len(self.acted) > MOST_LED:
                self.acted = None

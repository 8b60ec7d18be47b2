"""Changes of a scene while it runs: asked for at a time, or from another thread, and made by the loop between periods.

All that takes time (checks, stability, fresh laws of elements) is done by who asks; the loop only takes what is ready,
and where nothing is asked it looks at one attribute. Changes are made one after another, each when the ramp of the one
before is over, and each was judged on top of those before: what runs is always a mix of two sets that were judged.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING

from haptic_fieldbus.errors import HapticFieldbusError, UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.live_changes import RAMP, Applied, Change, plan_change
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.scene import Scene

if TYPE_CHECKING:
    from haptic_fieldbus.cycle.cycle import Cycle

Scheduled = tuple[float, Mapping[str, Setting]]
"""Seconds from operation enabled, and settings."""


@dataclass(frozen=True)
class Ready:
    """A change with all that the loop needs to make it."""

    change: Change
    begin: Callable[[], None]


class Changes:
    """The changes of one run: those scheduled [s from operation enabled], and those that `request` asks for.

    `ramp` [s] is how long a change takes. Give it to `run`, and ask from any thread while that runs.
    """

    def __init__(self, scheduled: Iterable[Scheduled] = (), *, ramp: float = RAMP) -> None:
        self.scheduled = tuple(scheduled)
        self.ramp = ramp
        self.applied: list[Applied] = []
        """What the loop has made, in order."""
        self.waiting: deque[Ready] = deque()
        """What the loop will make; it alone takes from it."""
        self._lock = Lock()
        """Between those who ask; the loop never takes it."""
        self._planned: tuple[Change, ...] = ()
        self._running: Plan | None = None
        self._last: Plan | None = None
        self._cycle: Cycle | None = None
        self._force = False
        self._free_ns = 0
        """When the last ramp is over, from operation enabled."""

    @property
    def scene(self) -> Scene:
        """What is in force, or comes into force along the ramp that has begun."""
        if self._running is None:
            raise UsageError("no run has these changes yet")
        return self.applied[-1].change.plan.scene if self.applied else self._running.scene

    @property
    def since(self) -> float:
        """When the ramp to `scene` began [s from operation enabled]; 0 where nothing has changed."""
        return self.applied[-1].time if self.applied else 0.0

    def request(self, settings: Mapping[str, Setting]) -> Change:
        """Check new values and hand them to the loop, from any thread while it runs; they hold from the next period on.

        Raises what `run` raises for such settings, UnstableSceneError included; the old values stay then.
        """
        with self._lock:
            if self._running is None or self._last is None or self._cycle is None:
                raise UsageError("nothing runs with these changes: they can be asked for while `run` runs")
            if len(self._planned) > len(self.applied):
                raise UsageError(f"scheduled changes are still to come, up to {exactly(self._planned[-1].time)} s")
            change = plan_change(self._running, self._last, settings, force=self._force)
            self._hand_over(change, self._last, self._cycle)
            self._last = change.plan
        return change

    def check(self, plan: Plan, duration: float, *, force: bool) -> tuple[Change, ...]:
        """All that is scheduled, on top of each other; raises what `request` raises, before anything moves."""
        if self._running is not None:
            raise UsageError("these changes were those of another run; make new ones")
        faults = [] if 0.0 < self.ramp < math.inf else [f"ramp {exactly(self.ramp)}: expected a time above 0 s"]
        faults += [
            f"change at {exactly(time)} s: expected a time above 0 s and below the duration, {exactly(duration)} s"
            for time, _ in self.scheduled
            if not 0.0 < time < duration
        ]
        if faults:
            raise UsageError("\n".join(faults))
        planned: list[Change] = []
        for time, settings in sorted(self.scheduled, key=lambda scheduled: scheduled[0]):
            try:
                planned.append(
                    plan_change(plan, planned[-1].plan if planned else plan, settings, force=force, time=time)
                )
            except HapticFieldbusError as error:
                error.add_note(f"asked for by the change at {exactly(time)} s")
                raise
        self._running, self._planned, self._force = plan, tuple(planned), force
        return self._planned

    def open(self, cycle: "Cycle") -> None:
        """From now on changes can be asked for; `check` came before."""
        self._last = self._running
        for change in self._planned:
            if self._last is not None:
                self._hand_over(change, self._last, cycle)
            self._last = change.plan
        self._cycle = cycle

    def close(self) -> None:
        """The run is over."""
        self._cycle = None

    def make(self, coming_ns: int, after_ns: int, period_ns: int) -> None:
        """Called by the loop between two periods while something waits; the next begins at `coming_ns` from enabled."""
        change = self.waiting[0].change
        if coming_ns + period_ns // 2 < max(self._free_ns, round(change.time * 1e9)):
            return
        ready = self.waiting.popleft()
        ready.begin()
        periods = self._periods(period_ns)
        self._free_ns = coming_ns + periods * period_ns
        self.applied.append(Applied(change, coming_ns * 1e-9, after_ns, periods))

    def _periods(self, period_ns: int) -> int:
        return max(1, round(self.ramp * 1e9 / period_ns))

    def _hand_over(self, change: Change, before: Plan, cycle: "Cycle") -> None:
        self.waiting.append(Ready(change, cycle.prepare(before, change.plan, self._periods(before.period_ns))))

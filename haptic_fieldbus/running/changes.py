"""Changes of a scene during a run: scheduled, or requested by another thread; the loop makes them between periods.

The caller does everything that takes time: checks, stability, new laws of elements. The loop only begins changes that
are ready; while none waits, it tests one attribute. Changes are made one after another, each after the ramp of the
previous one, and each is judged together with the previous ones. The running scene is therefore always a mix of two
judged sets of elements.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from threading import Lock
from typing import TYPE_CHECKING

from haptic_fieldbus.errors import HapticFieldbusError, UsageError, raise_all, wrong_kind
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.live_changes import RAMP, Change, RampingChange, plan_change
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import LONGEST
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.scene import Scene

if TYPE_CHECKING:
    from haptic_fieldbus.cycle.cycle import Cycle

Scheduled = tuple[float, Mapping[str, Setting]]
"""Time [s from operation enabled] and settings of a change."""


@dataclass(frozen=True)
class ReadyChange:
    """A change and the function that begins its ramp."""

    change: Change
    begin: Callable[[], bool]
    """Returns False and begins nothing while the change would throw the handle."""


class Changes:
    """Changes of one run: `scheduled` changes, at times [s from operation enabled], and changes from `request`.

    `ramp` is the duration of a change [s]. Pass the object to `run`, and call `request` from any thread during the run.
    """

    def __init__(self, scheduled: Iterable[Scheduled] = (), *, ramp: float = RAMP) -> None:
        self.scheduled = tuple(_checked(scheduled))
        if not _is_number(ramp):
            raise wrong_kind("ramp", "a number in s", ramp)
        self.ramp = ramp
        self.applied: list[RampingChange] = []
        """Changes whose ramp has begun, in order."""
        self.waiting: deque[ReadyChange] = deque()
        """Changes that the loop will make; only the loop removes from it."""
        self._lock = Lock()
        """Serialises the callers of `request`; the loop never acquires it, so it never waits for a caller."""
        self._planned: tuple[Change, ...] = ()
        self._running: Plan | None = None
        self._last: Plan | None = None
        self._cycle: Cycle | None = None
        self._force = False
        self._free_ns = 0
        """End of the last ramp, from operation enabled."""
        self._due_ns: int | None = None
        """Time from which the first waiting change has tried to begin, from operation enabled."""

    @property
    def scene(self) -> Scene:
        """Current scene, or the scene at the end of the present ramp; raises UsageError before a run."""
        if self._running is None:
            raise UsageError("these changes belong to no run yet")
        return self.applied[-1].change.plan.scene if self.applied else self._running.scene

    @property
    def since(self) -> float:
        """Time at which the ramp to `scene` began [s from operation enabled]; 0 when nothing has changed."""
        return self.applied[-1].time if self.applied else 0.0

    @own_faults()
    def request(self, settings: Mapping[str, Setting]) -> Change:
        """Check new values, pass them to the loop and return the change. Any thread may call it during the run.

        The ramp to the new values begins with the next period, or after the ramp of the previous change. It waits while
        the new values would change the force at the handle by more than a quarter of the limit. Raises SceneError,
        UsageError or PlanError for settings that `run` would refuse, UnstableSceneError included, and UsageError if
        nothing runs or scheduled changes are still to come. The old values then stay.
        """
        with self._lock:
            cycle = self._cycle
            if self._running is None or self._last is None or cycle is None:
                raise UsageError("no run uses these changes: request them while `run` runs")
            # Changes are made in the order in which they were judged, so a request would have to wait for these.
            if len(self._planned) > len(self.applied):
                raise UsageError(f"scheduled changes are pending, up to {exactly(self._planned[-1].time)} s")
            change = plan_change(self._running, self._last, settings, force=self._force)
            ready = self._prepared(change, self._last, cycle)
            if self._cycle is None:
                raise UsageError("the run ended while the change was judged; it was not made")
            self.waiting.append(ready)  # this and `popleft` are atomic, so neither side needs a lock
            self._last = change.plan
        return change

    def check(self, plan: Plan, duration: float, *, force: bool) -> tuple[Change, ...]:
        """Compile and judge the scheduled changes, each together with the previous ones; return them in order of time.

        Call it before anything moves. Raises UsageError for a ramp or a time out of range and for an object that served
        another run, and otherwise the errors of `request`. UnstableSceneError is not raised if `force`.
        """
        if self._running is not None:
            raise UsageError("these changes belong to another run; make new ones")
        faults = []
        if not 0.0 < self.ramp <= LONGEST:
            faults = [f"ramp {exactly(self.ramp)}: expected a time above 0 s, at most {exactly(LONGEST)} s"]
        faults += [
            f"change at {exactly(time)} s: expected a time above 0 s and below the duration, {exactly(duration)} s"
            for time, _ in self.scheduled
            if not 0.0 < time < duration
        ]
        raise_all(faults)
        planned: list[Change] = []
        for time, settings in sorted(self.scheduled, key=lambda scheduled: scheduled[0]):
            try:
                planned.append(
                    plan_change(plan, planned[-1].plan if planned else plan, settings, force=force, time=time)
                )
            except HapticFieldbusError as error:
                error.args = (str(error).replace("--set ", f"--change {exactly(time)}:"),)
                error.add_note(f"requested by the change at {exactly(time)} s")
                raise
        self._running, self._planned, self._force = plan, tuple(planned), force
        return self._planned

    def open(self, cycle: "Cycle") -> None:
        """Prepare the scheduled changes for `cycle` and accept requests; `check` must have been called."""
        self._last = self._running
        for change in self._planned:
            if self._last is not None:
                self.waiting.append(self._prepared(change, self._last, cycle))
            self._last = change.plan
        self._cycle = cycle  # last, because `request` takes it as the sign that all else is ready

    def close(self, duration: float) -> tuple[Change, ...]:
        """Refuse further requests, and return the changes that were due within `duration` [s] but never began."""
        self._cycle = None
        return tuple(ready.change for ready in self.waiting if ready.change.time < duration)

    def make(self, coming_ns: int, after_ns: int, period_ns: int) -> None:
        """Begin the first waiting change if it is due, the previous ramp is over, and it would not throw the handle.

        The loop calls this between two periods while a change waits. `coming_ns` is the latch instant of the next
        period, counted from operation enabled. `after_ns` is that of the last period, on the clock of the loop.
        """
        change = self.waiting[0].change
        # Half a period of tolerance makes the change begin with the period nearest to its time.
        if coming_ns + period_ns // 2 < max(self._free_ns, round(change.time * 1e9)):
            return
        if self._cycle is not None and self._cycle.changing:  # after gaps the ramp of the one before is later over
            return
        if self._due_ns is None:
            self._due_ns = coming_ns
        if not self.waiting[0].begin():
            return
        self.waiting.popleft()
        periods = self._periods(period_ns)
        self._free_ns = coming_ns + periods * period_ns
        self.applied.append(RampingChange(change, coming_ns * 1e-9, after_ns, periods, self._due_ns * 1e-9))
        self._due_ns = None

    def _periods(self, period_ns: int) -> int:
        """Return the length of a ramp in periods, at least 1."""
        return max(1, round(self.ramp * 1e9 / period_ns))

    def _prepared(self, change: Change, before: Plan, cycle: "Cycle") -> ReadyChange:
        """Prepare a change in the thread of the caller."""
        return ReadyChange(change, cycle.prepare(before, change.plan, self._periods(before.period_ns)))


def _checked(scheduled: object) -> Iterator[Scheduled]:
    """Yield each time with its settings; raises TypeError for anything else."""
    expected = 'pairs of a time in s and settings, such as (2.0, {"wall.stiffness": 800.0})'
    if not isinstance(scheduled, Iterable):
        raise wrong_kind("changes", expected, scheduled)
    for each in scheduled:
        match each:
            case [time, Mapping() as settings] if _is_number(time):
                yield time, settings
            case _:
                raise wrong_kind("changes", expected, each)


def _is_number(value: object) -> bool:
    return isinstance(value, Real)

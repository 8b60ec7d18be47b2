"""The checks of one axis that a period without anything unusual does not reach: its link, its samples, its motion.

Samples are told apart by the instants at which the drive latched them. A sample that comes several periods after the
one before is used as it is: speed and acceleration are divided by the time that really passed.
"""

import math
from collections.abc import Sequence
from typing import Protocol

from haptic_fieldbus.cycle.gaps import Gaps
from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.safety import LINK_TRIPS, Trip, TripKind
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limits import LARGEST_MISSING_SHARE
from haptic_fieldbus.signals import LinkFlag

T_NS, AGE_NS, FLAGS, EMERGENCY, STATUSWORD = range(5)
"""Places in the feedback of an axis; the mapped signals follow."""

SHORTEST = 0.5
"""Shortest time between two samples by which speeds are told, in periods."""

# Plain integers: an operation with a member of an IntFlag takes as long as the rest of the method.
_STALE = int(LinkFlag.STALE)
_FAULTS = tuple((int(flag), kind) for flag, kind in LINK_TRIPS.items())


class CycleContext(Protocol):
    """The part of a cycle that its axes use."""

    trip: Trip | None
    enabled: bool

    def update_enabled(self) -> None: ...

    def sign_seen(self) -> None: ...

    def sign_doubted(self) -> None: ...


class TripOff(Protocol):
    """Takes the torque away."""

    def __call__(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None: ...


class AxisWatch:
    """Watches one axis; `trip` takes the torque away."""

    def __init__(self, axis: AxisPlan, state: AxisState, period: float, trip: TripOff) -> None:
        self._state, self._trip = state, trip
        self._period, self._period_ns = period, round(period * 1e9)
        self._looked = ((0.0, 0), (0.0, 0))
        """The way before, and the age, of the last two samples that were looked at."""
        self._limits, self._resolution = axis.limits, axis.resolution
        self._jump = axis.limits.jump(period, axis.resolution) - 2.0 * axis.resolution
        self._oldest_ns = self._limits.age * 1e9
        self._lowest, self._highest = axis.limits.position or (-math.inf, math.inf)
        self._gaps = Gaps(period, 0.5 + axis.delay.total / period, axis.largest_stretch)

    def link(self, feedback: Sequence[int], elapsed_ns: int, rendering: bool, age_before_ns: int) -> int:
        """Return how many periods this sample spans, 0 when it is not new; trip on faults of the link.

        `age_before_ns` is the age of the feedback of the period before.
        """
        state, flags = self._state, feedback[FLAGS]
        for bit, kind in _FAULTS:
            if flags & bit:
                self._trip(kind, feedback[EMERGENCY])
        if rendering and feedback[AGE_NS] > self._oldest_ns:
            self._trip(TripKind.FEEDBACK_LOST, feedback[AGE_NS] * 1e-9, self._limits.age)
        if flags & _STALE:
            state.missing += 1
            state.holding = state.missing
            return 0
        # An answer that came a period late was used then, so the gap behind it is one of the feedback too.
        lost = state.missing > 0 or age_before_ns > self._period_ns
        state.missing = state.holding = 0
        if not rendering or not state.begun:
            return 1
        if elapsed_ns < 0:
            self._trip(TripKind.CLOCK, elapsed_ns * 1e-9)
        steps = max(1, round(elapsed_ns * 1e-9 / self._period))
        if steps > 1:
            self._spanned(feedback[T_NS], steps, lost=lost)
        return steps

    def _spanned(self, t_ns: int, steps: int, *, lost: bool) -> None:
        """A sample that spans several periods: because feedback was lost, or because the loop was late."""
        passed = steps * self._period
        if not lost and passed > self._limits.age:
            self._trip(TripKind.PERIODS_MISSED, passed, self._limits.age)
        self._gaps.note(t_ns, steps)
        if self._gaps.too_many:
            kind = TripKind.FEEDBACK_SPARSE if lost else TripKind.PERIODS_MISSED
            self._trip(kind, self._gaps.share, LARGEST_MISSING_SHARE, f"{self._gaps.stretch:.2f}")

    def motion(self, here: float, way: float, elapsed_ns: int, age_ns: int) -> float:
        """Trip when the handle, now at `here` [m or rad], went `way` too fast or too suddenly, or left its range.

        Return the way of a period at the speed that this shows, or at that of before, where too little time has passed.
        """
        limits, state = self._limits, self._state
        passed = max(elapsed_ns * 1e-9, self._period)
        # A computer that stood still between SYNC and the answer may have kept a simulated drive from latching.
        passed += max(0.0, age_ns * 1e-9 - self._period)
        if abs(way) > limits.speed * passed + self._resolution:
            self._trip(TripKind.SPEED, abs(way) / passed, limits.speed)
        if not self._lowest <= here <= self._highest:
            self._trip(TripKind.POSITION, here, self._lowest if here < self._lowest else self._highest)
        # A period after a late one is shorter; by its length the same speed is no change.
        periods = elapsed_ns / self._period_ns
        change, widest = abs(way - state.way * periods), max(periods, 1.0)
        # A drive that was late latched at some instant between SYNC and arrival; three instants make a change of speed.
        (_, first_ns), (way_before, second_ns) = self._looked
        unsure = (first_ns + second_ns + age_ns) / self._period_ns * max(abs(way_before), abs(state.way))
        if change > self._jump * widest**2 + 2.0 * self._resolution * widest + unsure:
            self._trip(TripKind.ACCELERATION, change / passed**2, limits.acceleration)
        if periods <= SHORTEST:  # the speed of before stays, and with it how sure it is
            self._looked = ((way_before, first_ns), (state.way, second_ns + age_ns))
            return state.way
        self._looked = ((way_before, second_ns), (state.way, age_ns))
        return way / periods


def in_time(period: float) -> tuple[int, int]:
    """Return between which times [ns] after the last one a sample belongs to the next period."""
    return round(SHORTEST * 1e9 * period), round(1.5e9 * period)

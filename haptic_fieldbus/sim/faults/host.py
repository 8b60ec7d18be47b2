"""Faults of the computer that the loop runs on, and of the hand on the handle."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le

from haptic_fieldbus.drive.fields import NonNegativeTime, Time
from haptic_fieldbus.sim.faults.concern import Concern, Count


@dataclass(frozen=True)
class HostLate(Concern):
    """A busy computer: the next `count` times that the loop waits, it wakes up `delay` [s] too late."""

    kind: Literal["host_late"]
    at: NonNegativeTime
    delay: Time
    count: Count = 1


@dataclass(frozen=True)
class HostPaused(Concern):
    """A computer that does nothing at all for `duration` [s], as with SIGSTOP or a lid that is closed."""

    kind: Literal["host_paused"]
    at: NonNegativeTime
    duration: Time


@dataclass(frozen=True)
class ClockStep(Concern):
    """A clock of the computer that steps by `step` [s]: everything but that clock goes on as before."""

    kind: Literal["clock_step"]
    at: NonNegativeTime
    step: Annotated[float, Ge(-1000.0), Le(1000.0)]


@dataclass(frozen=True)
class SlowCompute(Concern):
    """A computer that needs `extra` [s] more for each of the next `count` periods."""

    kind: Literal["slow_compute"]
    at: NonNegativeTime
    extra: Time
    count: Count = 1


@dataclass(frozen=True)
class HandRelease(Concern):
    """The hand lets go of the handle."""

    kind: Literal["hand_release"]
    at: NonNegativeTime


@dataclass(frozen=True)
class HandHit(Concern):
    """A blow of the hand: `force` [N], signed, more than it exerts otherwise, for `duration` [s]."""

    kind: Literal["hand_hit"]
    at: NonNegativeTime
    force: Annotated[float, Ge(-1000.0), Le(1000.0)] = 100.0
    duration: Time = 0.02


HostFault = HostLate | HostPaused | ClockStep | SlowCompute
HandFault = HandRelease | HandHit

"""When the torque of a sample acts: at the latest, at the earliest, and as the plan counts it.

The way of a sample: the drive measures the position, latches it at SYNC (`encoder_latency` later), the adapter takes a
frame to the host and another one back (`adapter_latency` each), and the drive takes the set-point over at its next
control tick. A tick that is locked to SYNC makes all of this repeat. With one that runs free, the measurement is up to
a control period older and the set-point waits for up to another one; the plan counts half a period for each, which is
their mean. What the profile leaves open is planned as a locked tick and a position of the latch; only the longest
delay takes the other case.
"""

import math
from dataclasses import dataclass
from typing import Literal

from haptic_fieldbus.drive.profile import TimingSection
from haptic_fieldbus.protocols.traffic import ADAPTER_LATENCY, JITTER

NO_TICK = 1e-9
"""Control period below which a drive takes over a target at once [s]."""


@dataclass(frozen=True)
class HostTimes:
    """Times of adapter and host [s]; None: unknown, except on a simulated bus, which adds none by itself."""

    adapter_latency: float | None = None
    jitter: float | None = None
    simulated: bool = False

    @property
    def known_latency(self) -> float:
        """Latency of the adapter for a frame and its answer, as far as it is known [s]."""
        return 2.0 * (self.adapter_latency or 0.0)

    @property
    def most(self) -> float:
        """Longest time by which adapter and host can delay a set-point beyond `known_latency` [s]."""
        unknown = 0.0 if self.simulated else 1.0
        latency = 2.0 * ADAPTER_LATENCY * unknown if self.adapter_latency is None else 0.0
        return latency + (JITTER * unknown if self.jitter is None else self.jitter)


IDEAL = HostTimes(simulated=True)
"""A host that adds no time, as that of a simulated bus."""


@dataclass(frozen=True)
class Ways:
    """Times from the measurement of a position to the torque of it [s]."""

    planned: float
    shortest: float
    longest: float


def ways(timing: TimingSection, arrival: float, host: HostTimes, period: float, *, on_reception: bool) -> Ways:
    """Return the times of a drive whose set-point arrives so long after the latch, host as known [s].

    With `on_reception` False the set-point is taken over at the next SYNC.
    """
    least, most = _latencies(timing)

    def acts(ready: float, tick: Literal["sync", "free", "at once"]) -> float:
        at = ready if on_reception else math.ceil(ready / period - NO_TICK) * period
        if tick == "at once":
            return at
        return at + timing.control_period if tick == "free" else _next_tick(at, timing.control_period, on_reception)

    locked = timing.control_tick == "sync"
    return Ways(
        planned=least + acts(arrival, "free" if timing.control_tick == "free" else "sync"),
        shortest=least + acts(arrival, "sync" if locked else "at once"),
        longest=most + acts(arrival + host.most, "sync" if locked else "free"),
    )


def _latencies(timing: TimingSection) -> tuple[float, float]:
    """Return how old a position may be when it is latched, at least and at most [s]."""
    known = timing.encoder_latency or 0.0
    if timing.control_tick == "sync" and timing.encoder_latency is not None:
        return known, known
    # A drive that does not measure at SYNC shows what it measured at its own last tick.
    return known, known + timing.control_period


def _next_tick(instant: float, control_period: float, on_reception: bool) -> float:
    """Return the first multiple of `control_period` from `instant` on [s]; the instant itself without a period."""
    if control_period < NO_TICK or not on_reception:  # SYNC is a tick
        return instant
    # The tolerance keeps rounding from adding a whole period to an instant that is a multiple.
    return math.ceil(instant / control_period - 1e-9) * control_period

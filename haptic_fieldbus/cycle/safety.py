"""Protection of the hand from the scene: effort limit, slew limit, fade-in, stale feedback, trips.

A trip is final: torque is 0 from that period on, and only a new run enables the drives again. Slew, fade-in and
staleness are counted in periods, so they need no clock.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from haptic_fieldbus.planning.limits import EffortLimits
from haptic_fieldbus.signals import LinkFlag

HOLD_GAIN = (1.0, 1.0, 0.5)
"""Gain on the force, by the number of periods in a row without new feedback; a longer gap trips."""


class TripKind(Enum):
    """Reason for a trip; the value is the name that users and scripts see."""

    EMERGENCY = "emergency"
    DRIVE_FAULT = "drive fault"
    DRIVE_DISABLED = "drive disabled"
    NODE_RESET = "node reset"
    NODE_NOT_OPERATIONAL = "node not operational"
    NO_SIGN_OF_LIFE = "heartbeat lost"
    FEEDBACK_LOST = "feedback lost"
    BUS_OFF = "bus off"
    BUS_EXCEPTION = "bus exception"
    NOT_FINITE = "force not finite"
    SPEED = "speed limit"
    POSITION = "position limit"
    DRIFT = "position drift"


LINK_TRIPS = {
    LinkFlag.BUS_OFF: TripKind.BUS_OFF,
    LinkFlag.EMERGENCY: TripKind.EMERGENCY,
    LinkFlag.BOOT_UP: TripKind.NODE_RESET,
    LinkFlag.NO_SIGN_OF_LIFE: TripKind.NO_SIGN_OF_LIFE,
    LinkFlag.NOT_OPERATIONAL: TripKind.NODE_NOT_OPERATIONAL,
    LinkFlag.EXCEPTION: TripKind.BUS_EXCEPTION,
}
"""Trip of each link flag. Only the first trip of a run is kept, so the most telling causes stand first."""


@dataclass(frozen=True)
class Trip:
    """Reason and instant of the loss of torque: `value` exceeded `limit` (None: no limit) on `axis` at `t_ns`."""

    kind: TripKind
    axis: str
    t_ns: int
    value: float
    limit: float | None = None
    detail: str = ""


def hold_gain(stale_periods: int) -> float | None:
    """Return the gain on the force after so many periods without new feedback; None when the run must trip."""
    return HOLD_GAIN[stale_periods] if stale_periods < len(HOLD_GAIN) else None


def bind_limiter(limits: EffortLimits, period: float) -> Callable[[float], float]:
    """Return a limiter for one run, called once a `period` [s]: asked effort → permitted effort [N or N·m].

    It applies the fade-in, then the effort limit, then the slew limit. Infinity and NaN come out as NaN, for the caller
    to trip.
    """
    effort, largest_change = limits.effort, limits.slew * period
    growth = period / limits.fade_in
    fade = 0.0
    before = 0.0

    def limit(force: float) -> float:
        nonlocal before
        # The ordinary period. NaN fails every comparison, so it needs no test of its own here.
        if fade >= 1.0 and -effort <= force <= effort and -largest_change <= force - before <= largest_change:
            before = force
            return force
        return beyond(force)

    def beyond(force: float) -> float:
        nonlocal fade, before
        if not math.isfinite(force):
            return math.nan
        if fade < 1.0:  # counted in calls, because the limiter is called in enabled periods only
            fade = min(1.0, fade + growth)
            force *= fade
        if not -effort <= force <= effort:
            force = effort if force > effort else -effort
        if not -largest_change <= force - before <= largest_change:
            force = before + (largest_change if force > before else -largest_change)
        before = force
        return force

    return limit

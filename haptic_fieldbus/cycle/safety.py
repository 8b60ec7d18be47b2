"""What stands between a scene and a hand: limits, fade-in, staleness, trips.

A trip is final: torque is zero from that period on, and only a new run enables again. Slew, fade and staleness count
periods, so they need no clock.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from haptic_fieldbus.planning.limits import EffortLimits
from haptic_fieldbus.signals import LinkFlag

HOLD_GAIN = (1.0, 1.0, 0.5)
"""Gain on the held force by the number of periods without new feedback; beyond it: zero and stop."""


class TripKind(Enum):
    """What stopped the run; the value is the name that people and scripts see."""

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
"""What a fault of the link is as a trip, the first the most telling."""


@dataclass(frozen=True)
class Trip:
    """Why and when torque was taken away: `value` passed `limit` (where there is one) on `axis` at `t_ns`."""

    kind: TripKind
    axis: str
    t_ns: int
    value: float
    limit: float | None = None
    detail: str = ""


def hold_gain(stale_periods: int) -> float | None:
    """Gain on the held force; None: stop."""
    return HOLD_GAIN[stale_periods] if stale_periods < len(HOLD_GAIN) else None


def bind_limiter(limits: EffortLimits, period: float) -> Callable[[float], float]:
    """A limiter for one run: fade-in, then effort, then slew [effort → effort].

    What is not finite comes out as not-a-number, for the loop to stop: no comparison holds for it, so it never passes
    for a force within its limits.
    """
    effort, largest_change = limits.effort, limits.slew * period
    growth = period / limits.fade_in
    fade = 0.0
    before = 0.0

    def limit(force: float) -> float:
        nonlocal before
        if fade >= 1.0 and -effort <= force <= effort and -largest_change <= force - before <= largest_change:
            before = force
            return force
        return beyond(force)

    def beyond(force: float) -> float:
        nonlocal fade, before
        if not math.isfinite(force):
            return math.nan
        if fade < 1.0:
            fade = min(1.0, fade + growth)
            force *= fade
        if not -effort <= force <= effort:
            force = effort if force > effort else -effort
        if not -largest_change <= force - before <= largest_change:
            force = before + (largest_change if force > before else -largest_change)
        before = force
        return force

    return limit

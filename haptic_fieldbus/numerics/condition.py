"""Condition effects: a force that depends on a metric, such as a position, outside a dead band and up to a saturation.

The metric is q, its neutral value q₀ (CP offset), the dead band w on either side of it. With d = q − q₀:

    d > w    F = −c₊·(d − w) − b₊·r, limited to |F| ≤ s₊ (positive coefficient, positive saturation)
    d < −w   F = −c₋·(d + w) − b₋·r, limited to |F| ≤ s₋ (negative coefficient, negative saturation)
    else     F = 0

r is the rate of the metric, for a spring that also damps. c, s and w are defined in the USB Device Class Definition for
Physical Interface Devices (PID) 1.0. With the signs used here a positive coefficient opposes the metric.

Limiting is monotone, so the limited force with damping never delivers more power than the limited force without
damping.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.numerals import exactly


@dataclass(frozen=True)
class Side:
    """One side of the neutral value: force per metric, force per rate, and the largest force (∞ without a limit)."""

    coefficient: float
    damping: float = 0.0
    saturation: float = math.inf

    @classmethod
    def limited(cls, coefficient: float, damping: float, saturation: float | None) -> "Side":
        """Return a side whose saturation may be None, for no limit."""
        return cls(coefficient, damping, math.inf if saturation is None else saturation)


def check_coefficients(positive: float, negative: float, largest: str) -> None:
    """Check that one of the two shares is 1; raises ValueError otherwise.

    `largest` names the parameter that is the value of the stronger side.
    """
    if max(positive, negative) != 1.0:
        raise ValueError(
            f"positive_coefficient {exactly(positive)}, negative_coefficient {exactly(negative)}: expected 1 for the "
            f"stronger side, which {largest} describes"
        )


def check_breakaway(breakaway: float, coulomb: float, name: str, speed: float) -> None:
    """Check a breakaway force that sliding friction replaces at the speed called `name`; raises ValueError."""
    if 0.0 < breakaway < coulomb:
        raise ValueError(f"breakaway {exactly(breakaway)}: expected 0, or at least coulomb, {exactly(coulomb)}")
    if breakaway > coulomb and not speed:
        raise ValueError(f"{name} {exactly(speed)}: expected a speed above 0, as breakaway is above coulomb")


def bind(neutral: float, dead_band: float, positive: Side, negative: Side) -> Callable[..., float]:
    """Return a function from (metric[, rate]) to force, the shortest that these parameters allow.

    Not-a-number gives not-a-number. Pass the rate exactly when a side has damping.
    """
    if dead_band or positive != negative or positive.saturation < math.inf:
        return _sided(neutral, dead_band, positive, negative)
    coefficient, damping = positive.coefficient, positive.damping
    if damping:
        return lambda metric, rate: -coefficient * (metric - neutral) - damping * rate
    return lambda metric: -coefficient * (metric - neutral)


def _sided(neutral: float, dead_band: float, positive: Side, negative: Side) -> Callable[..., float]:
    above, below = (positive.coefficient, positive.damping), (negative.coefficient, negative.damping)
    above_limit, below_limit = positive.saturation, negative.saturation
    highest_free = dead_band or -math.inf  # without a dead band no place is free, not even the neutral one

    def force(metric: float, rate: float = 0.0) -> float:
        away = metric - neutral
        if away < -dead_band:
            (coefficient, damping), limit = below, below_limit
            away += dead_band
        elif away <= highest_free:
            return 0.0
        else:
            (coefficient, damping), limit = above, above_limit
            away -= dead_band
        found = -coefficient * away - damping * rate
        if found > limit:
            return limit
        return -limit if found < -limit else found

    return force

"""Share of periods that would be missed at a rate: by computing alone, and with the exchange on the plan's bus."""

from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.study.measure.bench import Tools
from haptic_fieldbus.study.measure.optional_parts import Playback
from haptic_fieldbus.study.measure.timing import ns_of_each

RATES = (1000.0, 2000.0, 5000.0, 10_000.0)
"""Rates of the loop [Hz]."""
SCENE = "damped_wall"


@dataclass(frozen=True)
class RateDeadline:
    """Shares of all periods that would be missed at one rate [Hz]."""

    rate: float
    missed_computing: float
    """Share in which computing alone takes longer than the period."""
    missed: float
    """Share in which computing and the exchange on the bus, one after the other, take longer than the period."""


@dataclass(frozen=True)
class RateDeadlines:
    """Times of one period [s] over `periods` periods, and the missed shares at each rate."""

    bus: float
    compute_p50: float
    compute_p999: float
    compute_max: float
    periods: int
    rates: tuple[RateDeadline, ...]


def deadlines(tools: Tools, periods: int) -> RateDeadlines:
    """Compute so many periods of the damped wall, each timed by itself, garbage collection included."""
    plan = tools.plan(SCENE)
    playback = Playback(plan)
    given = [(image,) for image in playback.images(periods)]
    spent = 1e-9 * ns_of_each(playback.running_cycle(), given)
    p50, p999, largest = np.percentile(spent, [50, 99.9, 100]).tolist()
    bus = plan.delay.bus
    late = (RateDeadline(f, float((spent > 1.0 / f).mean()), float((spent + bus > 1.0 / f).mean())) for f in RATES)
    return RateDeadlines(bus, p50, p999, largest, periods, tuple(late))

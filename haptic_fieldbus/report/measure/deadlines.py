"""How often a period would be missed at a rate: by computing alone, and with the bus that the plan uses."""

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter_ns

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.report.measure.bench import Tools
from haptic_fieldbus.report.measure.optional_parts import images, running

RATES = (1000.0, 2000.0, 5000.0, 10_000.0)
SCENE = "damped_wall"


@dataclass(frozen=True)
class Deadline:
    """At one rate [Hz]; shares of all periods."""

    rate: float
    missed_computing: float
    """Computing alone takes longer than the period."""
    missed: float
    """Computing and the exchange on the bus, one after another, do."""


@dataclass(frozen=True)
class Deadlines:
    """Times of one period [s], and what they mean at each rate."""

    bus: float
    compute_p50: float
    compute_p999: float
    compute_max: float
    periods: int
    rates: tuple[Deadline, ...]


def deadlines(tools: Tools, periods: int) -> Deadlines:
    """Compute so many periods of the damped wall, each timed by itself, garbage collection and all."""
    plan = tools.plan(SCENE)
    given = images(plan)
    cycle = running(plan)
    spent = np.empty(periods)
    for number in range(periods):
        (image,) = given[number % len(given)]
        begun = perf_counter_ns()
        cycle(image)
        spent[number] = (perf_counter_ns() - begun) * 1e-9
    bus = plan.delay.bus
    p50, p999, largest = np.percentile(spent, [50, 99.9, 100]).tolist()
    return Deadlines(bus, p50, p999, largest, periods, tuple(_at(spent, bus)))


def _at(spent: NDArray[np.float64], bus: float) -> Iterator[Deadline]:
    for rate in RATES:
        yield Deadline(rate, float((spent > 1.0 / rate).mean()), float((spent + bus > 1.0 / rate).mean()))

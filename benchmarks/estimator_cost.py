"""One step of every velocity estimator beside a backward difference written by hand."""

import itertools
from collections.abc import Callable

from rows import Row, cost, show

from haptic_fieldbus.numerics.estimators import ESTIMATORS, bind

PERIOD, COUNT = 1e-3, 0.05 / 4096
SLOW = 0.002
"""[m/s]; the longest windows of the adaptive ones, which is what they cost at most."""


def by_hand() -> Callable[[float], float]:
    before = 0.0

    def step(x: float) -> float:
        nonlocal before
        velocity = (x - before) / PERIOD
        before = x
        return velocity

    return step


def slow_motion() -> Callable[[], float]:
    """Positions in whole counts, again and again."""
    positions = itertools.cycle([COUNT * int(SLOW * n * PERIOD / COUNT) for n in range(20_000)])
    return positions.__next__


def row(name: str) -> Row:
    step, reference, here, there = bind(name, PERIOD, COUNT), by_hand(), slow_motion(), slow_motion()
    return Row(name, cost(lambda: step(here()), 2000), cost(lambda: reference(there()), 2000))


if __name__ == "__main__":
    show([row(name) for name in ESTIMATORS])

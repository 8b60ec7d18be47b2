"""A step of the batch engine beside the same loop in scipy's dlsim and python-control's forced_response."""

from collections.abc import Callable
from typing import Any

import control
import numpy as np
import scipy.signal
from rows import Row, cost, show

from haptic_fieldbus.margins import Plant, alone
from haptic_fieldbus.numerics.batch import loops, run
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.numerics.sampled import environment

PERIOD, DELAY, STIFFNESS, DAMPING = 1e-3, 0.3e-3, 600.0, 2.0
LOOPS, STEPS = 8192, 200
ALONE = 5000
"""Steps of the others, which run one loop."""


def batch(**extra: Any) -> float:
    """Seconds a step of one loop, on one core."""
    stiffness = np.linspace(100.0, 1200.0, LOOPS)
    many = loops(
        mass=0.6, damping=1.5, period=PERIOD, delay=DELAY, stiffness=stiffness, virtual_damping=DAMPING, position=1e-3,
        **extra,
    )  # fmt: skip
    return cost(lambda: run(many, STEPS), 1, repeat=5) / (LOOPS * STEPS)


def one_by_one(simulate: Callable[[], object]) -> float:
    return cost(simulate, 1, repeat=5) / ALONE


def closed_loop() -> tuple[np.ndarray, ...]:
    """The same loop as one matrix, started by an input that does nothing afterwards."""
    wall = environment(gain([[-STIFFNESS, -DAMPING]]), period=PERIOD, method=None, estimator="backward-difference")
    a = alone(Plant(0.6, 1.5), PERIOD, DELAY).matrix(wall)
    order = len(a)
    return a, np.zeros((order, 1)), np.eye(order)[:1], np.zeros((1, 1))


def rows() -> list[Row]:
    a, b, c, d = closed_loop()
    inputs, start = np.zeros(ALONE), np.eye(len(a))[0] * 1e-3
    theirs, others = scipy.signal.dlti(a, b, c, d, dt=PERIOD), control.ss(a, b, c, d, PERIOD)
    times = np.arange(ALONE) * PERIOD
    by_scipy = one_by_one(lambda: scipy.signal.dlsim(theirs, inputs, times, start))
    by_control = one_by_one(lambda: control.forced_response(others, times, inputs, start))
    linear = batch()
    return [
        Row("linear loop, beside scipy.signal.dlsim", linear, by_scipy, 1 / 50),
        Row("linear loop, beside control.forced_response", linear, by_control, 1 / 50),
        Row("unilateral wall with an encoder, beside 100 ns", batch(resolution=1e-5, unilateral=True), 1e-7, 1.0),
        Row("the same with Coulomb friction", batch(resolution=1e-5, unilateral=True, coulomb=0.2), 1e-7),
    ]


if __name__ == "__main__":
    show(rows())

"""Differences of neighbouring positions, plain and smoothed.

A difference amplifies noise: white noise σ in x becomes √2·σ/T in (x_n − x_{n−1})/T, and half the period T doubles it.
All these estimators are linear, with H(1) = 0, and their response to a ramp is its slope.

- backward-difference: H(z) = (1 − z⁻¹)/T. Late by T/2.
- moving-average (FIR): the mean of the last N differences, which is (x_n − x_{n−N})/(N·T). Late by N·T/2.
- low-pass (IIR): v_n = a·v_{n−1} + (1 − a)·d_n of the differences d, `order` times over. Late by
  T/2 + order·T·a/(1 − a).
- filtered-derivative: s/(τs + 1) by a mapping of s. Each mapping, with unit slope on a ramp, is the low-pass of order 1
  with a pole a of its own:

| mapping     | s →                 | pole a               | stable for | late by  |
|-------------|---------------------|----------------------|------------|----------|
| forward     | (z − 1)/T           | 1 − T/τ              | τ > T/2    | τ − T/2  |
| backward    | (z − 1)/(T·z)       | τ/(τ + T)            | every τ    | τ + T/2  |
| trapezoidal | 2(z − 1)/(T(z + 1)) | (2τ − T)/(2τ + T)    | τ > 0      | τ        |
| exact       | eˢᵀ → z, x on straight lines | e^(−T/τ)    | every τ    | τ (nearly) |

  Forward rings for τ below T, trapezoidal for τ below T/2, because the pole is then negative.

Noise gain of order 1: Σ h_k² of (1 − a)/T·(1 − z⁻¹)/(1 − a·z⁻¹) is 2·(1 − a)²/(T²·(1 + a)).
"""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter
from haptic_fieldbus.numerics.linear import Matrix, StateSpace

POLES: dict[str, Callable[[float, float], float]] = {
    "forward": lambda tau, period: 1.0 - period / tau if tau else -math.inf,
    "backward": lambda tau, period: tau / (tau + period),
    "trapezoidal": lambda tau, period: (2.0 * tau - period) / (2.0 * tau + period),
    "exact": lambda tau, period: math.exp(-period / tau) if tau else 0.0,
}
"""Pole of s/(τs + 1) from (τ, T), by the name of the mapping."""
LIMITS: dict[str, Callable[[float], str]] = {
    "forward": lambda period: f"tau above {exactly(0.5 * period)} s, half of the period",
    "trapezoidal": lambda period: "tau above 0",
}
"""Condition of stability for people, from T, by the name of the mapping; the other mappings are always stable."""


def shift_register(weights: Matrix) -> StateSpace:
    """Return v_n = Σ weights_j·x_{n−j} as a linear system whose states are the earlier positions; `weights` (m,)."""
    length = len(weights) - 1
    return StateSpace(
        np.eye(length, k=-1), np.eye(length)[:, :1], weights[None, 1:].astype(np.float64), weights[:1, None].copy()
    )


def _start_backward(setup: EstimatorSetup) -> Estimate:
    period = setup.period
    previous: float | None = None

    def step(position: float) -> float:
        nonlocal previous
        velocity = 0.0 if previous is None else (position - previous) / period
        previous = position
        return velocity

    return step


def _start_average(setup: EstimatorSetup) -> Estimate:
    length, span = setup.whole("window"), setup.whole("window") * setup.period
    window: list[float] = []  # a ring, `at` its oldest entry; filled by the first call
    at = 0

    def step(position: float) -> float:
        nonlocal window, at
        if not window:
            window = [position] * length
        oldest, window[at] = window[at], position
        at = (at + 1) % length
        return (position - oldest) / span

    return step


def _average_weights(length: int, period: float) -> Matrix:
    weights = np.zeros(length + 1)
    weights[0], weights[-1] = 1.0 / (length * period), -1.0 / (length * period)
    return weights


def _start_smoothed(period: float, pole: float, order: int) -> Estimate:
    """Return a step of the low-pass, applied `order` times."""
    previous: float | None = None
    stages = [0.0] * order
    share = 1.0 - pole

    def step(position: float) -> float:
        nonlocal previous
        velocity = 0.0 if previous is None else (position - previous) / period
        previous = position
        for stage, before in enumerate(stages):
            velocity = stages[stage] = pole * before + share * velocity
        return velocity

    return step


def _smoothed(period: float, pole: float, order: int) -> StateSpace:
    """Return the low-pass as a linear system; its states are the previous position, then the stages."""
    # A stage takes the present output of the stage before it: `through` and `direct` are that output from the states
    # and from the position.
    share = 1.0 - pole
    a = np.zeros((order + 1, order + 1))
    b, through, direct = np.zeros((order + 1, 1)), np.zeros(order + 1), 1.0 / period
    b[0], through[0] = 1.0, -1.0 / period
    for stage in range(1, order + 1):
        through, direct = share * through, share * direct
        through[stage] = pole
        a[stage], b[stage] = through, direct
    return StateSpace(a, b, through[None].copy(), np.array([[direct]]))


def _pole(setup: EstimatorSetup) -> float:
    return POLES[setup.word("mapping")](setup.number("tau"), setup.period)


def _check_mapping(setup: EstimatorSetup) -> None:
    mapping = setup.word("mapping")
    if not abs(_pole(setup)) < 1.0:
        raise UsageError(
            f"filtered-derivative: tau={exactly(setup.number('tau'))} s by the {mapping} mapping is unstable at a "
            f"period of {exactly(setup.period)} s; it needs {LIMITS[mapping](setup.period)}"
        )


BACKWARD_DIFFERENCE = Estimator(
    "backward-difference",
    "motion in a period divided by the period",
    start=_start_backward,
    system=lambda setup: shift_register(_average_weights(1, setup.period)),
    noise_gain=lambda setup: math.sqrt(2.0) / setup.period,
    delay=lambda setup: 0.5 * setup.period,
)
MOVING_AVERAGE = Estimator(
    "moving-average",
    "mean of the last differences (FIR)",
    start=_start_average,
    system=lambda setup: shift_register(_average_weights(setup.whole("window"), setup.period)),
    noise_gain=lambda setup: math.sqrt(2.0) / (setup.whole("window") * setup.period),
    delay=lambda setup: 0.5 * setup.whole("window") * setup.period,
    parameters=(Parameter("window", 8.0, "differences in the mean", lowest=1.0, highest=256.0, is_whole=True),),
)
LOW_PASS = Estimator(
    "low-pass",
    "differences through a recursive low-pass filter (IIR)",
    start=lambda setup: _start_smoothed(setup.period, setup.number("pole"), setup.whole("order")),
    system=lambda setup: _smoothed(setup.period, setup.number("pole"), setup.whole("order")),
    delay=lambda setup: (
        setup.period * (0.5 + setup.whole("order") * setup.number("pole") / (1.0 - setup.number("pole")))
    ),
    parameters=(
        Parameter("pole", 0.8, "share of the previous velocity that is kept", highest=0.9999),
        Parameter("order", 1.0, "number of passes", lowest=1.0, highest=8.0, is_whole=True),
    ),
)
FILTERED_DERIVATIVE = Estimator(
    "filtered-derivative",
    "s/(τs + 1), discretised",
    start=lambda setup: _start_smoothed(setup.period, _pole(setup), 1),
    system=lambda setup: _smoothed(setup.period, _pole(setup), 1),
    noise_gain=lambda setup: (1.0 - _pole(setup)) / setup.period * math.sqrt(2.0 / (1.0 + _pole(setup))),
    delay=lambda setup: setup.period * (0.5 + _pole(setup) / (1.0 - _pole(setup))),
    parameters=(
        Parameter("tau", 0.002, "time constant", "s", highest=10.0),
        Parameter("mapping", "exact", "discretisation of s", choices=tuple(POLES)),
    ),
    check=_check_mapping,
)
ESTIMATORS = (BACKWARD_DIFFERENCE, MOVING_AVERAGE, LOW_PASS, FILTERED_DERIVATIVE)

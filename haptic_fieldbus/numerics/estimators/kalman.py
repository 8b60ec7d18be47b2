"""Stationary Kalman filters of position: constant velocity (α–β) and constant acceleration (α–β–γ).

The model has steps of T. In the filter of constant velocity an unknown constant acceleration w acts over each period;
in the filter of constant acceleration the acceleration changes by an unknown w at the beginning of each period. w is
white with σ_w [m/s² or rad/s²]. The position is measured with white noise σ_x, about D/√12 for an encoder of count D.
The gains depend on one number, the tracking index λ = σ_w·T²/σ_x: a small index trusts the model, a large index the
measurement. The gains of a Kalman filter settle to constants, and this filter uses the constants from the start:

    prediction  x⁻ = x + T·v + T²/2·a,  v⁻ = v + T·a,  a⁻ = a
    correction  by the residual r = y − x⁻:  x = x⁻ + α·r,  v = v⁻ + β/T·r,  a = a⁻ + γ/T²·r

With s = √(1 − α) both filters have β = 2(1 − s)². Constant velocity: λ = 2(1 − s)²/s, γ = 0. Constant acceleration:
λ = 2(1 − s)³/(s·(1 + s)), γ = 2(1 − s)³/(1 + s).

Reference: Kalata, IEEE Trans. Aerospace and Electronic Systems 20(2), 1984, 174, doi:10.1109/TAES.1984.310438.
"""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter
from haptic_fieldbus.numerics.linear import StateSpace

BISECTIONS = 200
"""More than enough to reach neighbouring floats."""

Gains = tuple[float, float, float]
"""(α, β, γ): corrections of position, velocity times T and acceleration times T² per unit of residual."""


def velocity_gains(index: float) -> Gains:
    """Return (α, β, 0) of the constant-velocity filter; s solves 2s² − (4 + λ)s + 2 = 0."""
    half = 4.0 + index
    # The smaller root, written without a difference that would lose digits for large λ.
    s = 4.0 / (half + math.sqrt(index * (8.0 + index)))
    return (1.0 - s * s, 2.0 * (1.0 - s) ** 2, 0.0)


def acceleration_gains(index: float) -> Gains:
    """Return (α, β, γ) of the constant-acceleration filter; s is found by bisection of a falling function."""
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        s = 0.5 * (low + high)
        low, high = (s, high) if 2.0 * (1.0 - s) ** 3 > index * s * (1.0 + s) else (low, s)
    return (1.0 - s * s, 2.0 * (1.0 - s) ** 2, 2.0 * (1.0 - s) ** 3 / (1.0 + s))


GainsOf = Callable[[float], Gains]


def _start(setup: EstimatorSetup, gains_of: GainsOf) -> Estimate:
    """Return a step of the filter."""
    # v and a are kept as v·T and a·T², moves per period, so that the period appears only in the result.
    alpha, beta, gamma = gains_of(setup.number("index"))
    period = setup.period
    x: float | None = None
    v = a = 0.0

    def step(position: float) -> float:
        nonlocal x, v, a
        if x is None:
            x = position
        predicted = x + (v + 0.5 * a)
        residual = position - predicted
        x, v, a = predicted + alpha * residual, v + a + beta * residual, a + gamma * residual
        return v / period

    return step


def _system(setup: EstimatorSetup, gains_of: GainsOf) -> StateSpace:
    """Return the filter as a linear system with the states (x, v·T, a·T²) after the correction."""
    gains = np.array(gains_of(setup.number("index")))[:, None]
    predict = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    states = 3 if gains[2, 0] else 2  # with γ = 0 the acceleration stays 0 and is no state
    a = (predict - gains @ predict[:1])[:states, :states]
    b = gains[:states]
    return StateSpace(a, b, a[1:2] / setup.period, b[1:2] / setup.period)


def _noise_gain(setup: EstimatorSetup) -> float:
    """Return √(2β²/(α·(4 − 2α − β)))/T, from the variance reduction ratio of the constant-velocity filter."""
    alpha, beta, _ = velocity_gains(setup.number("index"))
    return math.sqrt(2.0 / (alpha * (4.0 - 2.0 * alpha - beta))) * beta / setup.period


def _delay(setup: EstimatorSetup) -> float:
    """Return T·(α/β − ½), the velocity error of the constant-velocity filter at unit acceleration."""
    alpha, beta, _ = velocity_gains(setup.number("index"))
    return setup.period * (alpha / beta - 0.5)


INDEX = Parameter("index", 0.1, "tracking index σ_w·T²/σ_x", lowest=1e-6, highest=1e6)
ESTIMATORS = (
    Estimator(
        "kalman-velocity",
        "stationary Kalman filter, constant velocity (α–β)",
        start=lambda setup: _start(setup, velocity_gains),
        system=lambda setup: _system(setup, velocity_gains),
        noise_gain=_noise_gain,
        delay=_delay,
        parameters=(INDEX,),
    ),
    Estimator(
        "kalman-acceleration",
        "stationary Kalman filter, constant acceleration (α–β–γ)",
        start=lambda setup: _start(setup, acceleration_gains),
        system=lambda setup: _system(setup, acceleration_gains),
        delay=lambda setup: 0.0,
        parameters=(INDEX,),
    ),
)

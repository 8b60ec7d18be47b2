"""Stationary Kalman filters of position: constant velocity (α–β) and constant acceleration (α–β–γ).

Model, in steps of T: an unknown constant acceleration w acts over each period (constant velocity), or the acceleration
changes by an unknown w at its begin (constant acceleration); w is white with σ_w [m/s² or rad/s²], the position is
measured with white noise σ_x, for an encoder about D/√12. Everything depends on one number, the tracking index
λ = σ_w·T²/σ_x: small trusts the model, large the measurement. The gains settle to constants, and the filter uses those
from the start:

    prediction  x⁻ = x + T·v + T²/2·a,  v⁻ = v + T·a,  a⁻ = a
    correction  by the residual r = y − x⁻:  x = x⁻ + α·r,  v = v⁻ + β/T·r,  a = a⁻ + γ/T²·r

With s = √(1 − α), β = 2(1 − s)² in both; constant velocity λ = 2(1 − s)²/s, γ = 0; constant acceleration
λ = 2(1 − s)³/(s·(1 + s)), γ = 2(1 − s)³/(1 + s).
Kalata, IEEE Trans. Aerospace and Electronic Systems 20(2), 1984, 174, doi:10.1109/TAES.1984.310438.
"""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter
from haptic_fieldbus.numerics.linear import StateSpace

BISECTIONS = 200

Gains = tuple[float, float, float]
"""Corrections of position, of velocity times T, of acceleration times T², per unit of residual."""


def velocity_gains(index: float) -> Gains:
    """(α, β, 0) of the constant-velocity filter; s solves 2s² − (4 + λ)s + 2 = 0."""
    half = 4.0 + index
    s = 4.0 / (half + math.sqrt(index * (8.0 + index)))
    return (1.0 - s * s, 2.0 * (1.0 - s) ** 2, 0.0)


def acceleration_gains(index: float) -> Gains:
    """(α, β, γ) of the constant-acceleration filter; s by bisection of a function that only falls."""
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        s = 0.5 * (low + high)
        low, high = (s, high) if 2.0 * (1.0 - s) ** 3 > index * s * (1.0 + s) else (low, s)
    return (1.0 - s * s, 2.0 * (1.0 - s) ** 2, 2.0 * (1.0 - s) ** 3 / (1.0 + s))


GainsOf = Callable[[float], Gains]


def _start(setup: EstimatorSetup, gains_of: GainsOf) -> Estimate:
    """Works with the deviation of the prediction from the position: v and a in ways per period."""
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
    """States (x, v·T, a·T²) after the correction."""
    gains = np.array(gains_of(setup.number("index")))[:, None]
    predict = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    states = 3 if gains[2, 0] else 2
    a = (predict - gains @ predict[:1])[:states, :states]
    b = gains[:states]
    return StateSpace(a, b, a[1:2] / setup.period, b[1:2] / setup.period)


def _noise_gain(setup: EstimatorSetup) -> float:
    """Of the constant-velocity filter: √(2β²/(α·(4 − 2α − β)))/T, its variance reduction ratio."""
    alpha, beta, _ = velocity_gains(setup.number("index"))
    return math.sqrt(2.0 / (alpha * (4.0 - 2.0 * alpha - beta))) * beta / setup.period


def _delay(setup: EstimatorSetup) -> float:
    """Of the constant-velocity filter: its error in velocity at unit acceleration, T·(α/β − ½)."""
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

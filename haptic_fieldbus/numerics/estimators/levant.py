"""Levant's robust exact differentiator, discretised implicitly.

In continuous time, with e = x̂ − x, it is x̂′ = v̂ − λ1·√L·√|e|·sign(e), v̂′ = −λ0·L·sign(e). v̂ equals the velocity
exactly, after a finite time, while the acceleration stays below L (Levant, Automatica 34(3), 1998, 379,
doi:10.1016/S0005-1098(97)00209-4, which gives λ1 = 1.5, λ0 = 1.1). In explicit steps the sign chatters for ever, with a
velocity error of about L·T. In implicit steps the sign at e = 0 is any value from −1 to 1, chosen by the equation, and
there is no chatter (Acary, Brogliato, Systems & Control Letters 59(5), 2010, 284,
doi:10.1016/j.sysconle.2010.03.002). With b = x̂ + T·v̂ − x the new error solves

    e = b − T·λ1·√L·√|e|·ξ − T²·λ0·L·ξ,  ξ ∈ Sgn(e)

There are two cases:

- |b| ≤ T²·λ0·L: e = 0, the estimate is on the position, and v̂ changes by −b/T.
- Otherwise ξ = sign(b), and √|e| is the positive root of |e| + T·λ1·√L·√|e| = |b| − T²·λ0·L; v̂ changes by −T·λ0·L·ξ.

v̂ therefore never changes by more than λ0·L·T in a period, which filters the steps of the encoder. `lipschitz` is L, a
bound of the handle's acceleration. If it is too small, v̂ stays far behind a fast motion and virtual damping is lost; if
it is too large, the estimator is the backward difference.
"""

import math

from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter

ROOT_GAIN, SIGN_GAIN = 1.5, 1.1
"""λ1 and λ0."""


def _start(setup: EstimatorSetup) -> Estimate:
    period, lipschitz = setup.period, setup.number("lipschitz")
    change = SIGN_GAIN * lipschitz * period
    within, half_root = change * period, 0.5 * period * ROOT_GAIN * math.sqrt(lipschitz)
    x: float | None = None
    v = 0.0

    def step(position: float) -> float:
        nonlocal x, v
        if x is None:
            x = position
        ahead = x + period * v - position
        if -within <= ahead <= within:
            x, v = position, v - ahead / period
        else:
            root = math.sqrt(half_root * half_root + abs(ahead) - within) - half_root
            sign = ahead / abs(ahead)  # unlike `copysign`, this passes not-a-number on
            x, v = position + sign * root * root, v - sign * change
        return v

    return step


ESTIMATORS = (
    Estimator(
        "levant",
        "robust exact differentiator, implicit",
        start=_start,
        follows=lambda setup: setup.number("lipschitz"),
        parameters=(
            Parameter("lipschitz", 50.0, "bound of the acceleration", "m/s² or rad/s²", lowest=1e-6, highest=1e9),
        ),
    ),
)

"""Levant's robust exact differentiator, discretised implicitly.

Continuous: with e = x̂ − x, x̂′ = v̂ − λ1·√L·√|e|·sign(e), v̂′ = −λ0·L·sign(e); v̂ is the velocity exactly and in finite
time while the acceleration stays below L (Levant, Automatica 34(3), 1998, 379, doi:10.1016/S0005-1098(97)00209-4, which
gives λ1 = 1.5, λ0 = 1.1). Stepped explicitly the sign chatters for ever, with a velocity error of about L·T. Implicit
in e, the sign becomes a set that the step picks from, and there is no chatter (Acary, Brogliato, Systems & Control
Letters 59(5), 2010, 284, doi:10.1016/j.sysconle.2010.03.002). With b = x̂ + T·v̂ − x the new error solves

    e = b − T·λ1·√L·√|e|·ξ − T²·λ0·L·ξ,  ξ ∈ Sgn(e)

- |b| ≤ T²·λ0·L: e = 0, the estimate is on the position, and v̂ += −b/T
- else ξ = sign(b) and √|e| is the positive root of e + T·λ1·√L·√e = |b| − T²·λ0·L; v̂ −= T·λ0·L·ξ

So v̂ never changes by more than λ0·L·T a period: that is what filters the encoder. `lipschitz` is L, a bound of the
handle's acceleration: too small and fast motions are missed, too large and it is the backward difference.
"""

import math

from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup, Parameter

ROOT_GAIN, SIGN_GAIN = 1.5, 1.1
"""λ1, λ0."""


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
            sign = ahead / abs(ahead)  # of a number that is none, none
            x, v = position + sign * root * root, v - sign * change
        return v

    return step


ESTIMATORS = (
    Estimator(
        "levant",
        "robust exact differentiator, implicit",
        start=_start,
        parameters=(
            Parameter("lipschitz", 50.0, "bound of the acceleration", "m/s² or rad/s²", lowest=1e-6, highest=1e9),
        ),
    ),
)

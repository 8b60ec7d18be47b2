"""Passivity with any hand: the largest stiffness, and forces that are not linear."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from haptic_fieldbus.margins.linear import LARGEST, EnvironmentOf
from haptic_fieldbus.margins.plant import Plant, check_times
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import parallel
from haptic_fieldbus.numerics.passivity import SMALLEST_ANGLE, damping_needed, frequency_response, hold, largest_gain
from haptic_fieldbus.numerics.sampled import TACHOMETER

# Passivity of forces that are not linear, by bounds on their increments; the proof.
#
# A law returns F_k at the sample t_k. The force f(t) of the motor is F_k from t_k + td until t_{k+1} + td, behind a
# torque loop of the lag λ. The law must keep two bounds for every motion:
#
# 1. Its energy without delay has the bound Σ F_k·Δx_k ≤ S + ½·L·Σ Δx_k², with a bounded S and Δx_k = x_{k+1} − x_k.
# 2. It does not jump: |F_k − F_{k−1}| ≤ L·|Δx_{k−1}|.
#
# A force of the position alone keeps both if its slope, of either sign, is never above L: F(x_k)·Δx_k exceeds the loss
# of its potential, ∫F dx, by at most ½·L·Δx_k². A spring of stiffness L to an anchor that only moves towards the handle
# (friction that sticks) keeps both too: moving the anchor loses energy. Both bounds still hold when the force is cut at
# the effort limit: the slope of the cut force is at most L, and with a cut spring to an anchor a, V = −∫ₐˣ cut(G(ξ) −
# L·(ξ − a)) dξ − ∫ᵃ cut(G(ξ)) dξ still falls when the anchor moves towards the handle, by L·|da| times the part of the
# stretch that is not cut.
#
# For t in period j, f(t) = F_j + (f(t) − F_j). By bound 1 the first part gives at most S + ½·L·Σ(∫_j |v|)². The second
# part is at most L times the path of N(t) whole periods, where N(t) is the age of f(t) beyond that of F_j. Both
# together are an integral form of |v| with a positive, T-periodic kernel, and by 2·a·b ≤ a² + b² it is bounded by its
# largest eigenvalue times ∫v². Because the kernel is positive, the eigenfunction w is positive and has the period T.
# With W = ∫w over a period and c(u) the mean N(t) at the time u of a period, the form is
#
#     L·(½·W² + W·∫c·w),   ∫c = td + λ,
#
# which has the rank 2 and the eigenvalue ½·L·(g + √(g² + S)), g = T/2 + td + λ, S = T²·Var(c): δ·(T − δ) for a fraction
# δ of a period without lag. This is the limit of a plain spring of stiffness L (`passivity.passive_limit`), so the
# bound is sharp. Without the exact S, td rounded up to whole periods bounds it: b ≥ L·(T/2 + td) + L·λ.
#
# A part that depends on the velocity changes the force by at most B·|v̂_k|. With the backward difference, |v̂_k|·T is
# at most the path of the period before, which adds B·W²/T to the form. The damping needed of the device is then
#
#     b ≥ ½·(L·g + B + √((L·g + B)² + L²·S)).
#
# For another linear estimator B is multiplied by the sum of the moduli of its weights on the moves of single periods.
#
# Coulomb friction fc of the device covers the rounding of an encoder of step D, where fc ≥ L·D/2 + B·D/T: a position is
# wrong by at most D/2.


@dataclass(frozen=True)
class Increments:
    """Bounds of a law: `slope` L [N/m or N·m/rad], `damping` B [N·s/m or N·m·s/rad] with the estimator's weights."""

    slope: float
    damping: float

    def damping_needed(self, period: float, delay: float, lag: float) -> float:
        """Return the damping of a device that is passive with this law [N·s/m or N·m·s/rad]; times in s."""
        if not math.isfinite(self.slope + self.damping):
            return math.inf
        along = self.slope * (0.5 * period + delay + lag) + self.damping
        # A contact without an end is as steep as a float can be, and its square is beyond all floats.
        return 0.5 * (along + math.hypot(along, self.slope * math.sqrt(spread_of(period, delay, lag))))

    def rounding_is_bridged(self, plant: Plant, period: float) -> bool:
        """Return whether Coulomb friction absorbs the energy that the rounding of the encoder may give."""
        return plant.coulomb >= (0.5 * self.slope + self.damping / period) * plant.resolution


@lru_cache(maxsize=64)
def spread_of(period: float, delay: float, lag: float) -> float:
    """Return S of the theory [s²]; times in s."""
    return float(hold(np.array([SMALLEST_ANGLE]), period, delay, lag).spread[0])


@lru_cache(maxsize=64)
def weight(estimator: str | None, period: float) -> float:
    """Return the sum of the moduli of an estimator's weights on single moves; ∞ for one that is not linear."""
    if estimator is None or estimator == TACHOMETER:
        return 1.0
    from haptic_fieldbus.numerics import estimators  # only scenes that use velocity need it

    if estimators.linear_stand_in(estimator) is not None:
        return math.inf
    form = estimators.linear_form(estimator, period)
    # A step of the position is one move; the response in each period after it is the weight on that move.
    state, total, quiet = form.b[:, 0], abs(float(form.d[0, 0])), 0
    for _ in range(MOST_WEIGHTS):
        part = abs(float(form.c[0] @ state + form.d[0, 0]))
        total += part
        state = form.a @ state + form.b[:, 0]
        quiet = quiet + 1 if part < FADED * total else 0
        if quiet == QUIET:
            return total * period
    return math.inf


MOST_WEIGHTS, QUIET, FADED = 200_000, 400, 1e-12
"""Most periods of an estimator that are summed, and how many weights in a row must be below a share of the sum at its
end. An estimator that is slower has no sum."""


def sum_of_bounds(found: Iterable[tuple[float, float] | None]) -> tuple[float, float]:
    """Return the sums of slopes and dampings; ∞ when one of them has no bound."""
    slopes = [(math.inf, math.inf) if each is None else each for each in found]
    return sum(each[0] for each in slopes), sum(each[1] for each in slopes)


# Largest stiffness that is passive with any hand; the theory is in `numerics.passivity`.

PROBES = np.array([1e-3, 0.1, 1.0, math.pi])
"""Angles [rad] at which the dependence of an environment on its stiffness is checked."""
LOSSLESS = 1e-9
"""Loss per period below which a mode counts as undamped."""


def passive_limit(plant: Plant, period: float, delay: float) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which a spring is passive; `period` and `delay` in s.

    K = 2·b/(g + √(g² + S)), where g = T/2 + td + λ is the mean age of the motor's force and S its spread within a
    period, δ·(T − δ) without a torque loop. Low frequencies need the most damping and decide. Raises UsageError for
    impossible times.
    """
    check_times(period, delay)
    centre = 0.5 * period + delay + plant.torque_lag
    return 2.0 * plant.damping / (centre + math.sqrt(centre**2 + spread_of(period, delay, plant.torque_lag)))


def passive_limit_of(plant: Plant, period: float, delay: float, environment_of: EnvironmentOf, stable: float) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which an environment is passive; `stable` bounds a search for it.

    0 with a tachometer, and for an environment with an undamped mode: at its resonance the delay makes the force act
    against any damping.
    """
    if plant.tachometer:
        return 0.0
    base, one = environment_of(0.0), environment_of(1.0)
    if _is_proportional(environment_of):  # then the limit has a closed form at each angle
        added = parallel([one, sampled.scaled(base, -1.0)])
        return largest_gain(base, added, plant.damping, period, delay, plant.torque_lag)

    def passive(stiffness: float) -> bool:
        environment = environment_of(stiffness)
        if sampled.spectral_radius(environment.a) > 1.0 - LOSSLESS:
            return False
        return damping_needed(environment, period, delay, plant.torque_lag) <= plant.damping

    return searched(passive, plant.mass / period**2 + plant.damping / period, stable, smallest=1e-6, precision=1e-6)


def searched(
    passive: Callable[[float], bool], scale: float, stable: float, *, smallest: float, precision: float
) -> float:
    """Return the largest stiffness before `passive` first fails on the way up, at most `stable`.

    0 when the smallest stiffness is not passive. The search goes from `smallest` to `LARGEST` times `scale`, an
    m/T² + b/T, to a relative precision of `precision`.
    """
    low, high, largest = 0.0, smallest * min(stable, scale), min(stable, LARGEST * scale)
    while passive(high):
        if high >= largest:
            return stable
        low, high = high, min(4.0 * high, largest)
    while low and high - low > precision * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passive(middle) else (low, middle)
    return low


def _is_proportional(environment_of: EnvironmentOf) -> bool:
    """Return True when the force is a fixed part plus the stiffness times another part, and no mode is undamped."""
    environments = [environment_of(stiffness) for stiffness in (0.0, 1.0, 2.0)]
    if any(sampled.spectral_radius(environment.a) > 1.0 - LOSSLESS for environment in environments):
        return False
    none, one, two = (frequency_response(environment, PROBES) for environment in environments)
    return bool(np.abs(two - 2.0 * one + none).max() <= 1e-9 * np.abs(two - none).max())

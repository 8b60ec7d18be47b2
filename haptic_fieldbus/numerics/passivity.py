"""Passivity of a sampled force behind a delayed hold and a torque loop, for any hand.

The force F_k = H x_k is held from t_k + td until t_{k+1} + td, td = n·T + δ, and passes a torque loop 1/(λ·s + 1). A
device of damping b is passive with it when b·∫v² ≥ ∫f·v for every motion v. At a frequency θ = ωT, v has free parts at
ω and at all its aliases. Only two parts of v count: the constant speed of each period, which appears in the samples,
and the part along the force within a period, which does not. They leave a 2 × 2 Hermitian form, whose largest
eigenvalue is the damping needed,

    b = ½·(Re(H·P) + √(|H|²·S + Re(H·P)²)).

P(z) is the displacement per period of a handle of damping 1 moved by this force, divided by z − 1. S is the variance of
the force within a period, divided by |1 − z⁻¹|² and multiplied by T². Without lag S = δ·(T − δ). Without delay and lag
S = 0 and P = T/(z − 1), which is the condition of Colgate & Schenkel (J. Robotic Systems 14(1), 1997, 37),
b > T/2/(1 − cos θ)·Re{(1 − z⁻¹)·H}.

For F_k = zᵏ the motor's force within a period is z⁻ⁿ·(1 + (1 − z⁻¹)·φ(t)). Without lag, φ is −1 up to δ and 0 after it.
With lag it consists of exponentials.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import split_delay

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
SMALLEST_ANGLE = 1e-5
"""Smallest θ [rad] of a sweep, in place of 0."""
REFINED = 41
"""Number of points between the neighbours of the worst angle, in each of four refinements."""


@dataclass(frozen=True, eq=False)
class Hold:
    """P and S of the delayed hold and torque loop at angles θ, shape (n,) each."""

    displacement: Complex
    """P [s]"""
    spread: Array
    """S [s²]"""


def hold(angle: Array, period: float, delay: float, lag: float = 0.0) -> Hold:
    """Return P [s] and S [s²] of the module's theory at angles (n,) [rad]; times in s."""
    whole, fraction = split_delay(delay, period)
    z = np.exp(1j * angle)
    mean, square = _within(z, period, fraction, lag)
    # The first two terms are 1/(z − 1), written without the difference that loses digits at small angles.
    path = -0.5 - 0.5j / np.tan(0.5 * angle) + mean / z
    spread: Array = period**2 * np.maximum(square - np.abs(mean) ** 2, 0.0)
    return Hold(period * path * np.exp(-1j * whole * angle), spread)


def _within(z: Complex, period: float, fraction: float, lag: float) -> tuple[Complex, Array]:
    """Return the means of φ and of |φ|² over a period."""
    early, late = fraction / period, 1.0 - fraction / period
    if not lag:
        return np.full_like(z, -early), np.full(z.shape, early)
    rate = period / lag
    gone, gone_late = -math.expm1(-early * rate), -math.expm1(-late * rate)
    # φ is −1 + first·e^(−t/λ) before δ and second·e^(−(t − δ)/λ) after it. Continuity at δ, and from one period to the
    # next with a factor z, gives both amplitudes.
    first = -math.exp(-late * rate) / (z - math.exp(-rate))
    second = first * (1.0 - gone) - 1.0
    mean = -early + (first * gone + second * gone_late) / rate
    square = (
        early
        - 2.0 * first.real * gone / rate
        + 0.5 * (np.abs(first) ** 2 * gone * (2.0 - gone) + np.abs(second) ** 2 * gone_late * (2.0 - gone_late)) / rate
    )
    return mean, square


def frequency_response(environment: StateSpace, angle: Array) -> Complex:
    """Return H(e^{jθ}) of a discrete environment x_k → F_k at angles (n,) [rad], shape (n,)."""
    return frequency_responses(environment, angle)[:, 0, 0]


def frequency_responses(environment: StateSpace, angle: Array) -> Complex:
    """Return H(e^{jθ}) of an environment with several inputs and outputs at angles (n,), shape (n, n_out, n_in)."""
    z = np.exp(1j * angle)
    systems = z[:, None, None] * np.eye(environment.order) - environment.a
    states = np.linalg.solve(systems.astype(np.complex128), environment.b[None].astype(np.complex128))
    return np.asarray(environment.c @ states + environment.d, dtype=np.complex128)


def damping_needed(environment: StateSpace, period: float, delay: float, lag: float = 0.0) -> float:
    """Return the device damping [N·s/m or N·m·s/rad] with which the environment is passive, by frequency sweep."""

    def needed(angle: Array) -> Array:
        return _needed(frequency_response(environment, angle), hold(angle, period, delay, lag))

    return worst(needed, environment)


def _needed(force: Complex, behind: Hold) -> Array:
    along = (force * behind.displacement).real
    return np.asarray(0.5 * (along + np.sqrt(np.abs(force) ** 2 * behind.spread + along**2)))


def largest_gain(
    base: StateSpace, added: StateSpace, damping: float, period: float, delay: float, lag: float = 0.0
) -> float:
    """Return the largest K for which `base` + K·`added` is passive on a device of this damping.

    0 when K = 0 is not passive, ∞ when every K is. The Hermitian form is quadratic in K, so the limit at each angle has
    a closed form; the smallest over all angles counts.
    """

    # The reciprocal 1/K of the limit, because it is 0 without a limit and `worst` finds a maximum.
    def reciprocal(angle: Array) -> Array:
        h, one = frequency_response(base, angle), frequency_response(added, angle)
        behind = hold(angle, period, delay, lag)
        squared = np.abs(one) ** 2 * behind.spread
        mixed = 2.0 * behind.spread * (h * one.conj()).real + 4.0 * damping * (one * behind.displacement).real
        rest = np.abs(h) ** 2 * behind.spread + 4.0 * damping * ((h * behind.displacement).real - damping)
        root = mixed + np.sqrt(np.maximum(mixed**2 - 4.0 * squared * rest, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.where(rest < 0.0, np.maximum(root, 0.0) / (-2.0 * rest), math.inf))

    if not damping:
        return 0.0
    largest = worst(reciprocal, added)
    return 1.0 / largest if largest else math.inf


def worst(value: Callable[[Array], Array], environment: StateSpace | None = None) -> float:
    """Return the largest value over 0 < θ ≤ π, by a sweep and four refinements around its maximum.

    `value` maps angles (n,) [rad] to values (n,). The sweep includes the resonances of the environment, because a sharp
    resonance could lie between the points of a fixed sweep.
    """
    sweep = [np.geomspace(SMALLEST_ANGLE, 0.1, 100), np.linspace(0.1, math.pi, 400)[1:]]
    parts = sweep if environment is None else [*sweep, _resonances(environment)]
    angle = np.unique(np.concatenate(parts), return_counts=True)[0]  # without the counts it imports numpy.ma
    for _ in range(5):
        found = value(angle)
        at = int(found.argmax())
        low, high = angle[max(at - 1, 0)], angle[min(at + 1, len(angle) - 1)]
        angle = np.linspace(low, high, REFINED)
    return float(found.max())


def _resonances(environment: StateSpace) -> Array:
    """Return angles around the resonance of each mode, spread by the width of the resonance."""
    modes = np.linalg.eigvals(environment.a)
    turning = modes[np.abs(modes.imag) > 0.0]
    width = np.maximum(np.abs(1.0 - np.abs(turning)), 1e-9)
    around = np.abs(np.angle(turning))[:, None] + width[:, None] * np.linspace(-4.0, 4.0, 33)
    return np.asarray(around[(around > SMALLEST_ANGLE) & (around < math.pi)], dtype=np.float64)

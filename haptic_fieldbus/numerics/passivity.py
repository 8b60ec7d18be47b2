"""Passivity of a sampled force behind a delayed hold and a torque loop, for any hand.

The force F_k = H x_k is held from t_k + td until t_{k+1} + td, td = n·T + δ, and passes a torque loop 1/(λ·s + 1). A
device of damping b is passive with it when b·∫v² ≥ ∫f·v for every motion v. At a frequency θ = ωT, v has free parts at
ω and at all its aliases, but only two of them matter: the constant speed of each period that the samples see, and the
part along the force within a period that they do not. What remains is a 2 × 2 Hermitian form whose largest eigenvalue
is the damping needed,

    b = ½·(Re(H·P) + √(|H|²·S + Re(H·P)²)),

with P(z) the displacement per period of a handle of damping 1 that this force moves, over z − 1, and S the variance of
the force within a period, over |1 − z⁻¹|² and times T². Without delay and lag S = 0 and P = T/(z − 1): the condition of
Colgate & Schenkel (J. Robotic Systems 14(1), 1997, 37), b > T/2/(1 − cos θ)·Re{(1 − z⁻¹)·H}. Without lag S = δ·(T − δ).

For F_k = zᵏ the motor's force within a period is z⁻ⁿ·(1 + (1 − z⁻¹)·φ(t)); φ is −1 up to δ and 0 after it without a
lag, and exponentials with one.
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
REFINED = 41
"""Points between the neighbours of the worst angle, in each of four rounds."""


@dataclass(frozen=True, eq=False)
class Hold:
    """The delayed hold and torque loop at angles θ, shape (n,)."""

    displacement: Complex
    """P [s]"""
    spread: Array
    """S [s²]"""


def hold(angle: Array, period: float, delay: float, lag: float = 0.0) -> Hold:
    """P and S of the module's theory; times in s."""
    whole, fraction = split_delay(delay, period)
    z = np.exp(1j * angle)
    mean, square = _within(z, period, fraction, lag)
    path = -0.5 - 0.5j / np.tan(0.5 * angle) + mean / z
    spread: Array = period**2 * np.maximum(square - np.abs(mean) ** 2, 0.0)
    return Hold(period * path * np.exp(-1j * whole * angle), spread)


def _within(z: Complex, period: float, fraction: float, lag: float) -> tuple[Complex, Array]:
    """Means of φ and of |φ|² over a period."""
    early, late = fraction / period, 1.0 - fraction / period
    if not lag:
        return np.full_like(z, -early), np.full(z.shape, early)
    rate = period / lag
    gone, gone_late = -math.expm1(-early * rate), -math.expm1(-late * rate)
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
    """H(e^{jθ}) of a discrete environment x_k → F_k, shape (n,)."""
    return frequency_responses(environment, angle)[:, 0, 0]


def frequency_responses(environment: StateSpace, angle: Array) -> Complex:
    """The same with several inputs and outputs, shape (n, n_out, n_in)."""
    z = np.exp(1j * angle)
    systems = z[:, None, None] * np.eye(environment.order) - environment.a
    states = np.linalg.solve(systems.astype(np.complex128), environment.b[None].astype(np.complex128))
    return np.asarray(environment.c @ states + environment.d, dtype=np.complex128)


def damping_needed(environment: StateSpace, period: float, delay: float, lag: float = 0.0) -> float:
    """The device damping [N·s/m or N·m·s/rad] with which the sampled environment is passive, by frequency sweep."""

    def needed(angle: Array) -> Array:
        return _needed(frequency_response(environment, angle), hold(angle, period, delay, lag))

    return worst(needed, environment)


def _needed(force: Complex, behind: Hold) -> Array:
    along = (force * behind.displacement).real
    needed: Array = 0.5 * (along + np.sqrt(np.abs(force) ** 2 * behind.spread + along**2))
    return needed


def largest_gain(
    base: StateSpace, added: StateSpace, damping: float, period: float, delay: float, lag: float = 0.0
) -> float:
    """The largest K for which `base` + K·`added` is passive on a device of that damping; 0 when K = 0 is not, or ∞.

    The Hermitian form is quadratic in K at each angle, so each gives its K; the smallest counts.
    """

    def reciprocal(angle: Array) -> Array:
        h, one = frequency_response(base, angle), frequency_response(added, angle)
        behind = hold(angle, period, delay, lag)
        squared = np.abs(one) ** 2 * behind.spread
        mixed = 2.0 * behind.spread * (h * one.conj()).real + 4.0 * damping * (one * behind.displacement).real
        rest = np.abs(h) ** 2 * behind.spread + 4.0 * damping * ((h * behind.displacement).real - damping)
        root = mixed + np.sqrt(np.maximum(mixed**2 - 4.0 * squared * rest, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            found: Array = np.where(rest < 0.0, np.maximum(root, 0.0) / (-2.0 * rest), math.inf)
        return found

    if not damping:
        return 0.0
    largest = worst(reciprocal, added)
    return 1.0 / largest if largest else math.inf


def worst(value: Callable[[Array], Array], environment: StateSpace | None = None) -> float:
    """Largest value over 0 < θ ≤ π: a sweep, and four closer looks around its greatest.

    The resonances of the environment are in the sweep: a sharp one lies between the points of any other.
    """
    sweep = [np.geomspace(SMALLEST_ANGLE, 0.1, 100), np.linspace(0.1, math.pi, 400)[1:]]
    angle = np.unique(np.concatenate(sweep if environment is None else [*sweep, _resonances(environment)]))
    for _ in range(5):
        found = value(angle)
        at = int(found.argmax())
        low, high = angle[max(at - 1, 0)], angle[min(at + 1, len(angle) - 1)]
        angle = np.linspace(low, high, REFINED)
    return float(found.max())


def _resonances(environment: StateSpace) -> Array:
    """Angles around each mode, by its own width."""
    modes = np.linalg.eigvals(environment.a)
    turning = modes[np.abs(modes.imag) > 0.0]
    width = np.maximum(np.abs(1.0 - np.abs(turning)), 1e-9)
    around = np.abs(np.angle(turning))[:, None] + width[:, None] * np.linspace(-4.0, 4.0, 33)
    return np.asarray(around[(around > SMALLEST_ANGLE) & (around < math.pi)], dtype=np.float64)

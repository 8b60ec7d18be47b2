"""Springs that relax: parallel branches of spring and damper under a free surface, stepped exactly.

A branch (k, τ) is a Maxwell element: q̇ = (s − q)/τ, its force k·(s − q), where s is the dent of the surface. While s
runs on a straight line from s₀ to s₁ over a step T, with r = T/τ exactly

    q₁ = φ·q₀ + (g − φ)·s₀ + (1 − g)·s₁,    φ = e⁻ʳ,    g = (1 − e⁻ʳ)/r,

all three weights from 0 to 1 and their sum 1: a branch neither explodes nor rings, however much faster than T it is.

The surface. All branches and a spring k₀ carry it together: P(s₁) = k₀·s₁ + Σ k·(s₁ − q₁) rises with s₁ by G = k₀ + Σ
k·g. Touched at the depth d, the surface is at d if P(d) ≥ 0; else it comes back by itself, slower than the tool leaves,
to the s_f with P(s_f) = 0. So s₁ = max(d, s_f), and the push is G·(s₁ − s_f): never below 0. What is stored, k₀·s²/2 +
Σ k·(s − q)²/2, is only ever fed by a push on a moving surface: passive in continuous time.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace


def decay_and_mean(ratio: float) -> tuple[float, float]:
    """(φ, g) of a branch for r = T/τ from 0 to ∞: e⁻ʳ, and its mean over the step."""
    return math.exp(-ratio), -math.expm1(-ratio) / ratio if ratio else 1.0


def bind_surface(rest: float, branches: Sequence[tuple[float, float]], period: float) -> Callable[[float], float]:
    """Depth [m or rad] → push ≥ 0 [N or N·m] of k₀ = `rest` > 0 [N/m] and branches (k [N/m], τ [s]), once a period [s].

    The first call finds it at rest: all branches relaxed. Not-a-number in gives not-a-number out, from then on.
    """
    weights = [(k, *decay_and_mean(period / tau)) for k, tau in branches]
    updates = [(phi, g - phi, 1.0 - g) for _, phi, g in weights]
    stiffnesses = [k for k, _, _ in weights]
    slope = rest + sum(k * g for k, _, g in weights)
    surface: float | None = None
    inner: list[float] = []

    def push(depth: float) -> float:
        nonlocal surface, inner
        if surface is None:
            surface = 0.0 if depth <= 0.0 else depth
            inner = [surface] * len(updates)
            return rest * surface
        left = [phi * q + early * surface for (phi, early, _), q in zip(updates, inner, strict=True)]
        free = sum(map(float.__mul__, stiffnesses, left)) / slope
        surface = free if depth <= free else depth
        inner = [q + late * surface for (_, _, late), q in zip(updates, left, strict=True)]
        return slope * (surface - free)

    return push


def pressed(rest: float, branches: Sequence[tuple[float, float]]) -> StateSpace:
    """The same in sustained contact: states q, inputs (position, velocity), output the force on the tool [N or N·m]."""
    k, tau = np.array(branches, dtype=float).T
    b = np.stack([1.0 / tau, np.zeros(len(tau))], axis=1)
    return StateSpace(np.diag(-1.0 / tau), b, k[None, :], np.array([[-(rest + k.sum()), 0.0]]))

"""Springs that relax: parallel branches of spring and damper under a free surface, stepped exactly.

A branch (k, τ) is a Maxwell element: q̇ = (s − q)/τ with the force k·(s − q), where s is the dent of the surface. When
s follows a straight line from s₀ to s₁ over a step T, the exact solution with r = T/τ is

    q₁ = φ·q₀ + (g − φ)·s₀ + (1 − g)·s₁,    φ = e⁻ʳ,    g = (1 − e⁻ʳ)/r,

All three weights lie between 0 and 1 and their sum is 1. A branch therefore neither explodes nor rings, even when it is
much faster than T.

The surface is carried by all branches and a spring k₀ together. The pressure P(s₁) = k₀·s₁ + Σ k·(s₁ − q₁) rises with
s₁ at the slope G = k₀ + Σ k·g. With the tool at the depth d there are two cases. If P(d) ≥ 0, the surface is at d. If
not, the tool leaves faster than the surface returns, and the surface is at the s_f with P(s_f) = 0. So s₁ = max(d,
s_f), and the push G·(s₁ − s_f) is never below 0.

The stored energy k₀·s²/2 + Σ k·(s − q)²/2 grows only by a push on a moving surface, so the model is passive in
continuous time.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace

# The bristle of the Dahl and LuGre friction models, stepped exactly along the path of the handle.
#
# The stretch z follows dz/dx = 1 − (z/L)·sign(dx), where L is the steady stretch. With L constant, a move Δx in one
# direction gives
#
#     z⁺ = z + (s − z)·(1 − e^(−|Δx|/L)),   s = L·sign(Δx),
#
# independent of the time of the move. z⁺ lies between z and s, so |z| never exceeds the largest L. The explicit step
# z + Δx − z·|Δx|/L explodes when |Δx| > 2·L.
#
# Sampled and held, the force −σ·z creates energy. In one move, it gives at most 1.092·½·σ·Δx² more than the energy
# ½·σ·z² releases. The factor is the largest value of ((z⁺ − z)² + 2·z·(z⁺ − z − Δx))/Δx², found at a reversal with |z|
# = 1.56·L and |Δx| = 1.65·L; a test scans it. A plain spring gives ½·σ·Δx².

SAMPLED_EXCESS = 1.092
"""Largest energy that a held bristle creates, over that of a held spring of the same stiffness."""


def advance(stretch: float, move: float, steady: float) -> float:
    """Return the stretch [m or rad] after a `move` [m or rad] of the handle; the `steady` stretch is above 0."""
    return stretch - (math.copysign(steady, move) - stretch) * math.expm1(-abs(move) / steady)


def bind(stiffness: float, friction: float) -> Callable[[float], float]:
    """Return a step from position [m or rad] to force [N or N·m] of a bristle that is relaxed at its first call.

    `stiffness` is in N/m or N·m/rad; the bristle slides at the constant `friction` [N or N·m].
    """
    stretch, steady = 0.0, friction / stiffness
    before: float | None = None

    def law(position: float) -> float:
        nonlocal stretch, before
        stretch = advance(stretch, position - (position if before is None else before), steady)
        before = position
        return -stiffness * stretch

    return law


def decay_and_mean(ratio: float) -> tuple[float, float]:
    """Return (φ, g) of a branch for `ratio` r = T/τ from 0 to ∞: e⁻ʳ, and its mean over the step."""
    return math.exp(-ratio), -math.expm1(-ratio) / ratio if ratio else 1.0


def bind_surface(rest: float, branches: Sequence[tuple[float, float]], period: float) -> Callable[[float], float]:
    """Return a step, called once a period [s], that maps the depth [m or rad] to the push ≥ 0 [N or N·m].

    `rest` is k₀ > 0 [N/m or N·m/rad], `branches` are pairs (k [N/m or N·m/rad], τ [s]). At the first call all branches
    are relaxed. Not-a-number gives not-a-number from then on.
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
        surface = free if depth <= free else depth  # unlike `max`, this passes not-a-number on
        inner = [q + late * surface for (_, _, late), q in zip(updates, left, strict=True)]
        return slope * (surface - free)

    return push


def pressed(rest: float, branches: Sequence[tuple[float, float]]) -> StateSpace:
    """Return the surface in sustained contact: states q, inputs (position, velocity), output force on the tool.

    With n branches the shapes are a (n, n), b (n, 2), c (1, n), d (1, 2).
    """
    k, tau = np.array(branches, dtype=float).T
    b = np.stack([1.0 / tau, np.zeros(len(tau))], axis=1)
    return StateSpace(np.diag(-1.0 / tau), b, k[None, :], np.array([[-(rest + k.sum()), 0.0]]))

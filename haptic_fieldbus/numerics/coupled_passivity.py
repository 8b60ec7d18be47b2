"""Passivity of coupled axes: sampled forces behind delayed holds and torque loops, for any passive hands on them.

The forces F_k = H x_k, H an n × n matrix, are held and filtered axis by axis as in `passivity`, whose P_i and S_i are
those of axis i here. The devices of damping b_i are passive with them when Σ b_i·∫v_i² ≥ Σ ∫f_i·v_i for all motions.
At a frequency θ = ωT let X be the sampled positions. Each v_i is a constant speed (z − 1)·X_i/T, which the samples see,
and a rest of mean zero, which they do not. Completing the square in the rest, f̃_i/(2·b_i), and dividing by |z − 1|²/T
leaves X*·M·X ≥ 0 with the Hermitian

    M(θ) = diag(b) − ½·(diag(P)·H + H*·diag(P)*) − H*·diag(S/(4·b))·H,    0 < θ ≤ π.

The pair is passive if and only if M ⪰ 0 at every θ and the forces at rest, H(1), are those of a spring that stores:
symmetric, with −H(1) ⪰ 0 (else a slow motion around a loop, or ever further away, takes energy without end). Then no
passive hands make it unstable, be they two or those of one body. Where it fails some motion of all handles together
takes energy for ever; hands that are known to be apart, each passive by itself, may ask for less.

The share s of the dampings that is needed, M ⪰ 0 with s·b in the place of b, is by Schur's complement the largest
eigenvalue of [[A, R*], [R, 0]], A the Hermitian part above and R = ½·diag(√S)·H, rows and columns divided by √b.

For a spring-damper between x1 and n·x2 and equal delays H = −h·g·gᵀ, g = (1, −n), and M ⪰ 0 says no more than that one
device of damping 1/(1/b1 + n²/b2) is passive with h: without delay K·T/2 + |B| ≤ 1/(1/b1 + n²/b2) (Colgate & Schenkel,
J. Robotic Systems 14(1), 1997, 37, for one device), and for equal axes at n = 1 and B = 0, K ≤ b/T: the difference of
the handles meets 2·K.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace, equilibrium
from haptic_fieldbus.numerics.passivity import Array, Complex, frequency_responses, hold, worst
from haptic_fieldbus.numerics.sampled import spectral_radius

LOSSLESS = 1e-9
"""A mode that loses less than this in a period is undamped, and passive with nothing."""
ROUNDING = 1e-9
"""Of the largest force at rest."""


@dataclass(frozen=True)
class PassivityPort:
    """What stands between one force of the environment and the hand [N·s/m, s, s, or rotary]."""

    damping: float
    delay: float
    lag: float = 0.0
    """Of the torque loop."""


def stores(environment: StateSpace) -> bool:
    """Whether its forces at rest are those of a spring whose energy is never below 0."""
    states = equilibrium(environment.a - np.eye(environment.order), environment.b)
    stiffness = -(environment.c @ states + environment.d)
    least = -ROUNDING * float(np.abs(stiffness).max(initial=0.0))
    bent = float(np.abs(stiffness - stiffness.T).max(initial=0.0))
    return bent <= -least and float(np.linalg.eigvalsh(stiffness + stiffness.T).min(initial=0.0)) >= 2.0 * least


def damping_share(environment: StateSpace, ports: Sequence[PassivityPort], period: float) -> float:
    """The share of the devices' dampings that any passive hands need: passive up to 1; ∞ where none is enough."""
    touched = [
        bool(
            any(np.any(part) for part in (environment.b[:, i], environment.c[i], environment.d[i], environment.d[:, i]))
        )
        for i in range(len(ports))
    ]
    if spectral_radius(environment.a) > 1.0 - LOSSLESS or not stores(environment):
        return math.inf
    if any(is_touched and not port.damping for port, is_touched in zip(ports, touched, strict=True)):
        return math.inf
    root = np.sqrt([port.damping or 1.0 for port in ports])

    def needed(angle: Array) -> Array:
        holds = [hold(angle, period, port.delay, port.lag) for port in ports]
        force = frequency_responses(environment, angle) / np.outer(root, root)
        along = np.stack([each.displacement for each in holds], axis=-1)[:, :, None] * force
        spread = 0.5 * np.sqrt(np.stack([each.spread for each in holds], axis=-1))[:, :, None] * force
        form = np.block([[0.5 * (along + _adjoint(along)), _adjoint(spread)], [spread, np.zeros_like(spread)]])
        largest: Array = np.linalg.eigvalsh(form)[:, -1]
        return largest

    return worst(needed, environment)


def _adjoint(matrices: Complex) -> Complex:
    return matrices.conj().swapaxes(-1, -2)

"""Passivity of coupled axes: sampled forces behind delayed holds and torque loops, for any passive hands on them.

The forces are F_k = H x_k with an n × n matrix H. They are held and filtered axis by axis as in `passivity`; P_i and
S_i are the P and S of that module for axis i. Devices of damping b_i are passive with these forces when, for all
motions, Σ b_i·∫v_i² ≥ Σ ∫f_i·v_i. At a frequency θ = ωT let X be the sampled positions. Each v_i is the sum of a
constant speed (z − 1)·X_i/T, which appears in the samples, and a rest of mean zero, which does not. Completing the
square in the rest, f̃_i/(2·b_i), and dividing by |z − 1|²/T leaves X*·M·X ≥ 0 with the Hermitian

    M(θ) = diag(b) − ½·(diag(P)·H + H*·diag(P)*) − H*·diag(S/(4·b))·H,    0 < θ ≤ π.

Devices and forces are passive if and only if two conditions hold:

- M ⪰ 0 at every θ.
- The forces at rest, H(1), are those of a spring that stores energy: symmetric, with −H(1) ⪰ 0. Otherwise a slow motion
  around a loop, or ever further away, takes energy without end.

Then no passive hands make the system unstable, whether the hands are separate or belong to one body. If a condition
fails, some motion of all handles together takes energy for ever. This is stricter than necessary for hands that are
known to be separate, each passive by itself.

The needed share s of the dampings is the smallest s for which M ⪰ 0 with s·b in place of b. By Schur's complement it is
the largest eigenvalue of [[A, R*], [R, 0]], where A is the Hermitian part ½·(diag(P)·H + H*·diag(P)*) and
R = ½·diag(√S)·H, with rows and columns divided by √b.

Example: a spring-damper between x1 and n·x2 with equal delays has H = −h·g·gᵀ, g = (1, −n). M ⪰ 0 then means that one
device of damping 1/(1/b1 + n²/b2) is passive with h. Without delay this is K·T/2 + |B| ≤ 1/(1/b1 + n²/b2) (Colgate &
Schenkel, J. Robotic Systems 14(1), 1997, 37, for one device). For equal axes, n = 1 and B = 0 it is K ≤ b/T, because
the difference of the handles meets 2·K.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace, equilibrium
from haptic_fieldbus.numerics.passivity import Array, Complex, frequency_responses, hold, worst
from haptic_fieldbus.numerics.sampled import spectral_radius

LOSSLESS = 1e-9
"""Loss per period below which a mode counts as undamped; no damping makes an undamped mode passive."""
ROUNDING, CANCELLED = 1e-9, 1e-13
"""Shares of the largest force at rest, and of the terms that cancel in it, that may be rounding."""


@dataclass(frozen=True)
class PassivityPort:
    """Device between one force of the environment and the hand: damping [N·s/m or N·m·s/rad], delay [s], lag [s]."""

    damping: float
    delay: float
    lag: float = 0.0
    """Time constant of the torque loop."""


def stores(environment: StateSpace) -> bool:
    """Return True when the forces at rest are those of a spring whose energy is never below 0."""
    states = equilibrium(environment.a - np.eye(environment.order), environment.b)
    stiffness = -(environment.c @ states + environment.d)
    # The force of a soft spring is the small rest of large damper terms that cancel.
    terms = np.abs(environment.c) @ np.abs(states) + np.abs(environment.d)
    least = -max(ROUNDING * float(np.abs(stiffness).max(initial=0.0)), CANCELLED * float(terms.max(initial=0.0)))
    bent = float(np.abs(stiffness - stiffness.T).max(initial=0.0))
    return bent <= -least and float(np.linalg.eigvalsh(stiffness + stiffness.T).min(initial=0.0)) >= 2.0 * least


def damping_share(environment: StateSpace, ports: Sequence[PassivityPort], period: float) -> float:
    """Return the share of the devices' dampings that passivity with any hands needs; ∞ when no damping is enough.

    The system is passive up to a share of 1. The environment maps positions (n_axes,) to forces (n_axes,); `ports`
    holds one device for each axis, `period` is in s.
    """
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
    root = np.sqrt([port.damping or 1.0 for port in ports])  # an undamped port is untouched here, its rows are 0

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

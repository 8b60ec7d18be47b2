"""The bristle of the Dahl and LuGre friction models, stepped exactly along the path of the handle.

The stretch z follows dz/dx = 1 − (z/L)·sign(dx), where L is the steady stretch. With L constant, a move Δx in one
direction gives

    z⁺ = z + (s − z)·(1 − e^(−|Δx|/L)),   s = L·sign(Δx),

independent of the time of the move. z⁺ lies between z and s, so |z| never exceeds the largest L. The explicit step
z + Δx − z·|Δx|/L explodes when |Δx| > 2·L.

Sampled and held, the force −σ·z creates energy. In one move, it gives at most 1.092·½·σ·Δx² more than the energy ½·σ·z²
releases. The factor is the largest value of ((z⁺ − z)² + 2·z·(z⁺ − z − Δx))/Δx², found at a reversal with |z| = 1.56·L
and |Δx| = 1.65·L; a test scans it. A plain spring gives ½·σ·Δx².
"""

import math
from collections.abc import Callable

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

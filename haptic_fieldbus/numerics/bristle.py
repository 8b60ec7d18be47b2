"""The bristle of Dahl's and LuGre's friction, stepped exactly along the way of the handle.

dz/dx = 1 − (z/L)·sign(dx) with the steady stretch L. Along a way Δx in one direction with L kept,

    z⁺ = z + (s − z)·(1 − e^(−|Δx|/L)),   s = L·sign(Δx),

whatever the time that it takes: z⁺ lies between z and s, so |z| never passes the largest L. The explicit step
z + Δx − z·|Δx|/L explodes where |Δx| > 2·L.

Sampled and held, the force −σ·z gives over one way, beyond what ½·σ·z² gives back, at most 1.092·½·σ·Δx² (the largest
value of ((z⁺ − z)² + 2·z·(z⁺ − z − Δx))/Δx², at a reversal with |z| = 1.56·L and |Δx| = 1.65·L; the test scans it).
A plain spring gives ½·σ·Δx².
"""

import math
from collections.abc import Callable

SAMPLED_EXCESS = 1.092
"""What a held bristle leaks at most, over what a spring of the same stiffness does."""


def advance(stretch: float, move: float, steady: float) -> float:
    """The stretch [m or rad] after a `move` of the handle with the `steady` stretch (above 0)."""
    return stretch - (math.copysign(steady, move) - stretch) * math.expm1(-abs(move) / steady)


def bind(stiffness: float, friction: float) -> Callable[[float], float]:
    """Position → force [N or N·m] of a bristle of that stiffness that slides at a constant friction, relaxed first."""
    stretch, steady = 0.0, friction / stiffness
    before: float | None = None

    def law(position: float) -> float:
        nonlocal stretch, before
        stretch = advance(stretch, position - (position if before is None else before), steady)
        before = position
        return -stiffness * stretch

    return law

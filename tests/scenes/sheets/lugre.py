"""A bristle and its dampers: each leaks, sampled, no more than its largest slope lets it.

Steepness. With p = σ0·z, F = −p − d·(1 − p·sign(v)/g) − σ2·v where d = σ1·v between ±g. Over the way p changes by at
most σ0·(1 + fs/fc), at a reversal from the breakaway force, and F by at most as much, as |d| ≤ g. Over the speed the
dashpot is σ1·(1 + fs/fc) steep at most, and through g, whose steepest fall is (fs − fc)·√(2/e)/vs, fs/fc of that.
"""

import math

from haptic_fieldbus.numerics.relaxation import SAMPLED_EXCESS
from haptic_fieldbus.scenes.lugre import LuGre
from tests.scenes.sheet import Motion, Sheet, damper_leak, passing, resting, spring_leak


def excess(lugre: LuGre) -> float:
    """1 + fs/fc: the largest |1 − σ0·z·sign(v)/g|."""
    return 1.0 + max(lugre.breakaway, lugre.coulomb) / lugre.coulomb


def steepness(lugre: LuGre) -> tuple[float, float, float]:
    fall = 0.0
    if lugre.breakaway > lugre.coulomb:
        fall = (lugre.breakaway - lugre.coulomb) * math.sqrt(2.0 / math.e) / lugre.stribeck
    by_speed = excess(lugre) * lugre.damping + (excess(lugre) - 1.0) * fall + lugre.viscous
    return excess(lugre) * lugre.stiffness, by_speed, 0.0


def sampled(lugre: LuGre, motion: Motion) -> float:
    bristle = SAMPLED_EXCESS * spring_leak(lugre.stiffness, motion)
    dashpots = excess(lugre) * damper_leak(lugre.damping, motion) + damper_leak(lugre.viscous, motion)
    return bristle + dashpots


SHEET = Sheet(
    examples=(
        LuGre("handle", coulomb=1.5, stiffness=800.0),
        LuGre("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, stribeck=0.05),
        LuGre("handle", coulomb=1.0, stiffness=800.0, breakaway=1.6, stribeck=0.05, damping=20.0, viscous=1.0),
    ),
    steepness=steepness,
    continuous=lambda lugre, motion: 0.0,
    sampled=sampled,
    silent=lambda lugre: [resting(0.02, 0.02, 0.02)],
    signs=lambda lugre: [(passing(0.0, 0.05, 0.2), -1), (passing(0.0, -0.05, 0.2), 1), (resting(0.0, 1e-6), -1)],
)

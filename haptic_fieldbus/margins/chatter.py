"""Chatter over the edge of an encoder count: what is proved of it, and the largest that is found by trying.

Proof. The rounding of a step D changes the force of a spring K by at most K·D/2, so the motor gives at most

    ∫f·v ≤ b_K·∫v² + (K·D/2)·∫|v|,   b_K = ½·K·(g + √(g² + S)), g = T/2 + td + λ

(`passivity`; about K·(T/2 + td)). The device takes b·∫v² + fc·∫|v|. In a motion that repeats itself both are equal, so
that where b > b_K

    ∫v²/∫|v| ≤ (K·D/2 − fc)/(b − b_K),

and nothing moves where fc ≥ K·D/2. With a device that damps less there is no bound.

Several cycles exist beside each other, and which one a handle settles to depends on how it was knocked. `cycles` tells
one of them by a describing function, which is an estimate. `largest_chatter` simulates the loop from the listed starts
and returns the largest amplitude; a start that is not listed may lead to a larger one.
"""

import math

import numpy as np

from haptic_fieldbus.margins.passivity import Increments
from haptic_fieldbus.margins.plant import Plant
from haptic_fieldbus.numerics.batch import Running, loops

STARTS = (0.0, 0.03, -0.03, 0.1, -0.1, 0.3, -0.3, 1.0, -1.0)
"""Speeds of the knocks from which cycles are looked for, in steps of the encoder per period."""
SETTLED, WATCHED = 15_000, 1000
"""Periods until a cycle has settled, and periods in which its amplitude is read."""


def chatter_speed(plant: Plant, period: float, delay: float, stiffness: float) -> float:
    """Return the largest ∫v²/∫|v| of a motion that repeats itself at a spring [m/s or rad/s]; times in s.

    0 where friction bridges half a count and damping suffices, ∞ where no bound is proved.
    """
    needed = Increments(stiffness, 0.0).damping_needed(period, delay, plant.torque_lag)
    if plant.damping <= needed:
        return math.inf
    return max(0.5 * stiffness * plant.resolution - plant.coulomb, 0.0) / (plant.damping - needed)


def largest_chatter(plant: Plant, period: float, delay: float, stiffness: float, damping: float = 0.0) -> float:
    """Return the largest amplitude [m or rad] of a handle pressed to the edge of a count, found from `STARTS`.

    The contact is a spring with a damper by backward difference; times in s.
    """
    step = plant.resolution
    many = loops(
        mass=plant.mass, damping=plant.damping, period=period, delay=delay, stiffness=stiffness,
        virtual_damping=damping, resolution=step, coulomb=plant.coulomb, push=1.5 * stiffness * step,
        position=1.5 * step, velocity=[start * step / period for start in STARTS],
    )  # fmt: skip
    running = Running(many)
    running.advance(SETTLED)
    least, most = np.full(len(STARTS), math.inf), np.full(len(STARTS), -math.inf)
    for _ in range(WATCHED):
        running.advance(1)
        least, most = np.minimum(least, running.state[0]), np.maximum(most, running.state[0])
    return float((most - least).max()) / 2.0

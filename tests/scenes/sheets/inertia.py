"""A filtered mass, at rest at first: it stores what it takes and dissipates in its filter.

Held for a period its force misses at most the half of its change in each move, and the rule of the trapezoid misses the
bend of force and path, third order in the period: a hundredth of it is allowed here.
"""

import numpy as np

from haptic_fieldbus.scenes.inertia import Inertia
from tests.scenes.sheet import Motion, Sheet, at_once, no_energy, resting

FASTEST = 10.0
"""[m/s]; three sines of 10 mm and 40 Hz have 7.5 m/s."""


def starting(acceleration: float) -> Motion:
    """Pulled away from rest."""
    time = 1e-3 * np.arange(50, dtype=np.float64)
    return Motion(1e-3, 0.5 * acceleration * time**2, acceleration * time)


def sampled_leak(inertia: Inertia, motion: Motion) -> float:
    """Half of |ΔF|·|Δx| in each move, |ΔF| ≤ m/τ·(|Δv| + |Δq|), and q changes by at most 2·v·T/τ."""
    span, largest = inertia.time_constant, float(np.abs(motion.velocity).max())
    changes = np.abs(np.diff(motion.velocity)) + 2.0 * largest * motion.period / span
    return 0.51 * inertia.mass / span * float(np.sum(changes * np.abs(motion.moves)))


def most(inertia: Inertia, motion: Motion) -> float:
    """With a condition: its largest force along the way."""
    return (inertia.negative_saturation or 0.0) * float(np.sum(np.abs(motion.moves)))


SHEET = Sheet(
    examples=(
        Inertia("handle", mass=0.3),
        Inertia("handle", mass=0.1, time_constant=0.004),
        Inertia(
            "handle",
            mass=0.3,
            dead_band=1.0,
            positive_coefficient=0.5,
            positive_saturation=2.0,
            negative_saturation=2.0,
        ),
    ),
    steepness=lambda inertia: (
        0.0,
        inertia.mass / inertia.time_constant,
        2.0 * FASTEST * inertia.mass / inertia.time_constant**2,
    ),
    jump=lambda inertia, speed: 0.0,
    continuous=lambda inertia, motion: most(inertia, motion) if inertia.dead_band else no_energy(inertia, motion),
    sampled=lambda inertia, motion: most(inertia, motion) if inertia.dead_band else sampled_leak(inertia, motion),
    silent=lambda inertia: [resting(0.0, 0.0, 0.0), resting(0.02, 0.02, 0.02)],
    signs=lambda inertia: [(starting(5.0), -1), (starting(-5.0), 1)],
    stiffest=lambda inertia: (at_once(0.0, speed=-0.05), -1.0),
    remembers=True,
)

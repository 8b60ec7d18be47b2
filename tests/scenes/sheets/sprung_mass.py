"""A linear oscillator that stores what it takes; sampled, its spring leaks as any spring does."""

import numpy as np

from haptic_fieldbus.scenes.sprung_mass import SprungMass
from tests.scenes.sheet import Motion, Sheet, resting


def sampled_leak(element: SprungMass, motion: Motion) -> float:
    """Half the change of the force in each move, the mass' own way included: it never outruns the handle's path."""
    turn = np.sqrt(element.stiffness / element.mass)
    speed = float(np.abs(motion.velocity).max(initial=0.0))
    span = motion.period * len(motion.moves)
    swing = 2.0 * speed * (1.0 + turn * span) * motion.period
    return 0.5 * element.stiffness * float(np.sum(np.abs(motion.moves) * (np.abs(motion.moves) + swing)))


SHEET = Sheet(
    examples=(SprungMass("handle", stiffness=300.0, mass=0.4),),
    steepness=lambda element: (element.stiffness, 0.0, 2.0 * element.stiffness * 10.0),
    continuous=lambda element, motion: 0.0,
    sampled=sampled_leak,
    silent=lambda element: [resting(0.02, 0.02, 0.02)],
    signs=lambda element: [(resting(0.0, 0.01), -1), (resting(0.0, -0.01), 1)],
    remembers=True,
)

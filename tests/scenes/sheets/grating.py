"""Friction of the place: it takes all that it is given, and leaks sampled as the spring that it sticks by.

Sliding, the force follows the friction of the place, by 2π·μ·fc/p over the way; sticking, the spring.
"""

import math

from haptic_fieldbus.scenes.grating import Grating
from tests.scenes.sheet import Sheet, passing, resting, spring_leak

SHEET = Sheet(
    examples=(
        Grating("handle", coulomb=1.0, stiffness=800.0, pitch=0.004),
        Grating("handle", coulomb=1.0, stiffness=800.0, pitch=0.002, depth=1.0),
    ),
    steepness=lambda grating: (
        max(grating.stiffness, 2.0 * math.pi * grating.depth * grating.coulomb / grating.pitch),
        0.0,
        0.0,
    ),
    continuous=lambda grating, motion: 0.0,
    sampled=lambda grating, motion: spring_leak(grating.stiffness, motion),
    silent=lambda grating: [resting(0.02, 0.02, 0.02)],
    signs=lambda grating: [(passing(0.0, 0.05, 0.2), -1), (passing(0.0, -0.05, 0.2), 1), (resting(0.0, 1e-6), -1)],
)

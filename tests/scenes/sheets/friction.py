"""A spring on a point that is dragged: it takes all that it is given, and leaks sampled as a spring does.

The one jump is the fall from breakaway to sliding where the speed leaves the window.
"""

from haptic_fieldbus.scenes.friction import Friction
from tests.scenes.sheet import Sheet, damper_leak, passing, resting, spring_leak

SHEET = Sheet(
    examples=(
        Friction("handle", coulomb=1.5, stiffness=800.0),
        Friction("handle", coulomb=0.05, stiffness=2e4),
        Friction("handle", coulomb=1.0, stiffness=800.0, damping=2.0),
        Friction("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, window=0.02),
        Friction("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, window=0.02, damping=2.0),
    ),
    steepness=lambda friction: (friction.stiffness, friction.damping, 0.0),
    jump=lambda friction, speed: max(0.0, friction.breakaway - friction.coulomb),
    continuous=lambda friction, motion: 0.0,
    sampled=lambda friction, motion: spring_leak(friction.stiffness, motion) + damper_leak(friction.damping, motion),
    silent=lambda friction: [resting(0.02, 0.02, 0.02)],
    signs=lambda friction: [
        (passing(0.0, 0.05, 0.2), -1),
        (passing(0.0, -0.05, 0.2), 1),
        (resting(0.0, 1e-6), -1),
    ],
)

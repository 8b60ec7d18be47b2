"""A linear oscillator that takes more than it stores; sampled, it leaks half the change of its force a move."""

from haptic_fieldbus.scenes.damped_sprung_mass import DampedSprungMass
from tests.scenes.sheet import Sheet, change_leak, resting

FAST = 20.0
"""[m/s]: more than twice the handle's fastest, which is what a mass on a spring reaches away from resonance."""


SHEET = Sheet(
    examples=(
        DampedSprungMass("handle", stiffness=300.0, mass=0.4, damping=2.0),
        DampedSprungMass("handle", stiffness=300.0, mass=0.4, drag=3.0),
        DampedSprungMass("handle", stiffness=300.0, mass=0.02, damping=0.5, drag=0.5),
    ),
    steepness=lambda element: (
        element.stiffness,
        element.damping,
        FAST * (element.stiffness + element.damping * (element.stiffness / element.mass) ** 0.5)
        + element.damping * FAST * (element.damping + element.drag) / element.mass,
    ),
    continuous=lambda element, motion: 0.0,
    sampled=change_leak,
    silent=lambda element: [resting(0.02, 0.02, 0.02)],
    signs=lambda element: [(resting(0.0, 0.01), -1), (resting(0.0, -0.01), 1)],
    remembers=True,
)

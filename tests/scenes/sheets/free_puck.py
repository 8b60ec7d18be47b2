"""Two masses and two springs behind a coupling: they take more than they store."""

from haptic_fieldbus.scenes.free_puck import FreePuck
from tests.scenes.sheet import Sheet, change_leak, resting

FAST = 20.0
"""[m/s]: more than twice the handle's fastest, which is what the puck reaches away from resonance."""

SHEET = Sheet(
    examples=(
        FreePuck("handle", stiffness=800.0, damping=2.0, puck=0.2, spring=200.0, mass=0.5),
        FreePuck("handle", stiffness=800.0, puck=0.2, spring=200.0, mass=0.5),
    ),
    steepness=lambda element: (
        element.stiffness,
        element.damping,
        FAST * (element.stiffness + element.damping * ((element.stiffness + element.spring) / element.puck) ** 0.5)
        + FAST * element.damping**2 / element.puck,
    ),
    continuous=lambda element, motion: 0.0,
    sampled=change_leak,
    silent=lambda element: [resting(0.02, 0.02, 0.02)],
    signs=lambda element: [(resting(0.0, 0.01), -1), (resting(0.0, -0.01), 1)],
    remembers=True,
)

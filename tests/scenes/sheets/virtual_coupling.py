"""A tool on a spring and damper, which may meet a wall: all takes more than it stores."""

from haptic_fieldbus.scenes.virtual_coupling import VirtualCoupling
from tests.scenes.sheet import Motion, Sheet, change_leak, resting

FAST = 20.0
"""[m/s]: more than twice the handle's fastest, which is what the tool reaches away from resonance."""


def stored(coupling: VirtualCoupling, motion: Motion) -> float:
    """Coupling and wall in series, where it begins inside."""
    inwards = 1.0 if coupling.side == "positive" else -1.0
    depth, k, wall = inwards * (motion.position[0] - coupling.wall), coupling.stiffness, coupling.wall_stiffness
    return 0.5 * k * wall / (k + wall) * float(max(0.0, depth)) ** 2


SHEET = Sheet(
    examples=(
        VirtualCoupling("handle", stiffness=800.0, damping=2.0, mass=0.05, wall_stiffness=5e3, wall=0.01),
        VirtualCoupling("handle", stiffness=800.0, mass=0.2, wall_stiffness=2e3, wall=-0.01, side="negative"),
        VirtualCoupling("handle", stiffness=800.0, damping=4.0, mass=0.2),
    ),
    steepness=lambda element: (
        element.stiffness,
        element.damping,
        FAST * (element.stiffness + element.damping * (1e4 / element.mass) ** 0.5)
        + FAST * element.damping**2 / element.mass,
    ),
    continuous=stored,
    sampled=lambda element, motion: stored(element, motion) + change_leak(element, motion),
    signs=lambda element: [(resting(0.0, 0.02), -1), (resting(0.0, -0.02), 1)],
    remembers=True,
)

"""A conservative field: what it gives is the energy of the first place less that of the last."""

from haptic_fieldbus.scenes.magnet import Magnet
from tests.scenes.sheet import Motion, Sheet, at_once, resting, spring_leak


def stored(magnet: Magnet, position: float) -> float:
    """K·R²/6·(1 − (1 − u²)³), and all of it outside."""
    u = min(1.0, abs(position - magnet.position) / magnet.radius)
    return magnet.stiffness * magnet.radius**2 / 6.0 * (1.0 - (1.0 - u * u) ** 3)


def continuous(magnet: Magnet, motion: Motion) -> float:
    return stored(magnet, motion.position[0]) - stored(magnet, motion.position[-1])


SHEET = Sheet(
    examples=(
        Magnet("handle", pull=2.0, radius=0.02),
        Magnet("handle", pull=2.0, radius=0.01, position=0.004),
    ),
    steepness=lambda magnet: (magnet.stiffness, 0.0, 0.0),
    stiffest=lambda magnet: (at_once(magnet.position), 1.0),
    continuous=continuous,
    sampled=lambda magnet, motion: continuous(magnet, motion) + spring_leak(magnet.stiffness, motion),
    silent=lambda magnet: [
        resting(magnet.position),
        resting(magnet.position + magnet.radius, magnet.position - magnet.radius, 5.0, -5.0),
    ],
    signs=lambda magnet: [
        (resting(magnet.position + 0.9 * magnet.radius), -1),
        (resting(magnet.position - 1e-3), 1),
    ],
    reach=(0.0, 0.01),
)

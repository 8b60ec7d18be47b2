"""A conservative field: what it gives is the energy of the first place less that of the last."""

import math

from haptic_fieldbus.scenes.detents import Detents
from tests.scenes.sheet import Motion, Sheet, at_once, resting, spring_leak


def stored(detents: Detents, position: float) -> float:
    """A·p/(2π)·(1 − cos(2π·(x − x₀)/p)), and all of it outside the range."""
    way = position - detents.position
    if detents.count:
        way = min(max(way, -0.5 * detents.pitch), (detents.count - 0.5) * detents.pitch)
    lift = detents.amplitude * detents.pitch / (2.0 * math.pi)
    return lift * (1.0 - math.cos(2.0 * math.pi * way / detents.pitch))


def continuous(detents: Detents, motion: Motion) -> float:
    return stored(detents, motion.position[0]) - stored(detents, motion.position[-1])


SHEET = Sheet(
    examples=(
        Detents("handle", amplitude=1.5, pitch=0.02, position=0.003),
        Detents("handle", amplitude=1.5, pitch=0.01, position=-0.01, count=3),
    ),
    steepness=lambda detents: (detents.stiffness, 0.0, 0.0),
    stiffest=lambda detents: (at_once(detents.position), 1.0),
    continuous=continuous,
    sampled=lambda detents, motion: continuous(detents, motion) + spring_leak(detents.stiffness, motion),
    silent=lambda detents: (
        [resting(detents.position)] + ([resting(-0.016), resting(0.016), resting(-1.0, 1.0)] if detents.count else [])
    ),
    signs=lambda detents: [
        (resting(detents.position + 1e-3), -1),
        (resting(detents.position - 1e-3), 1),
        (resting(detents.position + detents.pitch + 1e-3), -1),
        (resting(detents.position + 0.75 * detents.pitch), 1),
    ],
    reach=(0.0, 0.01),
)

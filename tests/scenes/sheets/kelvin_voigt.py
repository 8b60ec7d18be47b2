"""A spring and damper under a surface that comes back in its own time; nothing outside, and never a pull.

Sampled, a period that begins without force and ends deeper in the tissue takes nothing for what it stores: at most the
spring's force at its end times its way, K·d·Δd. That is the first touch and each time that a dent is met again.
"""

import numpy as np

from haptic_fieldbus.scenes.kelvin_voigt import KelvinVoigt
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, forces, passing, resting, spring_leak

DEEPEST = 0.075
"""[m]: a bit more than the motions reach."""


def inwards(tissue: KelvinVoigt) -> float:
    return 1.0 if tissue.side == "positive" else -1.0


def stored(tissue: KelvinVoigt, position: float) -> float:
    return 0.5 * tissue.stiffness * max(0.0, inwards(tissue) * (position - tissue.position)) ** 2


def meetings(tissue: KelvinVoigt, motion: Motion) -> float:
    depth = np.maximum(0.0, inwards(tissue) * (motion.position - tissue.position))
    free = forces(tissue, motion)[:-1] == 0.0
    return float(np.sum(tissue.stiffness * depth[1:] * np.maximum(0.0, np.diff(depth)) * free))


def sampled(tissue: KelvinVoigt, motion: Motion) -> float:
    leak = spring_leak(tissue.stiffness, motion) + damper_leak(tissue.damping, motion) + meetings(tissue, motion)
    return stored(tissue, motion.position[0]) + leak


SHEET = Sheet(
    examples=(
        KelvinVoigt("handle", stiffness=400.0, damping=3.0, position=0.01),
        KelvinVoigt("handle", stiffness=400.0, damping=40.0, position=-0.01, side="negative"),
    ),
    steepness=lambda tissue: (tissue.stiffness, tissue.damping, 0.0),
    jump=lambda tissue, speed: tissue.damping * speed + tissue.stiffness * DEEPEST,
    stiffest=lambda tissue: (at_once(tissue.position + inwards(tissue) * 0.01), inwards(tissue)),
    continuous=lambda tissue, motion: stored(tissue, motion.position[0]),
    sampled=sampled,
    silent=lambda tissue: [
        resting(tissue.position, tissue.position - inwards(tissue) * 0.01),
        passing(tissue.position - inwards(tissue) * 0.05, tissue.position, 0.5),
    ],
    signs=lambda tissue: [(resting(tissue.position + inwards(tissue) * 1e-3), -round(inwards(tissue)))],
)

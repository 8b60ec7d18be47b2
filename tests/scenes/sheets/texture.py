"""A height field: what it gives is the energy of the first place less that of the last."""

import math

from haptic_fieldbus.scenes.texture import Texture
from tests.scenes.sheet import Motion, Sheet, resting, spring_leak


def stored(texture: Texture, position: float) -> float:
    """∫A·w(u) dx from the nearest valley."""
    phase = abs(math.remainder(position, texture.pitch)) / texture.pitch
    if texture.profile == "sine":
        return texture.amplitude * texture.pitch / (2.0 * math.pi) * (1.0 - math.cos(2.0 * math.pi * phase))
    rounded = 0.25 * texture.rounding
    lift = min(phase, rounded) ** 2 / (2.0 * rounded) + max(0.0, min(phase, 0.5 - rounded) - rounded)
    crest = max(0.0, phase - (0.5 - rounded))
    return texture.amplitude * texture.pitch * (lift + crest - crest**2 / (2.0 * rounded))


def continuous(texture: Texture, motion: Motion) -> float:
    return stored(texture, motion.position[0]) - stored(texture, motion.position[-1])


SHEET = Sheet(
    examples=(
        Texture("handle", amplitude=0.5, pitch=0.008),
        Texture("handle", amplitude=0.5, pitch=0.008, profile="triangle"),
        Texture("handle", amplitude=0.5, pitch=0.008, profile="triangle", rounding=1.0),
    ),
    steepness=lambda texture: (texture.stiffness, 0.0, 0.0),
    continuous=continuous,
    sampled=lambda texture, motion: continuous(texture, motion) + spring_leak(texture.stiffness, motion),
    silent=lambda texture: [resting(0.0, 0.008, -0.016)],
    signs=lambda texture: [(resting(0.002), -1), (resting(0.006), 1), (resting(-0.002), 1)],
    reach=(0.0, 0.005),
)

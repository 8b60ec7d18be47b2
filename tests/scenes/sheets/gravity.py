"""A conservative force: it gives exactly its weight times the way down."""

from haptic_fieldbus.scenes.gravity import STANDARD_GRAVITY, Gravity
from tests.scenes.sheet import Motion, Sheet, resting


def given(gravity: Gravity, motion: Motion) -> float:
    weight = gravity.share * gravity.mass * STANDARD_GRAVITY
    return float(weight * (motion.position[0] - motion.position[-1]))


SHEET = Sheet(
    examples=(Gravity("handle", mass=0.3), Gravity("handle", mass=0.3, share=-0.5)),
    steepness=lambda gravity: (0.0, 0.0, 0.0),
    continuous=given,
    sampled=given,
    signs=lambda gravity: [(resting(0.01), -1 if gravity.share > 0.0 else 1)],
)

"""A spring that stiffens, and a damper that grows with it; nothing outside, and never a pull.

Stiffness and damping of a whole motion are those at its deepest: n·k·dⁿ⁻¹ and p·k·dⁿ.
"""

import math

from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, passing, resting, spring_leak

DEEPEST, FASTEST = 0.075, 8.0
"""[m], [m/s]: what the motions reach at most, 0.06 m and 7.5 m/s, a body at ±1 cm."""


def inwards(body: HuntCrossley) -> float:
    return 1.0 if body.side == "positive" else -1.0


def stiffness_at(body: HuntCrossley, depth: float) -> float:
    return body.stiffness * math.pow(max(0.0, depth) / body.depth, body.exponent - 1.0)


def damping_at(body: HuntCrossley, depth: float) -> float:
    return body.loss * body.effort * math.pow(max(0.0, depth) / body.depth, body.exponent)


def stored(body: HuntCrossley, position: float) -> float:
    """∫ effort·(d/depth)ⁿ."""
    depth = max(0.0, inwards(body) * (position - body.position))
    return body.effort * math.pow(depth / body.depth, body.exponent) * depth / (body.exponent + 1.0)


def sampled(body: HuntCrossley, motion: Motion) -> float:
    deepest = float((inwards(body) * (motion.position - body.position)).max())
    leak = spring_leak(stiffness_at(body, deepest), motion) + damper_leak(damping_at(body, deepest), motion)
    return stored(body, motion.position[0]) + leak


def silent(body: HuntCrossley) -> list[Motion]:
    return [
        resting(body.position, body.position - inwards(body) * 0.01),
        passing(body.position - inwards(body) * 0.05, body.position, 0.5),
    ]


SHEET = Sheet(
    examples=(
        HuntCrossley("handle", effort=4.0, depth=0.01, position=0.01),
        HuntCrossley("handle", effort=4.0, depth=0.01, position=-0.01, loss=0.6, side="negative"),
        HuntCrossley("handle", effort=3.0, depth=0.01, exponent=2.2, loss=0.3),
        HuntCrossley("handle", effort=3.0, depth=0.01, exponent=1.0, loss=2.0),
    ),
    steepness=lambda body: (
        stiffness_at(body, DEEPEST) * (1.0 + body.loss * FASTEST),
        damping_at(body, DEEPEST),
        0.0,
    ),
    stiffest=lambda body: (at_once(body.position + inwards(body) * body.depth), inwards(body)),
    continuous=lambda body, motion: stored(body, motion.position[0]),
    sampled=sampled,
    silent=silent,
    signs=lambda body: [(resting(body.position + inwards(body) * 1e-3), -round(inwards(body)))],
)

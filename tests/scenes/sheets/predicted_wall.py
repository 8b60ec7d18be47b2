"""A wall inside, nothing out of reach of the prediction, and a leak of third order in the period.

At the period 2·lead a held force differs from the spring's work by at most ½·K·A·T²·(way + |v|·T), with A the
acceleration, and the way at most |v|·T + A·T²/2. Deadbeat release adds at most K·(|v|·T/2)·(A·T²/2): a period that was
to end outside, and turned.
"""

import numpy as np

from haptic_fieldbus.scenes.predicted_wall import LEAD, PredictedWall
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, passing, resting


def inwards(wall: PredictedWall) -> float:
    return 1.0 if wall.side == "positive" else -1.0


def stored(wall: PredictedWall, position: float) -> float:
    return 0.5 * wall.stiffness * max(0.0, inwards(wall) * (position - wall.position)) ** 2


def leak(wall: PredictedWall, motion: Motion) -> float:
    """The acceleration from the samples; the tenth on top is for what it is between them (0.25 rad at 40 Hz)."""
    period, speed = motion.period, np.abs(motion.velocity[:-1])
    acceleration = 1.1 * float(np.abs(np.diff(motion.velocity)).max()) / period
    ways = 2.5 * speed * period + 0.5 * acceleration * period**2
    return 0.5 * wall.stiffness * acceleration * period**2 * float(ways.sum())


def silent(wall: PredictedWall) -> list[Motion]:
    return [
        resting(wall.position, wall.position - inwards(wall) * 0.01),
        passing(wall.position - inwards(wall) * 0.05, wall.position - inwards(wall) * 1e-3, 0.5),
    ]


def signs(wall: PredictedWall) -> list[tuple[Motion, int]]:
    """Pushed out inside, and already before the surface by a handle that comes fast."""
    return [
        (resting(wall.position + inwards(wall) * 1e-3), -round(inwards(wall))),
        (
            passing(wall.position - inwards(wall) * 0.05, wall.position - inwards(wall) * 1e-4, 0.5),
            -round(inwards(wall)),
        ),
    ]


SHEET = Sheet(
    examples=(
        PredictedWall("handle", stiffness=600.0, position=0.01),
        PredictedWall("handle", stiffness=600.0, position=-0.01, damping=3.0, side="negative"),
        PredictedWall("handle", stiffness=600.0, release="deadbeat"),
    ),
    steepness=lambda wall: (wall.stiffness, wall.stiffness * LEAD + wall.damping, 0.0),
    jump=lambda wall, speed: (wall.damping + wall.stiffness * LEAD * (wall.release == "deadbeat")) * speed,
    stiffest=lambda wall: (at_once(wall.position + inwards(wall) * 0.01), inwards(wall)),
    continuous=lambda wall, motion: stored(wall, motion.position[0]),
    sampled=lambda wall, motion: (
        stored(wall, motion.position[0]) + leak(wall, motion) + damper_leak(wall.damping, motion)
    ),
    silent=silent,
    signs=signs,
)

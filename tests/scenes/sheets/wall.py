"""A spring and damper inside, nothing outside, and never a pull."""

from haptic_fieldbus.scenes.wall import Wall
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, passing, resting, spring_leak


def inwards(wall: Wall) -> float:
    return 1.0 if wall.side == "positive" else -1.0


def stored(wall: Wall, position: float) -> float:
    """½·K·d² of the penetration."""
    depth = position - wall.position
    inside = wall.sides == "bilateral" or (depth > 0.0) == (wall.side == "positive")
    return 0.5 * wall.stiffness * depth**2 * inside


def silent(wall: Wall) -> list[Motion]:
    if wall.sides == "bilateral":
        return [resting(wall.position)]
    outwards = -inwards(wall)
    return [resting(wall.position, wall.position + outwards * 0.01), passing(outwards * 0.05, outwards * 0.01, 0.5)]


def signs(wall: Wall) -> list[tuple[Motion, int]]:
    return [(resting(wall.position + inwards(wall) * 1e-3), -round(inwards(wall)))]


SHEET = Sheet(
    examples=(
        Wall("handle", stiffness=600.0, position=0.01),
        Wall("handle", stiffness=600.0, position=0.01, damping=3.0),
        Wall("handle", stiffness=600.0, position=-0.01, damping=3.0, side="negative"),
        Wall("handle", stiffness=600.0, sides="bilateral"),
    ),
    steepness=lambda wall: (wall.stiffness, wall.damping, 0.0),
    jump=lambda wall, speed: wall.damping * speed if wall.sides == "unilateral" else 0.0,
    stiffest=lambda wall: (at_once(wall.position + inwards(wall) * 0.01), inwards(wall)),
    continuous=lambda wall, motion: stored(wall, motion.position[0]),
    sampled=lambda wall, motion: (
        stored(wall, motion.position[0]) + spring_leak(wall.stiffness, motion) + damper_leak(wall.damping, motion)
    ),
    silent=silent,
    signs=signs,
)

"""A spring and one that relaxes, under a surface that comes back in its own time; never a pull."""

from haptic_fieldbus.scenes.standard_linear_solid import StandardLinearSolid
from tests.scenes.sheet import Sheet, at_once, change_leak, passing, resting

FASTEST = 8.0
"""[m/s]: the handle's; a branch relaxes by at most k·v, and so does the surface come back."""


def inwards(tissue: StandardLinearSolid) -> float:
    return 1.0 if tissue.side == "positive" else -1.0


def stored(tissue: StandardLinearSolid, position: float) -> float:
    """At rest at first: all but the spring that stays is relaxed."""
    return 0.5 * tissue.rest * max(0.0, inwards(tissue) * (position - tissue.position)) ** 2


SHEET = Sheet(
    examples=(
        StandardLinearSolid("handle", rest=150.0, branch=300.0, time=0.05, position=0.01),
        StandardLinearSolid("handle", rest=150.0, branch=600.0, time=1e-4, position=-0.01, side="negative"),
    ),
    steepness=lambda tissue: (tissue.stiffness, 0.0, 3.0 * tissue.stiffness * FASTEST),
    stiffest=lambda tissue: (at_once(tissue.position + inwards(tissue) * 0.01), inwards(tissue)),
    continuous=lambda tissue, motion: stored(tissue, motion.position[0]),
    sampled=lambda tissue, motion: stored(tissue, motion.position[0]) + change_leak(tissue, motion),
    silent=lambda tissue: [
        resting(tissue.position, tissue.position - inwards(tissue) * 0.01),
        passing(tissue.position - inwards(tissue) * 0.05, tissue.position, 0.5),
    ],
    signs=lambda tissue: [(resting(tissue.position + inwards(tissue) * 1e-3), -round(inwards(tissue)))],
)

"""A spring up to puncture, then friction and cutting; nothing outside.

Held springs that slip, cut or are left leak no more than springs: f·|Δx| ≤ f²/(2·K) + K·Δx²/2, whatever f is stored.
"""

from haptic_fieldbus.scenes.needle import Needle
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, passing, resting, spring_leak


def inwards(needle: Needle) -> float:
    return 1.0 if needle.side == "positive" else -1.0


def stored(needle: Needle, position: float) -> float:
    """∫ of the capsule's push; none where it is open from the start."""
    part = max(0.0, inwards(needle) * (position - needle.position)) / needle.depth
    c = needle.curvature
    return needle.puncture * needle.depth * ((1.0 - c) / 2.0 * part**2 + c / 3.0 * part**3) * (part < 1.0)


def signs(needle: Needle) -> list[tuple[Motion, int]]:
    """Out before puncture, out on the way in after it, and in (held fast) on the way out."""
    side, deep = round(inwards(needle)), needle.position + inwards(needle) * 3.0 * needle.depth
    first, last = needle.position + inwards(needle) * 0.5 * needle.depth, deep - inwards(needle) * needle.depth
    return [(resting(first), -side), (resting(first, last, deep), -side), (resting(first, deep, last), side)]


SHEET = Sheet(
    examples=(
        Needle("handle", puncture=2.0, depth=0.006, grip=500.0, friction=0.8, cutting=0.6, position=0.01),
        Needle(
            "handle", puncture=2.0, depth=0.006, grip=500.0, friction=0.5, breakaway=0.9, cutting=0.6, drag=3.0,
            curvature=1.0, position=-0.01, side="negative", heals=False,
        ),
    ),
    steepness=lambda needle: (needle.stiffness, needle.drag, 0.0),
    jump=lambda needle, speed: (
        max(needle.puncture, needle.breakaway + needle.friction + needle.cutting) + needle.drag * speed
    ),
    stiffest=lambda needle: (at_once(needle.position + inwards(needle) * 2.0 * needle.depth), inwards(needle)),
    continuous=lambda needle, motion: stored(needle, motion.position[0]),
    sampled=lambda needle, motion: (
        stored(needle, motion.position[0]) + spring_leak(needle.stiffness, motion) + damper_leak(needle.drag, motion)
    ),
    silent=lambda needle: [
        resting(needle.position, needle.position - inwards(needle) * 0.01),
        passing(needle.position - inwards(needle) * 0.05, needle.position, 0.5),
    ],
    signs=signs,
)  # fmt: skip

"""Bounds of force, stiffness and damping of an element between two positions.

The bounds hold at every place between the two, so that a sum over elements and over neighbouring intervals is a proof
for all places. `margins.terrain` draws the sums.
"""

import math
from dataclasses import dataclass

Interval = tuple[float, float]
"""Lowest and highest value."""


@dataclass(frozen=True)
class Local:
    """Bounds of what is felt of an element between two positions.

    `force` [N or N·m] is that on a handle at rest. `stiffness` is −dF/dx [N/m or N·m/rad], negative where the force
    pushes the handle on. The force changes per speed by at most `damping` [N·s/m or N·m·s/rad] plus `loss` [s/m or
    s/rad] times itself; an element with a loss never pulls.
    """

    force: Interval
    stiffness: Interval
    damping: float = 0.0
    loss: float = 0.0


def outwards(push: Interval, inwards: float) -> Interval:
    """Return the bounds of the force F = −inwards·push; `inwards` is 1 or −1, the side of the material."""
    return (-push[1], -push[0]) if inwards > 0.0 else push


def depths(lower: float, upper: float, surface: float, inwards: float) -> Interval:
    """Return the smallest and the largest depth below a surface between two positions; negative outside of it."""
    return (lower - surface, upper - surface) if inwards > 0.0 else (surface - upper, surface - lower)


def below(position: float, surface: float, side: str) -> float:
    """Return how deep a position is in material on the side "positive" or "negative" of a surface; 0 outside."""
    return max(position - surface if side == "positive" else surface - position, 0.0)


def hinge(depth: Interval, stiffness: float, damping: float, inwards: float, saturation: float = math.inf) -> Local:
    """Return the bounds of a spring-damper that begins at the depth 0 and pushes with at most `saturation`."""
    least, most = depth
    if most < 0.0:
        return Local((0.0, 0.0), (0.0, 0.0))
    push = tuple(min(stiffness * max(each, 0.0), saturation) for each in depth)
    in_reach = stiffness * least <= saturation
    always = least > 0.0 and stiffness * most < saturation
    slope = (stiffness if always else 0.0, stiffness if in_reach else 0.0)
    return Local(outwards((push[0], push[1]), inwards), slope, damping)


def either(one: Local, other: Local) -> Local:
    """Return the bounds of two parts of which at most one acts at any place."""
    return Local(
        (one.force[0] + other.force[0], one.force[1] + other.force[1]),
        (min(one.stiffness[0], other.stiffness[0]), max(one.stiffness[1], other.stiffness[1])),
        max(one.damping, other.damping),
    )


def turning(lower: float, upper: float, amplitude: float, turn: float) -> Local:
    """Return the bounds of F = −A·sin(κ·x) between two positions; `amplitude` A, `turn` κ [1/m or 1/rad]."""
    low, high = _sine(turn * lower, turn * upper)
    least, most = _sine(turn * lower + 0.5 * math.pi, turn * upper + 0.5 * math.pi)
    return Local((-amplitude * high, -amplitude * low), (amplitude * turn * least, amplitude * turn * most))


def _sine(lower: float, upper: float) -> Interval:
    """Return the smallest and the largest sine between two angles [rad]."""
    if not upper - lower < 2.0 * math.pi:
        return -1.0, 1.0
    ends = sorted((math.sin(lower), math.sin(upper)))
    # A crest lies between the angles where the number of crests below them differs.
    crests = [math.floor((angle - 0.5 * math.pi) / (2.0 * math.pi)) for angle in (lower, upper)]
    troughs = [math.floor((angle + 0.5 * math.pi) / (2.0 * math.pi)) for angle in (lower, upper)]
    return (-1.0 if troughs[0] != troughs[1] else ends[0]), (1.0 if crests[0] != crests[1] else ends[1])


def remainder(way: float, pitch: float) -> float:
    """Return how far a way is from the nearest multiple of a pitch, exactly; not-a-number for a way without end."""
    return math.remainder(way, pitch) if math.isfinite(way) else math.nan


def periods(pitch: float, first: float, lower: float, upper: float, most: int = 24) -> tuple[float, ...]:
    """Return the valleys first + n·pitch from `lower` to `upper`, at most so many around the first one."""
    begin = max(math.ceil((lower - first) / pitch) if math.isfinite(lower) else -most, -most // 2)
    end = min(math.floor((upper - first) / pitch) if math.isfinite(upper) else most, most // 2)
    return tuple(first + number * pitch for number in range(begin, end + 1))

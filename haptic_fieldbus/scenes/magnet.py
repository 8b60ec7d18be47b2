"""A magnet: pulls the handle to a position from within a radius.

With u = (x − p)/R, inside |u| < 1

    F = −K·R·u·(1 − u²)²

and 0 outside. Force and slope are continuous everywhere. The pull is largest at u = 1/√5, 16·√5/125·K·R = 0.286·K·R.
The slope is steepest in the middle, −K; further out it rises to 0.8·K, and the magnet overpowers the hand there.

Energy. The magnet stores K·R²/6·(1 − (1 − u²)³) and gives back no more; to leave it takes K·R²/6 from the hand. Sampled
and held, it gives at most ½·K·Δx² in each period, as a spring of stiffness K; a device of damping b is passive with it
while b > K·T/2.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Length, Local, Place, PositiveEffort
from haptic_fieldbus.signals import Signal

LARGEST_PULL = 16.0 * math.sqrt(5.0) / 125.0
"""The largest value of u·(1 − u²)²."""


@dataclass(frozen=True)
class Magnet:
    """A magnet at `position` that pulls with at most `pull` [N or N·m] from within `radius`; lengths in m or rad."""

    axis: str
    pull: PositiveEffort
    radius: Length
    position: Place = 0.0
    name: str = "magnet"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    @property
    def stiffness(self) -> float:
        """The steepest slope, in the middle [N/m or N·m/rad]."""
        return self.pull / (LARGEST_PULL * self.radius)

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, pull=stiffness * LARGEST_PULL * self.radius)

    def force(self, position: float) -> float:
        """Return the force or torque on the handle [N or N·m]; not-a-number gives not-a-number."""
        u = (position - self.position) / self.radius
        inner = 1.0 - u * u
        # The comparison is false for not-a-number, which then passes through the formula.
        return 0.0 if inner <= 0.0 else -self.pull / LARGEST_PULL * u * inner * inner

    def stored(self, position: float) -> float:
        """Return the energy above the middle when the handle is at `position` [J]; constant outside."""
        u = (position - self.position) / self.radius
        return self.stiffness * self.radius**2 / 6.0 * (1.0 - max(1.0 - u * u, 0.0) ** 3)

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two positions, from the ends and the extremes between them."""
        ends = sorted(max(min((each - self.position) / self.radius, 1.0), -1.0) for each in (lower, upper))
        # The force has its extremes at ±1/√5, the slope at 0 and ±√(3/5); both are 0 from ±1 on.
        pulls = [_pull(each) for each in (*ends, *(u for u in (-(0.2**0.5), 0.2**0.5) if ends[0] < u < ends[1]))]
        slopes = [_slope(each) for each in (*ends, *(u for u in (-(0.6**0.5), 0.0, 0.6**0.5) if ends[0] < u < ends[1]))]
        most, steep = self.pull / LARGEST_PULL, self.stiffness
        return Local((-most * max(pulls), -most * min(pulls)), (steep * min(slopes), steep * max(slopes)))

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return places all over the magnet."""
        return tuple(self.position + self.radius * number / 16.0 for number in range(-16, 17))

    def linearised(self) -> StateSpace:
        """Return the spring in the middle."""
        return gain([[-self.stiffness, 0.0]])


def _pull(u: float) -> float:
    """Return the pull at the share u of the radius, in parts of K·R."""
    return u * (1.0 - u * u) ** 2


def _slope(u: float) -> float:
    """Return the stiffness at the share u of the radius, in parts of K."""
    return (1.0 - u * u) * (1.0 - 5.0 * u * u)

"""A thin surface that resists from both sides: a proxy (god-object) stays on the side from which the handle came.

The proxy follows the handle until the handle passes the surface, and then stays on it: F = K·(proxy − x) − B·v, never a
pull. A plain wall depends on the present position alone: a thin one that is pushed in by more than half its thickness
would throw the handle out on the far side. The proxy keeps a memory of the side instead (the god-object of Zilles &
Salisbury, IROS 1995, doi:10.1109/IROS.1995.525876), here in one degree of freedom, where the surface has no tangent and
hence no friction. The surface can be touched from both sides; a handle that begins behind it belongs there.

On either side it is a wall: passive in continuous time, and sampled with the leak of a wall, at most K·Σ(Δx)²/2 plus
the leak of the held damper.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damped, Damping, Law, Place, Stiffness


@dataclass(frozen=True)
class Proxy(Damped):
    """A surface at `position` [m or rad] with `stiffness` [N/m or N·m/rad] and `damping` [N·s/m or N·m·s/rad]."""

    axis: str
    stiffness: Stiffness
    position: Place = 0.0
    damping: Damping = 0.0
    name: str = "proxy"
    __pydantic_config__: ClassVar = STRICT

    def begin(self, period: float) -> Law:
        """Return a law that remembers the side of the proxy: that on which the handle first left the surface."""
        surface, stiffness, damping = self.position, self.stiffness, self.damping
        side = 0.0

        def force(position: float, velocity: float = 0.0) -> float:
            nonlocal side
            offset = position - surface
            # On the surface itself there is no force, and no side to choose yet.
            if offset == 0.0:
                return 0.0
            if side == 0.0:
                side = math.copysign(1.0, offset)
            outwards = side * offset
            if outwards >= 0.0:
                return 0.0
            push = -stiffness * outwards - damping * side * velocity
            return 0.0 if push <= 0.0 else side * push

        return force

    def stored(self, position: float) -> float:
        """Return the energy of the spring when the handle is behind the surface at `position` [J]."""
        return 0.5 * self.stiffness * (position - self.position) ** 2

    @property
    def increments(self) -> tuple[float, float]:
        """Return stiffness and damping behind the surface."""
        return self.stiffness, self.damping

    def linearised(self) -> StateSpace:
        """Return the spring-damper that is felt behind the surface."""
        return gain([[-self.stiffness, -self.damping]])

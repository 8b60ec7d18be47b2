"""A grating: dry friction that is stronger on the ridges; a texture that only resists motion.

    F = −K·(x − a),   |x − a| ≤ c(x)/K,   c(x) = fc·(1 + μ·sin(2π·x/p))

A spring of `stiffness` K leads to a stick point a, which is dragged along where the spring would exceed the friction
c(x) at the position (Hayward & Armstrong, Experimental Robotics VI, Springer 2000, 403, for constant c). The law needs
no velocity.

Energy. With ½·K·(x − a)² stored the element only takes energy, as dragging only shortens the spring: it is passive, in
contrast to a height field, which gives energy back on the far side of each ridge. Sampled and held, it gives at most
½·K·Δx² in each period, as the spring of a wall; a device of damping b absorbs that while b > K·T/2. |F| ≤ fc·(1 + μ) at
any speed. While sliding, the slope of the force is at most 2π·μ·fc/p. Ridges passed faster than v = p/(2·T) alias: at 1
kHz and 1 mm that is 0.5 m/s, and a clean feel needs 5 to 10 kHz.
"""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, Length, PositiveEffort, Stiffness, remainder
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Grating:
    """Friction `coulomb` [N or N·m] on average, stronger and weaker by the ratio `depth` μ every `pitch` [m or rad].

    `stiffness` K [N/m or N·m/rad] is the stiffness while sticking.
    """

    axis: str
    coulomb: PositiveEffort
    stiffness: Stiffness
    pitch: Length
    depth: Annotated[float, Gt(0), Ge(1e-9), Le(1), Quantity.RATIO] = 0.5
    name: str = "grating"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return the law from position to force or torque on the handle [N or N·m]; the same for every period."""
        stiffness, pitch = self.stiffness, self.pitch
        mean, change = self.coulomb / stiffness, self.coulomb * self.depth / stiffness
        anchor: float | None = None

        def law(position: float) -> float:
            nonlocal anchor
            longest = mean + change * math.sin(2.0 * math.pi * remainder(position, pitch) / pitch)
            # min and max keep a not-a-number that comes first, so the order of the arguments lets it through.
            stretch = 0.0 * position if anchor is None else max(min(position - anchor, longest), -longest)
            anchor = position - stretch
            return -stiffness * stretch

        return law

    @property
    def reserve(self) -> float:
        """Largest energy that the spring of the stick point can hold [J]."""
        return 0.5 * (self.coulomb * (1.0 + self.depth)) ** 2 / self.stiffness

    @property
    def increments(self) -> tuple[float, float]:
        """Return the larger slope of sticking and of the ridges while sliding, and no damping."""
        return max(self.stiffness, 2.0 * math.pi * self.depth * self.coulomb / self.pitch), 0.0

    def linearised(self) -> StateSpace:
        """Return the spring that sticks."""
        return gain([[-self.stiffness, 0.0]])

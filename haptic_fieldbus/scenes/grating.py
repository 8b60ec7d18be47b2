"""A grating: dry friction that is stronger on the ridges, so that a texture hinders and never pushes.

    F = −K·(x − a),   |x − a| ≤ c(x)/K,   c(x) = fc·(1 + μ·sin(2π·x/p))

A spring of `stiffness` K from a stick point a, which is dragged along where the spring would pass the friction c(x) of
the place (Hayward & Armstrong, Experimental Robotics VI, Springer 2000, 403, for constant c). It needs no velocity.

Energy. With ½·K·(x − a)² stored it only takes, as dragging only shortens the spring: passive, in contrast to a height
field, which gives back on the far side of each ridge. Sampled and held, it gives at most ½·K·Δx² in each period, as the
spring of a wall; a device of damping b takes that while b > K·T/2. |F| ≤ fc·(1 + μ) at any speed. Sliding, the force
changes by at most 2π·μ·fc/p over the way. Ridges passed faster than v = p/(2·T) alias: at 1 kHz and 1 mm that is
0.5 m/s, and a clean feel asks for 5 to 10 kHz.
"""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, Length, PositiveEffort, Stiffness
from haptic_fieldbus.scenes.quantities import Quantity
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Grating:
    """Friction of `coulomb` [N or N·m] on average, more and less by the ratio `depth` μ every `pitch` [m or rad].

    `stiffness` K [N/m or N·m/rad] is that of sticking.
    """

    axis: str
    coulomb: PositiveEffort
    stiffness: Stiffness
    pitch: Length
    depth: Annotated[float, Gt(0), Le(1), Quantity.RATIO] = 0.5
    name: str = "grating"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Position → force or torque on the handle [N or N·m]; the same for every period."""
        stiffness, pitch = self.stiffness, self.pitch
        mean, change = self.coulomb / stiffness, self.coulomb * self.depth / stiffness
        anchor: float | None = None

        def law(position: float) -> float:
            """The order of the arguments of min and max lets not-a-number through."""
            nonlocal anchor
            longest = mean + change * math.sin(2.0 * math.pi * math.remainder(position, pitch) / pitch)
            stretch = 0.0 * position if anchor is None else max(min(position - anchor, longest), -longest)
            anchor = position - stretch
            return -stiffness * stretch

        return law

    def linearised(self) -> StateSpace:
        """Sticking."""
        return gain([[-self.stiffness, 0.0]])

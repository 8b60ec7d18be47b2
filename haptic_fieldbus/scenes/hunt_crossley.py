"""Contact after Hunt and Crossley: a spring that stiffens with depth, and damping that grows with it from nothing.

Push = k·dⁿ·(1 + p·ḋ), never below 0, with the depth d = ±(x − surface) and out of the material: F = ∓push. A wall's
damper jumps when it is touched and pulls when it is left; here the damping is zero at the surface, so the force is
continuous. The stiffness is given by the `effort` at a `depth`, k = effort/depthⁿ, so that no unit depends on n;
n = 3/2 is Hertz's sphere. (Hunt & Crossley, J. Applied Mechanics 42(2), 1975, 440, doi:10.1115/1.3423596.)

A free mass leaves the contact at the speed w with −p·w − ln(1 − p·w) = p·v − ln(1 + p·v): always below 1/p.

In continuous time it stores k·dⁿ⁺¹/(n + 1) and dissipates k·dⁿ·p·ḋ²; where the push is cut at 0 it gives back less
still: passive. Sampled and held the spring leaks at most K·Σ(Δx)²/2 with its stiffness K = n·k·dⁿ⁻¹ at the greatest
depth, and the damper k·dⁿ·p as any held damper. Stability is judged at `depth`: K = n·effort/depth and B = p·effort.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Ge, Le

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, InverseSpeed, Length, Place, PositiveEffort
from haptic_fieldbus.scenes.quantities import Quantity
from haptic_fieldbus.signals import Signal

DEEPEST = 1e60
"""Depths beyond so many times `depth` push no harder: no power overflows."""


@dataclass(frozen=True)
class HuntCrossley:
    """A body from `position` on [m or rad]: `effort` [N or N·m] at `depth` [m or rad], elsewhere ∝ depth^`exponent`.

    `loss` [s/m or s/rad] times the speed into it is the share by which it pushes more, out of it less. `side` is where
    its material lies.
    """

    axis: str
    effort: PositiveEffort
    depth: Length
    position: Place = 0.0
    exponent: Annotated[float, Ge(1), Le(4), Quantity.RATIO] = 1.5
    loss: InverseSpeed = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "hunt_crossley"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.VELOCITY) if self.loss else (Signal.POSITION,)

    def force(self, position: float, velocity: float = 0.0) -> float:
        """Force or torque on the handle [N or N·m]; not-a-number in gives not-a-number out."""
        inwards = 1.0 if self.side == "positive" else -1.0
        depth = inwards * (position - self.position)
        growth = 1.0 + self.loss * inwards * velocity
        if depth <= 0.0 or growth <= 0.0:
            return 0.0
        return -inwards * self.effort * math.pow(min(depth / self.depth, DEEPEST), self.exponent) * growth

    @property
    def stiffness(self) -> float:
        """At `depth` [N/m or N·m/rad]."""
        return self.exponent * self.effort / self.depth

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, effort=stiffness * self.depth / self.exponent)

    def linearised(self) -> StateSpace:
        """The spring-damper that is felt at `depth`."""
        return gain([[-self.stiffness, -self.loss * self.effort]])

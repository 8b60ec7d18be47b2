"""Hunt–Crossley contact: stiffness and damping grow with depth; the damping starts at zero.

The push is k·dⁿ·(1 + p·ḋ), never below 0, with the depth d = ±(x − surface); it points out of the material: F = ∓push.
A spring with a constant damper makes the force jump at touch, and would pull at release. Here the damping is zero at
the surface, so the force is continuous. The stiffness is given by the `effort` at a `depth`, k = effort/depthⁿ, so that
no unit depends on n; n = 3/2 is Hertz's sphere. (Hunt & Crossley, J. Applied Mechanics 42(2), 1975, 440,
doi:10.1115/1.3423596.)

A free mass that enters the contact at the speed v leaves it at the speed w with −p·w − ln(1 − p·w) = p·v − ln(1 + p·v),
which is always below 1/p.

In continuous time the contact stores k·dⁿ⁺¹/(n + 1) and dissipates k·dⁿ·p·ḋ²; where the push is cut at 0 it gives back
even less: it is passive. Sampled and held, the spring leaks at most K·Σ(Δx)²/2 with K = n·k·dⁿ⁻¹, its stiffness at the
greatest depth; the damper k·dⁿ·p leaks as any held damper. Stability is judged at `depth`: K = n·effort/depth and B =
p·effort.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Ge, Le

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import (
    STRICT,
    InverseSpeed,
    Length,
    Local,
    Place,
    PositiveEffort,
    below,
    depths,
    outwards,
)
from haptic_fieldbus.signals import Signal

DEEPEST = 1e60
"""Largest ratio to `depth` at which the push still grows, so that no power overflows."""
STEPS = 8
"""Number of judged places for each tenfold growth of the push."""


@dataclass(frozen=True)
class HuntCrossley:
    """A body that starts at `position` [m or rad]. The force is `effort` [N or N·m] at `depth` [m or rad] and grows
    with depth^`exponent`.

    The force is multiplied by 1 + `loss` [s/m or s/rad] times the speed into the body; it is smaller on the way out.
    `side` is the side of `position` with the material.
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
        """Return the force or torque on the handle [N or N·m]; not-a-number as position gives not-a-number."""
        inwards = 1.0 if self.side == "positive" else -1.0
        depth = inwards * (position - self.position)
        growth = 1.0 + self.loss * inwards * velocity
        # False for not-a-number, which then passes through the formula.
        if depth <= 0.0 or growth <= 0.0:
            return 0.0
        return -inwards * self.effort * math.pow(min(depth / self.depth, DEEPEST), self.exponent) * growth

    @property
    def stiffness(self) -> float:
        """The local stiffness at `depth` [N/m or N·m/rad]."""
        return self.exponent * self.effort / self.depth

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, effort=stiffness * self.depth / self.exponent)

    def penetration(self, position: float) -> float:
        """Return the depth of the handle in the body [m or rad]."""
        return below(position, self.position, self.side)

    def stored(self, position: float) -> float:
        """Return the energy of the elastic part when the handle is at `position` [J]."""
        share = min(self.penetration(position) / self.depth, DEEPEST)
        return self.effort * self.depth * math.pow(share, self.exponent + 1.0) / (self.exponent + 1.0)

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two positions; force, stiffness and damping all grow with the depth."""
        inwards = 1.0 if self.side == "positive" else -1.0
        least, most = (min(each / self.depth, DEEPEST) for each in depths(lower, upper, self.position, inwards))
        force = outwards((self._push(least), self._push(most)), inwards)
        return Local(force, (self._slope(least, inside=False), self._slope(most, inside=True)), loss=self.loss)

    def _push(self, share: float) -> float:
        """Return the push at rest at a share of `depth` [N or N·m]."""
        return self.effort * math.pow(max(share, 0.0), self.exponent)

    def _slope(self, share: float, *, inside: bool) -> float:
        """Return the stiffness at a share of `depth`; at the surface that of the inside or of the outside."""
        if share < 0.0 or (share == 0.0 and not inside):
            return 0.0
        return self.stiffness * math.pow(share, self.exponent - 1.0)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return depths with stepwise smaller push, from `effort` on, or from the push at `depth` if it is infinite."""
        most = self.effort if math.isinf(effort) else effort
        pushes = [most * 10.0 ** (-number / STEPS) for number in range(6 * STEPS + 1)]
        inwards = 1.0 if self.side == "positive" else -1.0
        ways = [self.depth * math.pow(push / self.effort, 1.0 / self.exponent) for push in pushes]
        return self.position, *(self.position + inwards * way for way in ways)

    def linearised(self) -> StateSpace:
        """Return the spring-damper that is felt at `depth`."""
        return gain([[-self.stiffness, -self.loss * self.effort]])

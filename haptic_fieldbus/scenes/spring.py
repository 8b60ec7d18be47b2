"""A spring that pulls the handle to its rest position: the spring condition of USB PID.

Beyond the dead band w on either side of the rest position x₀, F = −K·(x − x₀ ∓ w) − B·v, positive towards positive x;
within it F = 0. Either side has a coefficient, its share of K and B, and may have a saturation, the largest force with
the part of the damping included. (USB Device Class Definition for Physical Interface Devices 1.0: CP offset, dead band,
positive and negative coefficient, positive and negative saturation; in physical units here.)

In continuous time the spring stores the energy that it takes, U = ½·K·d² up to its saturation s and s·(d − s/2K)
beyond, and B dissipates. Sampled and held for T, it gives up to ½·K·(Δx)² more in each move Δx. With device damping b
it is passive while b > K·T/2 + B (Colgate & Schenkel, J. Robotic Systems 14(1), 1997, 37), with the velocity by
backward difference. With damping and a dead band the force steps by B·v at the edges of the band.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from haptic_fieldbus.numerics import condition
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import (
    STRICT,
    Damped,
    Damping,
    Law,
    Local,
    NonNegativeLength,
    Place,
    PositiveEffort,
    Share,
    Stiffness,
    depths,
    either,
    hinge,
)


@dataclass(frozen=True)
class Spring(Damped):
    """A spring of `stiffness` [N/m or N·m/rad] about `position` [m or rad], with `damping` [N·s/m or N·m·s/rad].

    `dead_band` [m or rad] is free play on either side. The coefficients are the shares of stiffness and damping on the
    positive and on the negative side; one of them must be 1. A saturation is the largest force on its side [N or N·m];
    without one there is no limit.
    """

    axis: str
    stiffness: Stiffness
    position: Place = 0.0
    damping: Damping = 0.0
    dead_band: NonNegativeLength = 0.0
    positive_coefficient: Share = 1.0
    negative_coefficient: Share = 1.0
    positive_saturation: PositiveEffort | None = None
    negative_saturation: PositiveEffort | None = None
    name: str = "spring"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        condition.check_coefficients(self.positive_coefficient, self.negative_coefficient, "stiffness")

    @property
    def force(self) -> Law:
        positive = self._side(self.positive_coefficient, self.positive_saturation)
        negative = self._side(self.negative_coefficient, self.negative_saturation)
        return condition.bind(self.position, self.dead_band, positive, negative)

    def _side(self, share: float, saturation: float | None) -> condition.Side:
        return condition.Side.limited(share * self.stiffness, share * self.damping, saturation)

    def stored(self, position: float) -> float:
        """Return the energy of the spring when the handle is at `position` [J]."""
        away = position - self.position
        beyond = max(abs(away) - self.dead_band, 0.0)
        if away > 0.0:
            share, saturation = self.positive_coefficient, self.positive_saturation
        else:
            share, saturation = self.negative_coefficient, self.negative_saturation
        stiffness = share * self.stiffness
        if saturation is not None and stiffness * beyond > saturation:
            return saturation * (beyond - 0.5 * saturation / stiffness)
        return 0.5 * stiffness * beyond * beyond

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two positions: nothing in the dead band, either side beyond it."""
        negative = self._hinge(lower, upper, -1.0, self.negative_coefficient, self.negative_saturation)
        positive = self._hinge(lower, upper, 1.0, self.positive_coefficient, self.positive_saturation)
        if lower > self.position - self.dead_band or upper < self.position + self.dead_band:
            return positive if lower > self.position - self.dead_band else negative
        found = either(negative, positive)
        # Without a dead band both sides begin at the same place.
        least = min(negative.stiffness[1], positive.stiffness[1]) if lower == upper else found.stiffness[0]
        return replace(found, stiffness=(least, found.stiffness[1]))

    def _hinge(self, lower: float, upper: float, side: float, share: float, saturation: float | None) -> Local:
        depth = depths(lower, upper, self.position + side * self.dead_band, side)
        most = math.inf if saturation is None else saturation
        return hinge(depth, share * self.stiffness, share * self.damping, side, most)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return the edges of the dead band, and where either side pushes with its largest force."""
        found = [self.position - self.dead_band, self.position + self.dead_band]
        for side, share, most in (
            (-1.0, self.negative_coefficient, self.negative_saturation),
            (1.0, self.positive_coefficient, self.positive_saturation),
        ):
            if stiffness := share * self.stiffness:  # a share may be so small that nothing is left of it
                way = min(effort, math.inf if most is None else most) / stiffness
                found.append(self.position + side * (self.dead_band + way))
        return tuple(found)

    def linearised(self) -> StateSpace:
        """Return the spring-damper of the stiffer side, beyond the dead band and below saturation."""
        return gain([[-self.stiffness, -self.damping]])

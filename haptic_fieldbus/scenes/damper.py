"""A damper that opposes the speed of the handle: the damper condition of USB PID.

Beyond the dead band w, F = −B·(v ∓ w), positive towards positive x; at slower speeds F = 0. Either direction has a
coefficient, its share of B, and may have a saturation. (USB Device Class Definition for Physical Interface Devices 1.0:
dead band, positive and negative coefficient, positive and negative saturation; in physical units here.)

In continuous time F·v ≤ 0 at every instant. Sampled and held for T, with the velocity by backward difference, the
damper gives energy when the handle turns within a period. With device damping b it is passive while b > B (Colgate &
Schenkel, J. Robotic Systems 14(1), 1997, 37). A free device of mass m without delay is stable while B < 2·m/T: its loop
is z² + (g − 1)·z + g with g = B·T/2m, and g is the product of its eigenvalues.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics import condition
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, NonNegativeSpeed, PositiveDamping, PositiveEffort, Share
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Damper:
    """A damper of `damping` [N·s/m or N·m·s/rad] beyond the speed `dead_band` [m/s or rad/s].

    The coefficients are the shares of the damping at positive and at negative speed; one of them must be 1. A
    saturation is the largest force in its direction [N or N·m]; without one there is no limit.
    """

    axis: str
    damping: PositiveDamping
    dead_band: NonNegativeSpeed = 0.0
    positive_coefficient: Share = 1.0
    negative_coefficient: Share = 1.0
    positive_saturation: PositiveEffort | None = None
    negative_saturation: PositiveEffort | None = None
    name: str = "damper"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.VELOCITY,)

    def __post_init__(self) -> None:
        condition.check_coefficients(self.positive_coefficient, self.negative_coefficient, "damping")

    @property
    def force(self) -> Law:
        # The metric of this condition is the velocity, so the damping is its coefficient.
        positive = condition.Side.limited(self.positive_coefficient * self.damping, 0.0, self.positive_saturation)
        negative = condition.Side.limited(self.negative_coefficient * self.damping, 0.0, self.negative_saturation)
        return condition.bind(0.0, self.dead_band, positive, negative)

    def stored(self, position: float) -> float:
        """Return 0 J: a damper stores no energy."""
        return 0.0

    @property
    def increments(self) -> tuple[float, float]:
        """Return no stiffness, and the damping."""
        return 0.0, self.damping

    def linearised(self) -> StateSpace:
        """Return the damping of the stronger direction, beyond the dead band and below saturation."""
        return gain([[0.0, -self.damping]])

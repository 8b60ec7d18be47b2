"""The weight of a mass that hangs on the handle of a linear axis.

F = −s·m·g, towards negative x, with standard gravity g = 9.80665 m/s² (3rd CGPM, 1901) and its share s along the axis:
1 for a vertical axis whose positive end is up, the sine of the slope for an inclined one, negative where the positive
end is down. Rotary axes have `pendulum` instead.

The force is conservative, U = s·m·g·x, and the hold of a constant causes no error: sampled as in continuous time, it
gives s·m·g times the distance on the way down and takes it back on the way up.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, AnyRatio, Law, Mass
from haptic_fieldbus.signals import Signal, Workspace

STANDARD_GRAVITY = 9.80665
"""Standard gravity [m/s²]."""


@dataclass(frozen=True)
class Gravity:
    """The weight of `mass` [kg]; `share` is the component along the axis (1: vertical axis)."""

    axis: str
    mass: Mass
    share: AnyRatio = 1.0
    name: str = "gravity"
    workspace: ClassVar = Workspace.LINEAR
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = ()

    @property
    def force(self) -> Law:
        weight = -self.share * self.mass * STANDARD_GRAVITY
        return lambda: weight

    def stored(self, position: float) -> float:
        """Return the energy of the weight above the place 0 [J]; negative below it."""
        return self.share * self.mass * STANDARD_GRAVITY * position

    def linearised(self) -> StateSpace:
        """Return a gain of 0: the force does not depend on the motion of the handle."""
        return gain([[0.0, 0.0]])

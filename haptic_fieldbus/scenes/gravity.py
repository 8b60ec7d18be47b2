"""The weight of a mass that hangs on the handle of a linear axis.

F = −s·m·g, towards negative x, with standard gravity g = 9.80665 m/s² (3rd CGPM, 1901) and its share s along the axis:
1 for a vertical axis whose positive end is up, the sine of the slope for an inclined one, negative where the positive
end is down. A rotary axis has `pendulum` in its place.

It is conservative, U = s·m·g·x, and a held constant is exact: it gives s·m·g times the way down, sampled as in
continuous time, and takes it back on the way up.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, AnyRatio, Law, Mass
from haptic_fieldbus.signals import Signal, Workspace

STANDARD_GRAVITY = 9.80665
"""[m/s²]"""


@dataclass(frozen=True)
class Gravity:
    """The weight of `mass` [kg], its `share` along the axis."""

    axis: str
    mass: Mass
    share: AnyRatio = 1.0
    name: str = "gravity"
    workspace: ClassVar = Workspace.LINEAR
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return ()

    @property
    def force(self) -> Law:
        weight = -self.share * self.mass * STANDARD_GRAVITY
        return lambda: weight

    def linearised(self) -> StateSpace:
        """Nothing that moves the handle changes it."""
        return gain([[0.0, 0.0]])

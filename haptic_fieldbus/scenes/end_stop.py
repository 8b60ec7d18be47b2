"""End stops: a stiff spring and a damper beyond both ends of the workspace; no force between them.

With the penetration d beyond `lower` or `upper` and the speed ḋ into the stop, the force K·d + B·ḋ pushes back into the
workspace; where it would be negative it is 0, so a stop never pulls a handle that leaves it.

In continuous time K stores energy and B dissipates it. Sampled and held for T, a stop gives up to ½·K·(Δx)² more in
each move Δx. With device damping b it is passive while b > K·T/2 + B (Colgate & Schenkel, J. Robotic Systems 14(1),
1997, 37), with the velocity by backward difference.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damped, Damping, Law, Local, Place, Stiffness, depths, either, hinge


@dataclass(frozen=True)
class EndStop(Damped):
    """Stops at `lower` and `upper` [m or rad], of `stiffness` [N/m or N·m/rad] and `damping` [N·s/m or N·m·s/rad]."""

    axis: str
    stiffness: Stiffness
    lower: Place
    upper: Place
    damping: Damping = 0.0
    name: str = "end_stop"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        """Raise ValueError unless `lower` is below `upper`."""
        if not self.lower < self.upper:
            raise ValueError(f"lower {exactly(self.lower)}: expected less than upper, {exactly(self.upper)}")

    @property
    def force(self) -> Law:
        lower, upper, stiffness, damping = self.lower, self.upper, self.stiffness, self.damping

        def springs(position: float) -> float:
            if lower <= position <= upper:
                return 0.0
            return -stiffness * (position - (lower if position < lower else upper))

        def damped(position: float, velocity: float) -> float:
            if lower <= position <= upper:
                return 0.0
            if position < lower:
                force = -stiffness * (position - lower) - damping * velocity
                return 0.0 if force < 0.0 else force
            force = -stiffness * (position - upper) - damping * velocity
            return 0.0 if force > 0.0 else force

        return damped if damping else springs

    def penetration(self, position: float) -> float:
        """Return the depth of the handle in either stop [m or rad]."""
        return max(self.lower - position, position - self.upper, 0.0)

    def stored(self, position: float) -> float:
        """Return the energy of the stops when the handle is at `position` [J]."""
        return 0.5 * self.stiffness * self.penetration(position) ** 2

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two positions: nothing between the stops, a spring-damper in either of them."""
        negative = hinge(depths(lower, upper, self.lower, -1.0), self.stiffness, self.damping, -1.0)
        positive = hinge(depths(lower, upper, self.upper, 1.0), self.stiffness, self.damping, 1.0)
        if lower > self.lower or upper < self.upper:
            return positive if lower > self.lower else negative
        return either(negative, positive)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return both stops, and the places beyond them where they push with `effort`."""
        way = effort / self.stiffness
        return self.lower - way, self.lower, self.upper, self.upper + way

    def linearised(self) -> StateSpace:
        """Return the spring-damper of either stop."""
        return gain([[-self.stiffness, -self.damping]])

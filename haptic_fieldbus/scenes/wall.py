"""A wall: a spring and a damper that push the handle out and never pull.

Inside a wall at p whose material lies on the positive side, F = −K·(x − p) − B·v with F ≤ 0; outside F = 0. The force
acts on the handle and is positive towards positive x, so a wall on the right pushes to the left: the sign is the
opposite of the classic pseudocode F = K·(x − p). Outside, zero is *written*: the pseudocode's "else do nothing" would
leave the last torque of the contact in force.

In continuous time K stores energy and B dissipates it, so the wall is passive. Sampled and held for T it generates
energy. With device damping b it stays passive while b > K·T/2 + B (Colgate & Schenkel, J. Robotic Systems 14(1), 1997,
37), with the velocity by backward difference.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damped, Damping, Local, Place, Stiffness, below, depths, hinge


@dataclass(frozen=True)
class Wall(Damped):
    """A wall at `position` [m or rad]: `stiffness` [N/m or N·m/rad], `damping` [N·s/m or N·m·s/rad].

    `side` is the side of `position` on which its material lies. With `sides` "bilateral" a spring-damper holds the
    handle at `position` from both sides, and also pulls; `side` has no meaning then.
    """

    axis: str
    stiffness: Stiffness
    position: Place = 0.0
    damping: Damping = 0.0
    sides: Literal["unilateral", "bilateral"] = "unilateral"
    side: Literal["positive", "negative"] = "positive"
    name: str = "wall"
    __pydantic_config__: ClassVar = STRICT

    def force(self, position: float, velocity: float = 0.0) -> float:
        """Return the force or torque on the handle [N or N·m]; not-a-number as position gives not-a-number."""
        penetration = position - self.position
        force = -self.stiffness * penetration - self.damping * velocity
        if self.sides == "bilateral":
            return force
        if self.side == "positive":
            # The comparisons are false for not-a-number, which so reaches the safety checks instead of passing for 0.
            return 0.0 if penetration <= 0.0 or force > 0.0 else force
        return 0.0 if penetration >= 0.0 or force < 0.0 else force

    def penetration(self, position: float) -> float | None:
        """Return the depth of the handle in the wall [m or rad]; None for a bilateral one, which has no outside."""
        return None if self.sides == "bilateral" else below(position, self.position, self.side)

    def stored(self, position: float) -> float:
        """Return the energy of the spring when the handle is at `position` [J]."""
        depth = position - self.position if self.sides == "bilateral" else below(position, self.position, self.side)
        return 0.5 * self.stiffness * depth * depth

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two positions: nothing outside, a spring-damper inside."""
        if self.sides == "bilateral":
            ends = (-self.stiffness * (upper - self.position), -self.stiffness * (lower - self.position))
            return Local(ends, (self.stiffness, self.stiffness), self.damping)
        inwards = 1.0 if self.side == "positive" else -1.0
        return hinge(depths(lower, upper, self.position, inwards), self.stiffness, self.damping, inwards)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return the surface, and the place in the material where the wall pushes with `effort`."""
        return self.position, self.position + (1.0 if self.side == "positive" else -1.0) * effort / self.stiffness

    def linearised(self) -> StateSpace:
        """Return the spring-damper that is felt inside."""
        return gain([[-self.stiffness, -self.damping]])

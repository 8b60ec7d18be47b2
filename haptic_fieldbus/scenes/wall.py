"""A wall: a spring and a damper that push the handle out, and never pull it in.

Inside a wall at p whose material lies on the positive side, F = −K·(x − p) − B·v with F ≤ 0; outside F = 0. The force
acts on the handle and is positive towards positive x, so a wall on the right pushes to the left: the sign is the
opposite of the classic pseudocode F = K·(x − p). Outside, zero is *written*: the pseudocode's "else do nothing" would
leave the last torque of the contact in force.

In continuous time K stores what it takes and B dissipates, so the wall is passive. Sampled and held at T it generates
energy; with device damping b it stays passive while b > K·T/2 + B (Colgate & Schenkel, J. Robotic
Systems 14(1), 1997, 37), velocity by backward difference.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damping, Place, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Wall:
    """A wall at `position` [m or rad]: `stiffness` [N/m or N·m/rad], `damping` [N·s/m or N·m·s/rad].

    `side` is where its material lies, seen from `position`. "bilateral" holds the handle at `position` from both sides
    (a spring-damper that also pulls); `side` then means nothing.
    """

    axis: str
    stiffness: Stiffness
    position: Place = 0.0
    damping: Damping = 0.0
    sides: Literal["unilateral", "bilateral"] = "unilateral"
    side: Literal["positive", "negative"] = "positive"
    name: str = "wall"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Velocity only when there is damping: without it the plan has no estimator."""
        return (Signal.POSITION, Signal.VELOCITY) if self.damping else (Signal.POSITION,)

    def force(self, position: float, velocity: float = 0.0) -> float:
        """Force or torque on the handle [N or N·m]; not-a-number in gives not-a-number out, for safety to see."""
        penetration = position - self.position
        force = -self.stiffness * penetration - self.damping * velocity
        if self.sides == "bilateral":
            return force
        if self.side == "positive":
            return 0.0 if penetration <= 0.0 or force > 0.0 else force
        return 0.0 if penetration >= 0.0 or force < 0.0 else force

    def linearised(self) -> StateSpace:
        """The spring-damper that is felt inside."""
        return gain([[-self.stiffness, -self.damping]])

"""A pendulum on a rotary axis: the weight of a mass on an arm.

M = −m·g·l·sin(θ − θ₀), positive towards positive θ, where θ₀ is where it hangs and m·g·l the `torque` that holds it
level: 0.2 kg on 0.1 m give 0.196 N·m. Only the weight is felt; the arm's inertia is an element of its own.

It is conservative, U = m·g·l·(1 − cos(θ − θ₀)). It is stiffest where it hangs, K = m·g·l a radian, and pushes away from
the upright place as hard as it pulls to the lower. Sampled and held at T it gives up to ½·K·(Δθ)² more in each move;
with device damping b it is passive while b > K·T/2 where it hangs, as a spring is (Colgate & Schenkel, J. Robotic
Systems 14(1), 1997, 37).
"""

from dataclasses import dataclass, replace
from math import nan, sin
from typing import ClassVar, Self

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Place, PositiveEffort
from haptic_fieldbus.signals import Signal, Workspace


@dataclass(frozen=True)
class Pendulum:
    """The largest `torque` of its weight [N·m], about `position` [rad] where it hangs."""

    axis: str
    torque: PositiveEffort
    position: Place = 0.0
    name: str = "pendulum"
    workspace: ClassVar = Workspace.ROTARY
    __pydantic_config__: ClassVar = STRICT

    @property
    def stiffness(self) -> float:
        """Where it hangs [N·m/rad]."""
        return self.torque

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, torque=stiffness)

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def force(self, position: float) -> float:
        """Torque on the handle [N·m]; not-a-number for an angle that is none or infinite."""
        try:
            return -self.torque * sin(position - self.position)
        except ValueError:
            return nan

    def linearised(self) -> StateSpace:
        """The spring that is felt about the place where it hangs."""
        return gain([[-self.stiffness, 0.0]])

"""A pendulum on a rotary axis: the weight of a mass on an arm.

M = −m·g·l·sin(θ − θ₀), positive towards positive θ. θ₀ is the angle at which it hangs, and m·g·l is the `torque` that
holds it level: 0.2 kg on 0.1 m give 0.196 N·m. Only the weight is felt; the inertia of the arm is a separate element.

The weight is conservative, U = m·g·l·(1 − cos(θ − θ₀)). It is stiffest where it hangs, with K = m·g·l per radian, and
pushes away from the upright position as hard as it pulls to the lower one. Sampled and held for T, it gives up to
½·K·(Δθ)² more in each move. With device damping b it is passive, as a spring is, while b > K·T/2 where it hangs
(Colgate & Schenkel, J. Robotic Systems 14(1), 1997, 37).
"""

from dataclasses import dataclass, replace
from math import cos, nan, pi, sin
from typing import ClassVar, Self

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Local, Place, PositiveEffort, periods, turning
from haptic_fieldbus.signals import Signal, Workspace


@dataclass(frozen=True)
class Pendulum:
    """A weight with a largest torque of `torque` [N·m]; its rest position is `position` [rad]."""

    axis: str
    torque: PositiveEffort
    position: Place = 0.0
    name: str = "pendulum"
    workspace: ClassVar = Workspace.ROTARY
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    @property
    def stiffness(self) -> float:
        """The largest stiffness, where it hangs [N·m/rad]."""
        return self.torque

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, torque=stiffness)

    def force(self, position: float) -> float:
        """Return the torque on the handle [N·m]; not-a-number when the angle is not-a-number or infinite."""
        try:
            return -self.torque * sin(position - self.position)
        except ValueError:  # math.sin refuses an infinite angle
            return nan

    def stored(self, position: float) -> float:
        """Return the energy above the lowest place when the handle is at `position` [J]."""
        return self.torque * (1.0 - cos(position - self.position))

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two angles."""
        return turning(lower - self.position, upper - self.position, self.torque, 1.0)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return angles all around one turn within the travel."""
        turns = periods(2.0 * pi, self.position, lower, upper, most=0)
        return tuple(turn + pi * number / 12.0 for turn in turns for number in range(-12, 13))

    def linearised(self) -> StateSpace:
        """Return the spring about the angle at which it hangs."""
        return gain([[-self.stiffness, 0.0]])

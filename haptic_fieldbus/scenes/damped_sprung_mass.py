"""A virtual mass on a spring and a damper whose other end is the puck in the hand.

Held puck at x, mass at p: F = k·(p − x) + b·(ṗ − ẋ) on the puck, positive towards positive x, and
m·p̈ = −F − d·ṗ. The `damping` b lies beside the spring and is felt in the hand; the `drag` d is between mass and ground,
and felt only through the spring. Of the mass on a held puck: ω_n = √(k/m), ζ = (b + d)/(2·√(k·m)).

In continuous time the element stores m·ṗ²/2 + k·(p − x)²/2 and dissipates b·(ṗ − ẋ)² + d·ṗ²: passive. Sampled and held
it leaks about half and at most all of |ΔF·Δx| in each period, ΔF the change of its force in it: K·Σ(Δx)²/2 for its
spring, and for its damper what any held damper adds (see `wall`).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import STRICT, Damping, Mass, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class DampedSprungMass:
    """`stiffness` [N/m or N·m/rad], `damping` beside it and `drag` [N·s/m or N·m·s/rad], `mass` [kg or kg·m²]."""

    axis: str
    stiffness: Stiffness
    mass: Mass
    damping: Damping = 0.0
    drag: Damping = 0.0
    name: str = "damped_sprung_mass"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Velocity only when the damper is there: a mass with mere drag follows the position."""
        return (Signal.POSITION, Signal.VELOCITY) if self.damping else (Signal.POSITION,)

    @property
    def dynamics(self) -> StateSpace:
        """States (position and velocity of the mass), inputs (position, velocity) of the puck, output force on it."""
        k, b, m = self.stiffness, self.damping, self.mass
        return StateSpace(
            a=np.array([[0.0, 1.0], [-k / m, -(b + self.drag) / m]]),
            b=np.array([[0.0, 0.0], [k / m, b / m]]),
            c=np.array([[k, b]]),
            d=np.array([[-k, -b]]),
        )

    def linearised(self) -> StateSpace:
        """The element is linear: its dynamics."""
        return self.dynamics

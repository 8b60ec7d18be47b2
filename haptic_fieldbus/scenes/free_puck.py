"""A free puck: a virtual puck and a mass sprung to it, led by the handle through a coupling.

    handle x ──[ stiffness, damping ]── puck y ──[ spring ]── mass p

The held puck is `sprung_mass`: there the handle is the puck, moved by the hand. A free puck moves by itself when its
mass pulls it; here the handle is coupled to it by a spring and a damper: F = K·(y − x) + B·(ẏ − ẋ) on the handle,
M·ÿ = −F + k·(p − y), m·p̈ = k·(y − p). Uncoupled, both swing about their common centre at ω = √(k·(1/M + 1/m)).

In continuous time it stores all that it takes but for B·(ẏ − ẋ)²: passive. Sampled and held it leaks about
half and at most all of |ΔF·Δx| in each period, ΔF the change of its force in it.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import STRICT, Damping, Mass, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class FreePuck:
    """Coupling `stiffness` and `spring` [N/m or N·m/rad], `damping` [N·s/m or N·m·s/rad], masses [kg or kg·m²]."""

    axis: str
    stiffness: Stiffness
    puck: Mass
    spring: Stiffness
    mass: Mass
    damping: Damping = 0.0
    name: str = "free_puck"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.VELOCITY) if self.damping else (Signal.POSITION,)

    @property
    def dynamics(self) -> StateSpace:
        """States (position, velocity) of the puck and of the mass, inputs those of the handle, output force on it."""
        stiffness, damping, spring = self.stiffness, self.damping, self.spring
        return StateSpace(
            a=np.array(
                [
                    [0.0, 1.0, 0.0, 0.0],
                    [-(stiffness + spring) / self.puck, -damping / self.puck, spring / self.puck, 0.0],
                    [0.0, 0.0, 0.0, 1.0],
                    [spring / self.mass, 0.0, -spring / self.mass, 0.0],
                ]
            ),
            b=np.array([[0.0, 0.0], [stiffness / self.puck, damping / self.puck], [0.0, 0.0], [0.0, 0.0]]),
            c=np.array([[stiffness, damping, 0.0, 0.0]]),
            d=np.array([[-stiffness, -damping]]),
        )

    def linearised(self) -> StateSpace:
        """The element is linear: its dynamics."""
        return self.dynamics

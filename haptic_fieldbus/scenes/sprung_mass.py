"""A virtual mass, connected to the handle by a spring.

With the handle at x and the mass at p, the spring pulls the mass with k·(x − p) and the handle with F = k·(p − x),
positive towards positive x. With q = ṗ: ṗ = q, q̇ = (k/m)·(x − p), so ω_n = √(k/m). Mass and spring start at rest at
the position of the handle.

The continuous undamped oscillator is only marginally stable: every integrator that adds energy makes it grow, forward
Euler at every period (|λ| = √(1 + k·T²/m)).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import STRICT, Mass, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class SprungMass:
    """A virtual `mass` [kg or kg·m²] on a spring of `stiffness` [N/m or N·m/rad] to the handle."""

    axis: str
    stiffness: Stiffness
    mass: Mass
    name: str = "sprung_mass"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    @property
    def dynamics(self) -> StateSpace:
        """States (position, velocity) of the mass, inputs (position, velocity) of the handle, output its force."""
        stiffness, mass = self.stiffness, self.mass
        return StateSpace(
            a=np.array([[0.0, 1.0], [-stiffness / mass, 0.0]]),
            b=np.array([[0.0, 0.0], [stiffness / mass, 0.0]]),
            c=np.array([[stiffness, 0.0]]),
            d=np.array([[-stiffness, 0.0]]),
        )

    def linearised(self) -> StateSpace:
        """Return the dynamics: the element is linear."""
        return self.dynamics

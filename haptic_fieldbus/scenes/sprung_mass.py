"""A virtual mass, connected to the handle by a spring.

With the handle at x and the mass at p, the spring pulls the mass with k·(x − p) and the handle with F = k·(p − x),
positive towards positive x. With q = ṗ: ṗ = q, q̇ = (k/m)·(x − p), so ω_n = √(k/m). Mass and spring start at rest at
the position of the handle.

The continuous undamped oscillator is only marginally stable: every integrator that adds energy makes it grow, forward
Euler at every period (|λ| = √(1 + k·T²/m)).
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, system_of
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
        k, m = self.stiffness, self.mass
        return system_of([[0.0, 1.0], [-k / m, 0.0]], [[0.0, 0.0], [k / m, 0.0]], [[k, 0.0]], [[-k, 0.0]])

    def linearised(self) -> StateSpace:
        """Return the dynamics: the element is linear."""
        return self.dynamics

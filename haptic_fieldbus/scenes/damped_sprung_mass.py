"""A virtual mass, connected to the handle by a spring and a damper.

With the handle at x and the mass at p, F = k·(p − x) + b·(ṗ − ẋ) on the handle, positive towards positive x, and m·p̈
= −F − d·ṗ. The `damping` b acts beside the spring and is felt in the hand; the `drag` d acts between mass and ground,
and is felt only through the spring. On a held handle the mass has ω_n = √(k/m), ζ = (b + d)/(2·√(k·m)).

In continuous time the element stores m·ṗ²/2 + k·(p − x)²/2 and dissipates b·(ṗ − ẋ)² + d·ṗ²: it is passive. Sampled and
held, it leaks about half and at most all of |ΔF·Δx| in each period, where ΔF is the change of its force within the
period: K·Σ(Δx)²/2 for its spring, and for its damper as much as any held damper (see `wall`).
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, system_of
from haptic_fieldbus.scenes.element import STRICT, Damped, Damping, Mass, Stiffness


@dataclass(frozen=True)
class DampedSprungMass(Damped):
    """A virtual `mass` [kg or kg·m²] on a spring of `stiffness` [N/m or N·m/rad].

    `damping` acts beside the spring, `drag` between the mass and ground [N·s/m or N·m·s/rad].
    """

    axis: str
    stiffness: Stiffness
    mass: Mass
    damping: Damping = 0.0
    drag: Damping = 0.0
    name: str = "damped_sprung_mass"
    __pydantic_config__: ClassVar = STRICT

    @property
    def dynamics(self) -> StateSpace:
        """States (position, velocity) of the mass, inputs (position, velocity) of the handle, output its force."""
        k, b, m = self.stiffness, self.damping, self.mass
        rates = [[0.0, 1.0], [-k / m, -(b + self.drag) / m]]
        return system_of(rates, [[0.0, 0.0], [k / m, b / m]], [[k, b]], [[-k, -b]])

    def linearised(self) -> StateSpace:
        """Return the dynamics: the element is linear."""
        return self.dynamics

"""A virtual puck that the handle leads through a coupling, with a mass on a spring behind it.

    handle x ──[ stiffness, damping ]── puck y ──[ spring ]── mass p

In `sprung_mass` the handle itself is the puck, moved by the hand. A free puck also moves by itself when its mass pulls
it. Here the handle is coupled to it by a spring and a damper: F = K·(y − x) + B·(ẏ − ẋ) on the handle, M·ÿ = −F + k·(p
− y), m·p̈ = k·(y − p). Uncoupled, puck and mass oscillate about their common centre of mass at ω = √(k·(1/M + 1/m)).

In continuous time the element stores all energy that it takes but for the dissipated B·(ẏ − ẋ)²: it is passive. Sampled
and held, it leaks about half and at most all of |ΔF·Δx| in each period, where ΔF is the change of its force within the
period.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, system_of
from haptic_fieldbus.scenes.element import STRICT, Damped, Damping, Mass, Stiffness


@dataclass(frozen=True)
class FreePuck(Damped):
    """A coupling of `stiffness` and `damping` to a puck of mass `puck`, with another `mass` behind the spring `spring`.

    Stiffnesses are in N/m or N·m/rad, the damping in N·s/m or N·m·s/rad, masses in kg or kg·m².
    """

    axis: str
    stiffness: Stiffness
    puck: Mass
    spring: Stiffness
    mass: Mass
    damping: Damping = 0.0
    name: str = "free_puck"
    state_names: ClassVar = ("position", "velocity", "mass position", "mass velocity")
    __pydantic_config__: ClassVar = STRICT

    @property
    def dynamics(self) -> StateSpace:
        """States (position, velocity) of puck and mass, inputs (position, velocity) of the handle, output its force."""
        k, b, spring, puck, mass = self.stiffness, self.damping, self.spring, self.puck, self.mass
        rates = [
            [0.0, 1.0, 0.0, 0.0],
            [-(k + spring) / puck, -b / puck, spring / puck, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [spring / mass, 0.0, -spring / mass, 0.0],
        ]
        by_handle = [[0.0, 0.0], [k / puck, b / puck], [0.0, 0.0], [0.0, 0.0]]
        return system_of(rates, by_handle, [[k, b, 0.0, 0.0]], [[-k, -b]])

    def linearised(self) -> StateSpace:
        """Return the dynamics: the element is linear."""
        return self.dynamics

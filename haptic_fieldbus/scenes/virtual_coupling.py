"""A virtual tool that the handle leads through a spring and a damper, and a wall that acts on the tool only.

    handle x ──[ stiffness, damping ]── tool p (mass) ──[ wall_stiffness ]── wall

F = K·(p − x) + B·(ṗ − ẋ) on the handle, m·p̈ = −F − K_w·(p − wall) while the tool is inside the wall. The hand feels
the wall through the coupling only: however stiff the wall, the loop renders no more than K and B, whose limits are
known beforehand (Adams & Hannaford, IEEE Trans. Robotics and Automation 15(3), 1999, 465, doi:10.1109/70.768179).

In continuous time the element stores m·ṗ²/2 + K·(p − x)²/2 + K_w·(p − wall)²/2 and dissipates B·(ṗ − ẋ)²: it is
passive. The tool is stepped exactly for motion of the handle on straight lines, and its meeting with the wall is found
within T/1024 (`numerics.switched`), so tool and wall make no energy of their own. The coupling, sampled and held, leaks
about half and at most all of |ΔF·Δx| in each period, where ΔF is the change of its force within the period.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.switched import bind_linear, bind_switched
from haptic_fieldbus.scenes.element import STRICT, Damping, Law, Mass, NonNegativeStiffness, Place, Stiffness, below
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class VirtualCoupling:
    """A tool of `mass`, coupled by `stiffness` and `damping`, and a wall of `wall_stiffness` that starts at `wall`.

    The mass is in kg or kg·m², stiffnesses are in N/m or N·m/rad, the damping in N·s/m or N·m·s/rad, the position
    `wall` in m or rad. Without `wall_stiffness` there is no wall. `side` is the side of `wall` on which its material
    lies.
    """

    axis: str
    stiffness: Stiffness
    mass: Mass
    damping: Damping = 0.0
    wall_stiffness: NonNegativeStiffness = 0.0
    wall: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "virtual_coupling"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.VELOCITY) if self.damping else (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return a law that remembers the tool, which starts at rest; lengths inside count from the wall into it."""
        inwards, wall = 1.0 if self.side == "positive" else -1.0, self.wall
        stiffness, damping = self.stiffness, self.damping
        free, touching = self._tool(0.0), self._tool(self.wall_stiffness)
        advance = bind_switched(free, touching, period) if self.wall_stiffness else bind_linear(free, period)
        # Where a held tool comes to rest between the coupling and the wall, as a share of the handle's depth.
        at_rest = stiffness / (stiffness + self.wall_stiffness)
        last: tuple[float, float] | None = None
        tool = speed = 0.0

        def force(position: float, velocity: float = 0.0) -> float:
            nonlocal last, tool, speed
            handle = inwards * (position - wall), inwards * velocity
            if last is None:
                # The tool starts at rest: at the handle outside of the wall, balanced between coupling and wall inside.
                tool = handle[0] if handle[0] <= 0.0 else at_rest * handle[0]
            else:
                tool, speed = advance(tool, speed, last, handle)
            last = handle
            return inwards * (stiffness * (tool - handle[0]) + damping * (speed - handle[1]))

        return force

    def penetration(self, position: float) -> float | None:
        """Return the depth of the handle in the wall [m or rad], larger than that of the tool; None without a wall."""
        return below(position, self.wall, self.side) if self.wall_stiffness else None

    def _tool(self, wall_stiffness: float) -> StateSpace:
        """States (position, velocity) of the tool, inputs those of the handle, output the force on the handle."""
        k, b, m = self.stiffness, self.damping, self.mass
        return StateSpace(
            a=np.array([[0.0, 1.0], [-(k + wall_stiffness) / m, -b / m]]),
            b=np.array([[0.0, 0.0], [k / m, b / m]]),
            c=np.array([[k, b]]),
            d=np.array([[-k, -b]]),
        )

    def linearised(self) -> StateSpace:
        """Return the tool in sustained contact with the wall."""
        return self._tool(self.wall_stiffness)

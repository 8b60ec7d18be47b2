"""A virtual tool led by the handle through a spring and a damper, and a wall that only the tool meets.

    handle x ──[ stiffness, damping ]── tool p (mass) ──[ wall_stiffness ]── wall

F = K·(p − x) + B·(ṗ − ẋ) on the handle, m·p̈ = −F − K_w·(p − wall) while the tool is inside the wall. The hand feels
the wall through the coupling only: however stiff the wall, K and B bound what the loop has to render, and their limits
are known beforehand (Adams & Hannaford, IEEE Trans. Robotics and Automation 15(3), 1999, 465, doi:10.1109/70.768179).

In continuous time it stores m·ṗ²/2 + K·(p − x)²/2 + K_w·(p − wall)²/2 and dissipates B·(ṗ − ẋ)²: passive. The tool is
stepped exactly between straight pieces of the handle's way, and its meeting with the wall is found within T/1024
(`numerics.switched`), so tool and wall make no energy of their own; the coupling, sampled and held, leaks about
half and at most all of |ΔF·Δx| in each period, ΔF the change of its force in it.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.switched import bind_linear, bind_switched
from haptic_fieldbus.scenes.element import STRICT, Damping, Law, Mass, NonNegativeStiffness, Place, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class VirtualCoupling:
    """Coupling `stiffness` [N/m or N·m/rad] and `damping`, tool `mass` [kg or kg·m²], wall from `wall` [m or rad] on.

    Without `wall_stiffness` there is no wall. `side` is where its material lies.
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
        """Remembers the tool, at rest at first; lengths are measured from the wall into it."""
        inwards, wall = 1.0 if self.side == "positive" else -1.0, self.wall
        stiffness, damping = self.stiffness, self.damping
        free, touching = self._tool(0.0), self._tool(self.wall_stiffness)
        advance = bind_switched(free, touching, period) if self.wall_stiffness else bind_linear(free, period)
        at_rest = stiffness / (stiffness + self.wall_stiffness)
        last: tuple[float, float] | None = None
        tool = speed = 0.0

        def force(position: float, velocity: float = 0.0) -> float:
            nonlocal last, tool, speed
            handle = inwards * (position - wall), inwards * velocity
            if last is None:
                tool = handle[0] if handle[0] <= 0.0 else at_rest * handle[0]
            else:
                tool, speed = advance(tool, speed, last, handle)
            last = handle
            return inwards * (stiffness * (tool - handle[0]) + damping * (speed - handle[1]))

        return force

    def _tool(self, wall_stiffness: float) -> StateSpace:
        """States (position and velocity of the tool), inputs those of the handle, output force on it."""
        k, b, m = self.stiffness, self.damping, self.mass
        return StateSpace(
            a=np.array([[0.0, 1.0], [-(k + wall_stiffness) / m, -b / m]]),
            b=np.array([[0.0, 0.0], [k / m, b / m]]),
            c=np.array([[k, b]]),
            d=np.array([[-k, -b]]),
        )

    def linearised(self) -> StateSpace:
        """The tool on the wall, held there."""
        return self._tool(self.wall_stiffness)

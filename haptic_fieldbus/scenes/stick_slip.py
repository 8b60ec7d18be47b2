"""Stick-slip: a spring to an anchor that jumps after the handle when the spring would pass a force.

    F = −K·(x − a);   where K·|x − a| passes the breakaway force fs, a jumps to where the spring is slack

as a saw tooth: over a steady way F rises to fs and drops to 0 every fs/K (the stick-slip effect of CHAI3D, where the
anchor jumps to the handle). Here it jumps by whole teeth fs/K, so that the teeth have their length at any speed and
period. Nothing slides between the jumps; friction that keeps its level is the kind `friction`.

Energy. With ½·K·(x − a)² stored it only takes, as a jump only shortens the spring: each tooth costs the hand fs²/(2·K),
and it is passive. Sampled and held, it gives at most ½·K·Δx² in each period, like a wall's spring; a device of damping
b takes that while b > K·T/2. |F| ≤ fs at any speed.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, PositiveEffort, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class StickSlip:
    """A spring of `stiffness` [N/m or N·m/rad] that slips at `breakaway` [N or N·m]."""

    axis: str
    stiffness: Stiffness
    breakaway: PositiveEffort
    name: str = "stick_slip"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Position → force or torque on the handle [N or N·m]; the same for every period."""
        stiffness, tooth = self.stiffness, self.breakaway / self.stiffness
        anchor: float | None = None

        def law(position: float) -> float:
            nonlocal anchor
            if anchor is None:
                anchor = position
            stretch = position - anchor
            if not -tooth <= stretch <= tooth:
                stretch = math.fmod(stretch, tooth) if math.isfinite(stretch) else math.nan
                anchor = position - stretch
            return -stiffness * stretch

        return law

    def linearised(self) -> StateSpace:
        """Sticking."""
        return gain([[-self.stiffness, 0.0]])

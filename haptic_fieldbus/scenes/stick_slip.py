"""Stick-slip: a spring to an anchor; the anchor jumps when the spring force would exceed a limit.

    F = −K·(x − a);   where K·|x − a| exceeds the breakaway force fs, a jumps to where the spring is slack

Steady motion gives a saw tooth: F rises to fs and drops to 0 every fs/K (the stick-slip effect of CHAI3D, where the
anchor jumps to the handle). Here the anchor jumps by whole teeth fs/K, so that the teeth keep their length at any speed
and period. Nothing slides between the jumps; the kind `friction` keeps its level instead.

Energy. With ½·K·(x − a)² stored the element only takes energy, as a jump only shortens the spring: each tooth takes
fs²/(2·K) from the hand, and the element is passive. Sampled and held, it gives at most ½·K·Δx² in each period, as the
spring of a wall; a device of damping b absorbs that while b > K·T/2. |F| ≤ fs at any speed.
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
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return the law from position to force or torque on the handle [N or N·m]; the same for every period."""
        stiffness, tooth = self.stiffness, self.breakaway / self.stiffness
        anchor: float | None = None

        def law(position: float) -> float:
            nonlocal anchor
            if anchor is None:
                anchor = position
            stretch = position - anchor
            if not -tooth <= stretch <= tooth:
                # fmod takes off whole teeth. It refuses an infinite stretch: not-a-number makes the loop trip.
                stretch = math.fmod(stretch, tooth) if math.isfinite(stretch) else math.nan
                anchor = position - stretch
            return -stiffness * stretch

        return law

    @property
    def reserve(self) -> float:
        """Largest energy that the spring can hold [J]."""
        return 0.5 * self.breakaway**2 / self.stiffness

    def linearised(self) -> StateSpace:
        """Return the spring that sticks."""
        return gain([[-self.stiffness, 0.0]])

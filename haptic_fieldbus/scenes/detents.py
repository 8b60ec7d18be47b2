"""Detents: valleys at equal distances that hold the handle, as in a knob or a gear gate.

    F = −A·sin(2π·(x − x₀)/p)

with valleys at x₀, x₀ + p, x₀ + 2·p …, all along the axis or a `count` of them: then the force is 0 from half a pitch
outside the first and the last one on, where the sine is 0 too, so nothing jumps.

Energy. It stores A·p/(2π)·(1 − cos(2π·(x − x₀)/p)) and gives back no more than that: it takes A·p/π from a hand to lift
a handle over a ridge. Its steepest slope is 2π·A/p, in the valleys, and is held against the limits of stability: sharp
detents buzz. Sampled and held, it gives at most ½·(2π·A/p)·Δx² in each period, as a spring of that stiffness, so a
device of damping b is passive with it while b > π·A·T/p. A handle of mass m swings in a valley at √(2π·A/(p·m)).
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

from annotated_types import Ge

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Length, Place, PositiveEffort
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Detents:
    """Detents of `amplitude` [N or N·m] every `pitch` [m or rad]; the first valley at `position` [m or rad].

    `count` valleys towards positive positions; 0: without end, to both sides.
    """

    axis: str
    amplitude: PositiveEffort
    pitch: Length
    position: Place = 0.0
    count: Annotated[int, Ge(0)] = 0
    name: str = "detents"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    @property
    def stiffness(self) -> float:
        """The steepest slope [N/m or N·m/rad]."""
        return 2.0 * math.pi * self.amplitude / self.pitch

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, amplitude=stiffness * self.pitch / (2.0 * math.pi))

    def force(self, position: float) -> float:
        """Force or torque on the handle [N or N·m]; not-a-number in gives not-a-number out."""
        way = position - self.position
        if self.count and (way <= -0.5 * self.pitch or way >= (self.count - 0.5) * self.pitch):
            return 0.0
        # the remainder is exact, so a knob is the same after any number of turns
        return -self.amplitude * math.sin(2.0 * math.pi * math.remainder(way, self.pitch) / self.pitch)

    def linearised(self) -> StateSpace:
        """In a valley."""
        return gain([[-self.stiffness, 0.0]])

"""Detents: valleys at equal distances that hold the handle, as in a knob or a gear gate.

    F = −A·sin(2π·(x − x₀)/p)

The valleys lie at x₀, x₀ + p, x₀ + 2·p …, all along the axis or a `count` of them. With a `count` the force is 0 from
half a pitch outside the first and the last valley on, where the sine is 0 too, so the force does not jump.

Energy. The element stores A·p/(2π)·(1 − cos(2π·(x − x₀)/p)) and gives back no more than that; to lift the handle over a
ridge takes A·p/π from the hand. The steepest slope is 2π·A/p, in the valleys. Stability is judged with this slope:
sharp detents buzz. Sampled and held, the element gives at most ½·(2π·A/p)·Δx² in each period, as a spring of that
stiffness, so a device of damping b is passive with it while b > π·A·T/p. A handle of mass m oscillates in a valley at
√(2π·A/(p·m)).
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

from annotated_types import Ge, Le

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import (
    STRICT,
    Length,
    Local,
    Place,
    PositiveEffort,
    either,
    periods,
    remainder,
    turning,
)
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Detents:
    """Detents of `amplitude` [N or N·m] every `pitch` [m or rad], the first valley at `position` [m or rad].

    `count` is the number of valleys towards positive positions; 0: without end on both sides.
    """

    axis: str
    amplitude: PositiveEffort
    pitch: Length
    position: Place = 0.0
    count: Annotated[int, Ge(0), Le(1_000_000)] = 0
    name: str = "detents"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    @property
    def stiffness(self) -> float:
        """The steepest slope, in the valleys [N/m or N·m/rad]."""
        return 2.0 * math.pi * self.amplitude / self.pitch

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, amplitude=stiffness * self.pitch / (2.0 * math.pi))

    def force(self, position: float) -> float:
        """Return the force or torque on the handle [N or N·m]; not-a-number gives not-a-number."""
        way = position - self.position
        if self.count and (way <= -0.5 * self.pitch or way >= (self.count - 0.5) * self.pitch):
            return 0.0
        # The remainder is exact, so a knob feels the same after any number of turns.
        return -self.amplitude * math.sin(2.0 * math.pi * remainder(way, self.pitch) / self.pitch)

    def stored(self, position: float) -> float:
        """Return the energy above a valley when the handle is at `position` [J]; constant beyond the last crest."""
        way, crest = position - self.position, self.amplitude * self.pitch / math.pi
        if self.count and (way <= -0.5 * self.pitch or way >= (self.count - 0.5) * self.pitch):
            return crest
        return crest * math.sin(math.pi * remainder(way, self.pitch) / self.pitch) ** 2

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two positions."""
        begin, end = lower - self.position, upper - self.position
        nothing = Local((0.0, 0.0), (0.0, 0.0))
        if self.count:
            first, last = -0.5 * self.pitch, (self.count - 0.5) * self.pitch
            if end < first or begin > last:
                return nothing
            inside = turning(max(begin, first), min(end, last), self.amplitude, 2.0 * math.pi / self.pitch)
            return inside if begin > first and end < last else either(inside, nothing)
        return turning(begin, end, self.amplitude, 2.0 * math.pi / self.pitch)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return places in the valleys and on the ridges between them; of many only some within the travel."""
        if self.count:
            last = self.position + (self.count - 1) * self.pitch
            lower, upper = max(lower, self.position), min(upper, last)
        valleys = periods(self.pitch, self.position, lower, upper)
        grid = [valley + self.pitch * number / 12.0 for valley in valleys for number in range(-6, 7)]
        return (*grid, last + 0.5 * self.pitch) if self.count else tuple(grid)

    def linearised(self) -> StateSpace:
        """Return the spring of a valley."""
        return gain([[-self.stiffness, 0.0]])

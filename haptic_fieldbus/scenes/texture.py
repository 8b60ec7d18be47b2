"""A texture: ridges whose flanks push along the axis, as on a fingertip that moves over them.

A tip that presses with N on a profile of height h(x) feels the lateral force −N·h′(x) (Robles-De-La-Torre & Hayward,
Nature 412, 2001, 445: that force alone conveys a shape). With the largest lateral force A, the pitch p and the phase u
= x/p:

| profile  | ridges                                                   | F                                 | slope     |
|----------|----------------------------------------------------------|-----------------------------------|-----------|
| sine     | sine of the height A·p/(π·N)                             | −A·sin(2π·u)                      | 2π·A/p    |
| triangle | straight flanks, valleys and crests rounded over ρ·p/2   | −A, +A, and straight between them | 4·A/(ρ·p) |

A valley lies at 0, where the force is 0. The slope of sharp triangles (ρ → 0) has no bound, so ρ is above 0.

Energy. A height field stores energy and gives back no more than it took. Stability is judged with its steepest slope K.
Sampled and held, it gives at most ½·K·Δx² in each period, so a device of damping b is passive with it while b > K·T/2.
Ridges passed faster than v = p/(2·T) alias into other ridges: at 1 kHz and 1 mm that is 0.5 m/s, and a clean feel needs
5 to 10 kHz. The kind `grating` is a texture that only resists motion and never pushes.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Ge, Gt, Le

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Length, Local, PositiveEffort, periods, remainder, turning
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Texture:
    """Ridges every `pitch` [m or rad] that push with at most `amplitude` [N or N·m].

    `rounding` ρ, above 0 up to 1, is the rounded share of a triangular ridge.
    """

    axis: str
    amplitude: PositiveEffort
    pitch: Length
    profile: Literal["sine", "triangle"] = "sine"
    rounding: Annotated[float, Gt(0), Ge(1e-9), Le(1), Quantity.RATIO] = 0.5
    name: str = "texture"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    @property
    def stiffness(self) -> float:
        """The steepest slope [N/m or N·m/rad]."""
        return self._steepness * self.amplitude / self.pitch

    def with_stiffness(self, stiffness: float) -> Self:
        return replace(self, amplitude=stiffness * self.pitch / self._steepness)

    @property
    def _steepness(self) -> float:
        """The steepest slope of the force in amplitudes over the phase."""
        return 2.0 * math.pi if self.profile == "sine" else 4.0 / self.rounding

    def force(self, position: float) -> float:
        """Return the force or torque on the handle [N or N·m]; not-a-number gives not-a-number."""
        phase = remainder(position, self.pitch) / self.pitch
        if self.profile == "sine":
            return -self.amplitude * math.sin(2.0 * math.pi * phase)
        # The force rises from the valley at phase 0 and falls again to the crest at ±½.
        share = min(abs(phase), 0.5 - abs(phase)) * 4.0 / self.rounding
        return -self.amplitude * math.copysign(min(share, 1.0), phase)

    def stored(self, position: float) -> float:
        """Return the energy above a valley when the handle is at `position` [J]."""
        way = abs(remainder(position, self.pitch))
        if self.profile == "sine":
            return self.amplitude * self.pitch / math.pi * math.sin(math.pi * way / self.pitch) ** 2
        # On the rounded parts, `bend` long on either side of valley and crest, the force is a straight line.
        bend, to_crest = 0.25 * self.rounding * self.pitch, 0.5 * self.pitch - way
        if way <= bend:
            return 0.5 * self.amplitude * way * way / bend
        straight = self.amplitude * (way - 0.5 * bend)
        return straight if to_crest >= bend else straight - 0.5 * self.amplitude * (bend - to_crest) ** 2 / bend

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds between two positions."""
        if self.profile == "sine":
            return turning(lower, upper, self.amplitude, 2.0 * math.pi / self.pitch)
        if not upper - lower < self.pitch:
            return Local((-self.amplitude, self.amplitude), (-self.stiffness, self.stiffness))
        first = lower - self.pitch * math.floor(lower / self.pitch)
        pieces = [piece for piece in self._pieces() if piece[0] <= first + upper - lower and piece[1] >= first]
        if not pieces:  # by rounding, where a position is far larger than the pitch
            return Local((-self.amplitude, self.amplitude), (-self.stiffness, self.stiffness))
        bends = [begin - first + lower for begin, _, _ in pieces if begin > first]
        pushes = [self.force(each) for each in (lower, upper, *bends)]
        slopes = [slope for _, _, slope in pieces]
        return Local((min(pushes), max(pushes)), (min(slopes), max(slopes)))

    def _pieces(self) -> list[tuple[float, float, float]]:
        """Return (begin, end, stiffness) of the straight pieces of two triangular ridges, from a valley on."""
        bend, half, stiffness = 0.25 * self.rounding * self.pitch, 0.5 * self.pitch, self.stiffness
        found = []
        for start in (0.0, self.pitch):
            edges = (0.0, bend, half - bend, half + bend, self.pitch - bend, self.pitch)
            slopes = (stiffness, 0.0, -stiffness, 0.0, stiffness)
            found += [
                (start + edges[place], start + edges[place + 1], slope)
                for place, slope in enumerate(slopes)
                if edges[place + 1] > edges[place]
            ]
        return found

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return places all over the ridges; of many only some within the travel."""
        if self.profile == "sine":
            grid = [self.pitch * number / 12.0 for number in range(-6, 7)]
        else:
            bend = 0.25 * self.rounding * self.pitch
            grid = [-0.5 * self.pitch, bend - 0.5 * self.pitch, -bend, 0.0, bend, 0.5 * self.pitch - bend]
        return tuple(valley + each for valley in periods(self.pitch, 0.0, lower, upper) for each in grid)

    def linearised(self) -> StateSpace:
        """Return the spring of a valley."""
        return gain([[-self.stiffness, 0.0]])

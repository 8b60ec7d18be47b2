"""A texture: ridges whose flanks push sideways, as felt by a fingertip that is drawn over them.

A tip that presses with N on a profile of height h(x) feels the lateral force −N·h′(x) (Robles-De-La-Torre & Hayward,
Nature 412, 2001, 445: that force alone conveys a shape). With the largest lateral force A, the pitch p and the phase u
= x/p:

| profile  | ridges                                                   | F                                 | slope     |
|----------|----------------------------------------------------------|-----------------------------------|-----------|
| sine     | sine of the height A·p/(π·N)                             | −A·sin(2π·u)                      | 2π·A/p    |
| triangle | straight flanks, valleys and crests rounded over ρ·p/2   | −A, +A, and straight between them | 4·A/(ρ·p) |

A valley lies at 0, where the force is 0. The slope of sharp triangles (ρ → 0) has no bound, so ρ is above 0.

Energy. A height field stores energy and gives back no more than it took. Its steepest slope K is held against the
limits of stability. Sampled and held, it gives at most ½·K·Δx² in each period, so a device of damping b is passive with
it while b > K·T/2. Ridges passed faster than v = p/(2·T) alias into other ridges: at 1 kHz and 1 mm that is 0.5 m/s,
and a clean feel needs 5 to 10 kHz. For a texture that only hinders and never pushes there is the kind `grating`.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Ge, Gt, Le

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Length, PositiveEffort
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Texture:
    """Ridges every `pitch` [m or rad] that push with at most `amplitude` [N or N·m].

    `rounding` ρ, above 0 up to 1, is the rounded part of a triangular ridge.
    """

    axis: str
    amplitude: PositiveEffort
    pitch: Length
    profile: Literal["sine", "triangle"] = "sine"
    rounding: Annotated[float, Gt(0), Ge(1e-9), Le(1), Quantity.RATIO] = 0.5
    name: str = "texture"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

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
        phase = math.remainder(position, self.pitch) / self.pitch
        if self.profile == "sine":
            return -self.amplitude * math.sin(2.0 * math.pi * phase)
        # The force rises from the valley at phase 0 and falls again to the crest at ±½.
        share = min(abs(phase), 0.5 - abs(phase)) * 4.0 / self.rounding
        return -self.amplitude * math.copysign(min(share, 1.0), phase)

    def stored(self, position: float) -> float:
        """Return the energy above a valley when the handle is at `position` [J]."""
        way = abs(math.remainder(position, self.pitch))
        if self.profile == "sine":
            return self.amplitude * self.pitch / math.pi * math.sin(math.pi * way / self.pitch) ** 2
        # On the rounded parts, `bend` long on either side of valley and crest, the force is a straight line.
        bend, to_crest = 0.25 * self.rounding * self.pitch, 0.5 * self.pitch - way
        if way <= bend:
            return 0.5 * self.amplitude * way * way / bend
        straight = self.amplitude * (way - 0.5 * bend)
        return straight if to_crest >= bend else straight - 0.5 * self.amplitude * (bend - to_crest) ** 2 / bend

    def linearised(self) -> StateSpace:
        """Return the spring of a valley."""
        return gain([[-self.stiffness, 0.0]])

"""Kelvin–Voigt tissue: a spring and a damper side by side under a free surface.

At the depth d = ±(x − position) the touched tissue pushes K·d + B·ḋ. Untouched, its dent s recovers by K·s + B·ṡ = 0,
with the time constant B/K. A tool that leaves faster loses contact, and meets the tissue again where the dent has
recovered to: the tissue never pulls and, unlike a wall with a damper, never pushes where it has not yet recovered.
(Fung, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., 1993, chapter 2.)

In continuous time the tissue stores K·s²/2 and dissipates B·ṡ², touched or not: it is passive. The free recovery is
stepped exactly for any T, by the factor e^(−K·T/B) in each period. Sampled and held, the tissue leaks as a spring and a
damper do: K·Σ(Δx)²/2, and B·|v·Δx| where velocity and motion disagree. Where the tool meets a dent between two samples
it leaks, once more, the spring's force there times the distance into it, at most K·s·|Δx|.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, Place, PositiveDamping, Stiffness, below
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class KelvinVoigt:
    """Tissue from `position` [m or rad] on: `stiffness` [N/m or N·m/rad] and `damping` [N·s/m or N·m·s/rad].

    `side` is the side on which the tissue lies.
    """

    axis: str
    stiffness: Stiffness
    damping: PositiveDamping
    position: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "kelvin_voigt"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION, Signal.VELOCITY)

    def begin(self, period: float) -> Law:
        """Return a law that remembers the depth of the dent."""
        inwards = 1.0 if self.side == "positive" else -1.0
        surface, stiffness, damping = self.position, self.stiffness, self.damping
        kept = math.exp(-period * (stiffness / damping))
        dent = 0.0

        def force(position: float, velocity: float) -> float:
            nonlocal dent
            depth = inwards * (position - surface)
            dent *= kept
            # The tool is out of the tissue, whose dent goes on recovering.
            if depth <= dent:
                return 0.0
            dent = depth
            push = stiffness * depth + damping * inwards * velocity
            return 0.0 if push <= 0.0 else -inwards * push

        return force

    def penetration(self, position: float) -> float:
        """Return the depth of the handle in the tissue [m or rad]."""
        return below(position, self.position, self.side)

    def stored(self, position: float) -> float:
        """Return the largest energy of the springs when the handle is at `position` [J]."""
        return 0.5 * self.stiffness * self.penetration(position) ** 2

    def linearised(self) -> StateSpace:
        """Return the spring-damper that is felt in contact."""
        return gain([[-self.stiffness, -self.damping]])

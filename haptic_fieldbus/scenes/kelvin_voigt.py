"""Kelvin–Voigt tissue: a spring and a damper side by side under a free surface.

Touched at the depth d = ±(x − position) it pushes K·d + B·ḋ. When the tool leaves faster than the dent s comes back,
which it does by K·s + B·ṡ = 0, with the time constant B/K, it is free of the tissue, and feels it again where the dent
has come to: never a pull, and unlike a wall with a damper no push from tissue that is not there yet.
(Fung, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., 1993, chapter 2.)

In continuous time it stores K·s²/2 and dissipates B·ṡ², in the hand or alone: passive. The dent's own way is stepped
exactly, by e^(−K·T/B) a period, whatever T. Sampled and held it leaks as a spring and a damper do, K·Σ(Δx)²/2 and
B·|v·Δx| where velocity and way disagree, and where the tool meets a dent between two samples once more the spring's
force there times the way into it, at most K·s·|Δx|.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, Place, PositiveDamping, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class KelvinVoigt:
    """Tissue from `position` [m or rad] on: `stiffness` [N/m or N·m/rad] and `damping` [N·s/m or N·m·s/rad].

    `side` is where the tissue lies.
    """

    axis: str
    stiffness: Stiffness
    damping: PositiveDamping
    position: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "kelvin_voigt"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.VELOCITY)

    def begin(self, period: float) -> Law:
        """Remembers the dent."""
        inwards = 1.0 if self.side == "positive" else -1.0
        surface, stiffness, damping = self.position, self.stiffness, self.damping
        kept = math.exp(-period * (stiffness / damping))
        dent = 0.0

        def force(position: float, velocity: float) -> float:
            nonlocal dent
            depth = inwards * (position - surface)
            dent *= kept
            if depth <= dent:
                return 0.0
            dent = depth
            push = stiffness * depth + damping * inwards * velocity
            return 0.0 if push <= 0.0 else -inwards * push

        return force

    def linearised(self) -> StateSpace:
        """The spring-damper that is felt in contact."""
        return gain([[-self.stiffness, -self.damping]])

"""A standard linear solid: a spring, and beside it one that relaxes; stiff to the quick, soft to the patient.

Touched at the depth d = ±(x − position) it pushes k₀·d + k·(d − q) with q̇ = (d − q)/τ: k₀ + k at once, k₀ in the end,
and k₀·D + k·D·e^(−t/τ) after a press to D. Left faster than it recovers it lets go and is met again where its surface
has come to: never a pull. (Zener's model; Fung, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., 1993,
chapter 2.)

In continuous time it is passive; each period is stepped exactly for a straight way, so a relaxation time far below the
period does no harm (`numerics.relaxation`, both with their reason). Sampled and held it leaks about half and at most
all of |ΔF·Δx| in each period, ΔF the change of its force in it: for slow branches K·Σ(Δx)²/2 at K = k₀ + k.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.relaxation import bind_surface, pressed
from haptic_fieldbus.scenes.element import STRICT, Duration, Law, Place, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class StandardLinearSolid:
    """Tissue from `position` [m or rad] on: `rest` that stays, `branch` [N/m or N·m/rad] that relaxes in `time` [s].

    `side` is where the tissue lies.
    """

    axis: str
    rest: Stiffness
    branch: Stiffness
    time: Duration
    position: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "standard_linear_solid"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Remembers the dent and the relaxed part of it."""
        inwards = 1.0 if self.side == "positive" else -1.0
        surface, push = self.position, bind_surface(self.rest, ((self.branch, self.time),), period)
        return lambda position: 0.0 - inwards * push(inwards * (position - surface))

    @property
    def stiffness(self) -> float:
        """At once, before anything relaxes [N/m or N·m/rad]."""
        return self.rest + self.branch

    def with_stiffness(self, stiffness: float) -> Self:
        factor = stiffness / self.stiffness
        return replace(self, rest=factor * self.rest, branch=factor * self.branch)

    def linearised(self) -> StateSpace:
        """The tissue in sustained contact: linear, one state."""
        return pressed(self.rest, ((self.branch, self.time),))

"""A wall that knows that its force is held: it gives the mean of the force that is due while it is held.

A wall's force is computed from the position now and held for a period T, in which the handle moves on: on average it is
half a period old. If the handle keeps its velocity v, the depth d = ±(x − p) runs from d to e = d + 2·a·v during the
hold, with the lead a = T/2, and the mean of the wall's force over that way is

| where                 | push = −F, out of the material               |
|-----------------------|----------------------------------------------|
| d and e inside        | K·(d + a·v): half-sample prediction          |
| one of them inside, m | K·m²/(2·|e − d|): the part of the way inside |
| both outside          | 0                                            |

and −B·v besides, never a pull. The first row is the half-sample prediction of Gillespie & Cutkosky (Stable
user-specific haptic rendering of the virtual wall, ASME IMECE 1996, DSC-58, 397), who name the second row's cause too:
the surface is crossed between two samples. With `release = "deadbeat"` a period at whose end the handle is predicted
outside has no force at all. (Their deadbeat controller steers device and hand to where the ideal wall would have left
them, and needs a model of the hand; this one needs none, and gives away the rest of the spring instead.)

Energy, B = 0. Over one period of constant velocity with T = 2·a the held force does exactly the work of the continuous
spring, crossings included: no leak, where the plain wall leaks up to K·(v·T)²/2 a crossing. Deadbeat release gives back
less, by what is stored at the last sample inside. In the first case, with acceleration up to A the leak of a period is
at most ½·K·A·T²·(its way + |v|·T), third order in T where the plain wall's K·(v·T)²/2 is second. All that holds for the
true velocity: a backward difference is itself half a period late, and cures the leak only in part.

In continuous time it is, inside, the wall with the damping K·a + B, and passive everywhere.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damping, Duration, Place, Stiffness
from haptic_fieldbus.signals import Signal

LEAD = 0.0005
"""[s]; half a period at 1 kHz."""


@dataclass(frozen=True)
class PredictedWall:
    """A wall at `position` [m or rad]: `stiffness` [N/m or N·m/rad], `damping` [N·s/m or N·m·s/rad], `lead` [s].

    `lead` is half the period of the loop unless given; outside of a loop 0.5 ms. `release` "deadbeat" gives no force to
    a handle that will be out by the next sample. `side` is where its material lies, seen from `position`.
    """

    axis: str
    stiffness: Stiffness
    position: Place = 0.0
    damping: Damping = 0.0
    lead: Duration | None = None
    release: Literal["spring", "deadbeat"] = "spring"
    side: Literal["positive", "negative"] = "positive"
    name: str = "predicted_wall"
    __pydantic_config__: ClassVar = STRICT

    def at_period(self, period: float) -> Self:
        """The wall in a loop of this period [s]."""
        return self if self.lead is not None else replace(self, lead=0.5 * period)

    @property
    def _ahead(self) -> float:
        return LEAD if self.lead is None else self.lead

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.VELOCITY)

    def force(self, position: float, velocity: float) -> float:
        """Force or torque on the handle [N or N·m]; not-a-number in gives not-a-number out."""
        inwards = 1.0 if self.side == "positive" else -1.0
        begin = inwards * (position - self.position)
        end = begin + 2.0 * self._ahead * inwards * velocity
        if end <= 0.0 and (begin <= 0.0 or self.release == "deadbeat"):
            return 0.0
        push = self.stiffness * _mean_depth(begin, end) + self.damping * inwards * velocity
        return 0.0 if push <= 0.0 else -inwards * push

    def linearised(self) -> StateSpace:
        """The spring-damper that is felt inside."""
        return gain([[-self.stiffness, -self.damping - self.stiffness * self._ahead]])


def _mean_depth(begin: float, end: float) -> float:
    """Mean of max(0, depth) on the straight way between two depths of which one at least is above 0 [m or rad]."""
    if begin >= 0.0 and end >= 0.0:
        return 0.5 * (begin + end)
    inside, outside = (begin, end) if begin > end else (end, begin)
    return 0.5 * inside * (inside / (inside - outside))

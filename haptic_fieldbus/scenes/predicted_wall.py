"""A wall that compensates the hold: it applies the mean of the ideal force over the hold.

The force of a wall is computed from the present position and held for a period T, in which the handle moves on: on
average it is half a period old. If the handle keeps its velocity v, the depth d = ±(x − p) runs from d to e = d + 2·a·v
during the hold, with the lead a = T/2. The mean of the wall's force over that distance is

| where                 | push = −F, out of the material               |
|-----------------------|----------------------------------------------|
| d and e inside        | K·(d + a·v): half-sample prediction          |
| one of them inside, m | K·m²/(2·|e − d|): the part of the way inside |
| both outside          | 0                                            |

plus −B·v, and never a pull. The first row is the half-sample prediction of Gillespie & Cutkosky (Stable user-specific
haptic rendering of the virtual wall, ASME IMECE 1996, DSC-58, 397), who also name the cause of the second row: the
surface is crossed between two samples. With `release = "deadbeat"` there is no force in a period at whose end the
handle is predicted outside. (Their deadbeat controller steers device and hand to where the ideal wall would have left
them, and needs a model of the hand; this release needs none, and gives up the rest of the spring's energy instead.)

Energy, B = 0. Over a period of constant velocity with T = 2·a the held force does exactly the work of the continuous
spring, crossings included: there is no leak, where the plain wall leaks up to K·(v·T)²/2 at a crossing. Deadbeat
release gives back less, by the energy stored at the last sample inside. In the first row, with acceleration up to A,
the leak of a period is at most ½·K·A·T²·(its distance + |v|·T): third order in T, where the plain wall's K·(v·T)²/2 is
second. All this holds for the true velocity: a backward difference is itself half a period late, and cures the leak
only in part.

In continuous time the element is, inside, the wall with the damping K·a + B, and it is passive everywhere.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damping, Duration, Place, Stiffness, below
from haptic_fieldbus.signals import Signal

LEAD = 0.0005
"""Lead of an element outside of a loop [s]: half a period at 1 kHz."""


@dataclass(frozen=True)
class PredictedWall:
    """A wall at `position` [m or rad]: `stiffness` [N/m or N·m/rad], `damping` [N·s/m or N·m·s/rad], `lead` [s].

    `lead` defaults to half the period of the loop, and to 0.5 ms outside a loop. With `release` "deadbeat" the force is
    0 if the handle will be outside at the next sample. `side` is the side of `position` with the material.
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
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION, Signal.VELOCITY)

    def at_period(self, period: float) -> Self:
        """Return the wall for a loop of this period [s]: with half of it as `lead`, unless one is given."""
        return self if self.lead is not None else replace(self, lead=0.5 * period)

    @property
    def _ahead(self) -> float:
        return LEAD if self.lead is None else self.lead

    def force(self, position: float, velocity: float) -> float:
        """Return the force or torque on the handle [N or N·m]; not-a-number as position gives not-a-number."""
        inwards = 1.0 if self.side == "positive" else -1.0
        begin = inwards * (position - self.position)
        end = begin + 2.0 * self._ahead * inwards * velocity
        if end <= 0.0 and (begin <= 0.0 or self.release == "deadbeat"):
            return 0.0
        push = self.stiffness * _mean_depth(begin, end) + self.damping * inwards * velocity
        return 0.0 if push <= 0.0 else -inwards * push

    def penetration(self, position: float) -> float:
        """Return the depth of the handle in the wall [m or rad]."""
        return below(position, self.position, self.side)

    def stored(self, position: float) -> float:
        """Return the largest energy of the springs when the handle is at `position` [J]."""
        return 0.5 * self.stiffness * self.penetration(position) ** 2

    @property
    def increments(self) -> tuple[float, float]:
        """Return stiffness and damping; the prediction adds K · lead to the damping, a deadbeat release twice that."""
        share = 2.0 if self.release == "deadbeat" else 1.0
        return self.stiffness, self.damping + share * self.stiffness * self._ahead

    def linearised(self) -> StateSpace:
        """Return the spring-damper that is felt inside."""
        return gain([[-self.stiffness, -self.damping - self.stiffness * self._ahead]])


def _mean_depth(begin: float, end: float) -> float:
    """Return the mean of max(0, depth) on the straight line between two depths [m or rad], one at least above 0."""
    if begin >= 0.0 and end >= 0.0:
        return 0.5 * (begin + end)
    inside, outside = (begin, end) if begin > end else (end, begin)
    # The mean depth of the part inside, times its share of the line.
    return 0.5 * inside * (inside / (inside - outside))

"""A standard linear solid: a spring parallel to a branch that relaxes; stiff at first, soft in the long run.

At the depth d = ±(x − position) the touched tissue pushes k₀·d + k·(d − q) with q̇ = (d − q)/τ. Its stiffness is k₀ + k
at once and k₀ in the end; after a press to D the push is k₀·D + k·D·e^(−t/τ). A tool that leaves faster than the tissue
recovers loses contact, and meets the surface again where it has recovered to: the tissue never pulls. (Zener's model;
Fung, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., 1993, chapter 2.)

In continuous time it is passive. Each period is stepped exactly for motion on a straight line, so a relaxation time far
below the period does no harm (`numerics.relaxation` explains both). Sampled and held, the tissue leaks about half and
at most all of |ΔF·Δx| in each period, where ΔF is the change of its force within the period: for slow branches
K·Σ(Δx)²/2 at K = k₀ + k.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.relaxation import bind_surface, pressed
from haptic_fieldbus.scenes.element import STRICT, Duration, Law, Place, Stiffness, below
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class StandardLinearSolid:
    """Tissue from `position` [m or rad] on: a spring `rest`, and a spring `branch` that relaxes in `time` [s].

    Both springs are in N/m or N·m/rad. `side` is the side on which the tissue lies.
    """

    axis: str
    rest: Stiffness
    branch: Stiffness
    time: Duration
    position: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "standard_linear_solid"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return a law that remembers the dent and its relaxed part."""
        inwards = 1.0 if self.side == "positive" else -1.0
        surface, push = self.position, bind_surface(self.rest, ((self.branch, self.time),), period)
        # 0.0 − x and not −x: without contact the force is 0.0, never −0.0.
        return lambda position: 0.0 - inwards * push(inwards * (position - surface))

    @property
    def stiffness(self) -> float:
        """The stiffness before anything relaxes [N/m or N·m/rad]."""
        return self.rest + self.branch

    def with_stiffness(self, stiffness: float) -> Self:
        factor = stiffness / self.stiffness
        return replace(self, rest=factor * self.rest, branch=factor * self.branch)

    def penetration(self, position: float) -> float:
        """Return the depth of the handle in the tissue [m or rad]."""
        return below(position, self.position, self.side)

    def stored(self, position: float) -> float:
        """Return the largest energy of the springs when the handle is at `position` [J]."""
        return 0.5 * self.stiffness * self.penetration(position) ** 2

    def linearised(self) -> StateSpace:
        """Return the tissue in sustained contact, which is linear with one state."""
        return pressed(self.rest, ((self.branch, self.time),))

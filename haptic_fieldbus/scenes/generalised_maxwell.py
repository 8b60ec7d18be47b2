"""Tissue that relaxes: a spring parallel to any number of branches, each with its own relaxation time.

At the depth d = ±(x − position) the touched tissue pushes k₀·d + Σ k·(d − q) with q̇ = (d − q)/τ in each branch; after
a press to D that is k₀·D + Σ k·D·e^(−t/τ), Wiechert's model. A tool that leaves faster than the tissue recovers loses
contact, and meets the surface again where it has recovered to: the tissue never pulls. (Fung, Biomechanics: Mechanical
Properties of Living Tissues, 2nd ed., 1993, chapters 2 and 7.)

In continuous time it is passive. Each period is stepped exactly for motion on a straight line, so a branch far faster
than the period neither explodes (forward Euler) nor rings (trapezoid): it acts as the damper k·τ, as it should
(`numerics.relaxation`). Sampled and held, the tissue leaks about half and at most all of |ΔF·Δx| in each period, where
ΔF is the change of its force within the period: for slow branches K·Σ(Δx)²/2 at K = k₀ + Σ k.
"""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Len

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.relaxation import bind_surface, pressed
from haptic_fieldbus.scenes.element import STRICT, Duration, Law, Place, Stiffness, below
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class GeneralisedMaxwell:
    """Tissue from `position` [m or rad] on: a spring `rest` [N/m or N·m/rad] and `branches` that relax.

    Each branch is a pair [stiffness, relaxation time] in [N/m or N·m/rad] and [s]. `side` is the side of `position`
    with the tissue.
    """

    axis: str
    rest: Stiffness
    branches: Annotated[tuple[tuple[Stiffness, Duration], ...], Len(1)]
    position: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "generalised_maxwell"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return a law that remembers the dent and the relaxed part of each branch."""
        inwards = 1.0 if self.side == "positive" else -1.0
        surface, push = self.position, bind_surface(self.rest, self.branches, period)
        # 0.0 − x and not −x: without contact the force is 0.0, never −0.0.
        return lambda position: 0.0 - inwards * push(inwards * (position - surface))

    @property
    def stiffness(self) -> float:
        """The stiffness before anything relaxes [N/m or N·m/rad]."""
        return self.rest + sum(k for k, _ in self.branches)

    def with_stiffness(self, stiffness: float) -> Self:
        factor = stiffness / self.stiffness
        return replace(self, rest=factor * self.rest, branches=tuple((factor * k, tau) for k, tau in self.branches))

    def penetration(self, position: float) -> float:
        """Return the depth of the handle in the tissue [m or rad]."""
        return below(position, self.position, self.side)

    def stored(self, position: float) -> float:
        """Return the largest energy of the springs when the handle is at `position` [J]."""
        return 0.5 * self.stiffness * self.penetration(position) ** 2

    def linearised(self) -> StateSpace:
        """Return the tissue in sustained contact, which is linear with one state for each branch."""
        return pressed(self.rest, self.branches)

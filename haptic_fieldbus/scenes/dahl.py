"""Dahl friction: a spring that yields smoothly into Coulomb friction, with hysteresis.

A bristle of stiffness σ stretches with the handle and slides at the force fc (L = fc/σ):

    F = −σ·z,   dz/dx = 1 − (z/L)·sign(dx)

(P. R. Dahl, Solid friction damping of mechanical vibrations, AIAA Journal 14(12), 1976, 1675, with exponent 1). F
opposes the recent motion: after a path of several L towards positive positions it is −fc. Only the path counts, not the
time, so the law needs no velocity; each period is stepped exactly (`numerics.relaxation`), and |F| ≤ fc at any speed.

Energy. With ½·σ·z² stored the element only takes energy: d(½·σ·z²) = −F·dx − (σ²·z²/fc)·|dx|, so it is passive. Sampled
and held, it gives at most 1.092·½·σ·Δx² in each period, 9 % more than a spring of that stiffness; a device of damping b
absorbs that where σ ≤ 1.83·b/T. The slope is 2·σ just after a reversal and 0 just before. A small oscillation about any
stretch meets σ on average, so stability is judged with σ.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.relaxation import bind
from haptic_fieldbus.scenes.element import STRICT, Law, PositiveEffort, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Dahl:
    """Friction `coulomb` [N or N·m] behind a bristle of `stiffness` [N/m or N·m/rad] that is relaxed at the start."""

    axis: str
    coulomb: PositiveEffort
    stiffness: Stiffness
    name: str = "dahl"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return the law from position to force or torque on the handle [N or N·m]; the same for every period."""
        return bind(self.stiffness, self.coulomb)

    @property
    def reserve(self) -> float:
        """Largest energy that the bristle can hold [J]."""
        return 0.5 * self.coulomb**2 / self.stiffness

    @property
    def increments(self) -> tuple[float, float]:
        """Return the slope just after a reversal, and no damping."""
        return 2.0 * self.stiffness, 0.0

    def linearised(self) -> StateSpace:
        """Return the spring of the bristle before it slides."""
        return gain([[-self.stiffness, 0.0]])

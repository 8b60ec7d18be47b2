"""Dahl friction: a spring that yields into Coulomb friction, smoothly, and remembers the way.

A bristle of stiffness σ stretches with the handle and slides at the force fc (L = fc/σ):

    F = −σ·z,   dz/dx = 1 − (z/L)·sign(dx)

(P. R. Dahl, Solid friction damping of mechanical vibrations, AIAA Journal 14(12), 1976, 1675, with exponent 1). F is
against the way behind: after a way of several L towards positive positions it is −fc. Only the way counts, not the
time, so the law needs no velocity; each period is stepped exactly (`numerics.bristle`), and |F| ≤ fc at any speed.

Energy. With ½·σ·z² stored it only takes: d(½·σ·z²) = −F·dx − (σ²·z²/fc)·|dx|, so it is passive. Sampled and held, it
gives at most 1.092·½·σ·Δx² in each period: the leak of a spring of that stiffness and 9 %, which a device of damping b
takes where σ ≤ 1.83·b/T. The slope is 2·σ just after a reversal and 0 just before; a small swing about any stretch
meets σ in the mean, and that is what stability is told.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.bristle import bind
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, PositiveEffort, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Dahl:
    """`coulomb` friction [N or N·m] behind a bristle of `stiffness` [N/m or N·m/rad], relaxed at the start."""

    axis: str
    coulomb: PositiveEffort
    stiffness: Stiffness
    name: str = "dahl"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Position → force or torque on the handle [N or N·m]; the same for every period."""
        return bind(self.stiffness, self.coulomb)

    def linearised(self) -> StateSpace:
        """The bristle, before it slides."""
        return gain([[-self.stiffness, 0.0]])

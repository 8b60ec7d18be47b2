"""LuGre friction: a damped bristle, the Stribeck effect from breakaway to sliding, and viscous friction.

    F = −(σ0·z + σ1(v)·ż + σ2·v),   ż = v − σ0·|v|·z/g(v),   g(v) = fc + (fs − fc)·e^(−(v/vs)²)

(Canudas de Wit, Olsson, Åström & Lischinsky, IEEE Trans. Automatic Control 40(3), 1995, 419). F opposes the motion; in
steady sliding it is −(g(v)·sign(v) + σ2·v).

Each period steps the bristle along the path of the handle, exactly for the g(v) at its end (`numerics.relaxation`). The
stretch stays bounded at any speed, where the explicit step explodes above |v| = 2·g/(σ0·T). A scene without Stribeck's
fall, σ1 and σ2 needs no velocity.

Passivity. With ½·σ0·z² stored, F takes energy at every v and z when σ1²·|v| ≤ 4·g(v)·(σ1 + σ2). A constant σ1 violates
that at high speed, and then gives energy when v rises fast and fs > fc. The usual remedy is a σ1 that falls with speed:
here σ1(v) = min(σ1, g(v)/|v|), at most a quarter of the allowed value, which also keeps |σ0·z + σ1·ż| ≤ fs. So all but
the viscous part is bounded by the breakaway force. Sampled and held, the bristle gives at most 1.092·½·σ0·Δx² in each
period; the dampers give as much as any held damper, σ1 at most (1 + fs/fc) times. A device of damping b absorbs that
where b > 0.546·σ0·T + (1 + fs/fc)·σ1 + σ2.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.condition import check_breakaway
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.relaxation import advance, bind
from haptic_fieldbus.scenes.element import STRICT, Damping, Effort, Law, NonNegativeSpeed, PositiveEffort, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class LuGre:
    """A bristle of `stiffness` σ0 [N/m or N·m/rad] and `damping` σ1, with `viscous` friction σ2 [N·s/m or N·m·s/rad].

    The bristle slides at `coulomb` fc and breaks away at `breakaway` fs [N or N·m]. A `breakaway` of 0, or equal to
    `coulomb`, disables the Stribeck effect; `stribeck` vs [m/s or rad/s] has no effect then.
    """

    axis: str
    coulomb: PositiveEffort
    stiffness: Stiffness
    breakaway: Effort = 0.0
    stribeck: NonNegativeSpeed = 0.0
    damping: Damping = 0.0
    viscous: Damping = 0.0
    name: str = "lugre"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        """Raise ValueError when `breakaway` is below `coulomb`, or above it without a `stribeck` speed."""
        check_breakaway(self.breakaway, self.coulomb, "stribeck", self.stribeck)

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Position, and velocity only for Stribeck's fall or the dampers."""
        by_speed = self.breakaway > self.coulomb or self.damping or self.viscous
        return (Signal.POSITION, Signal.VELOCITY) if by_speed else (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return the law: position and, if needed, velocity → force or torque [N or N·m]; the same for every period."""
        if Signal.VELOCITY not in self.needs:
            return bind(self.stiffness, self.coulomb)
        return self._at_speeds()

    def level(self, velocity: float) -> float:
        """Return g(v), the friction of steady sliding without the viscous part [N or N·m]."""
        if self.breakaway <= self.coulomb:
            return self.coulomb
        relative = velocity / self.stribeck
        return self.coulomb + (self.breakaway - self.coulomb) * math.exp(-relative * relative)

    def _at_speeds(self) -> Law:
        stiffness, damping, viscous, level = self.stiffness, self.damping, self.viscous, self.level
        stretch = 0.0
        before: float | None = None

        def law(position: float, velocity: float) -> float:
            nonlocal stretch, before
            friction = level(velocity)
            # At the first call there is no motion yet: the bristle is relaxed where the handle is.
            stretch = advance(stretch, position - (position if before is None else before), friction / stiffness)
            before = position
            spring = stiffness * stretch
            # σ1(v)·v has the direction of v and never exceeds g. The factor below is ż/v = 1 − σ0·z·sign(v)/g.
            dashpot = max(min(damping * velocity, friction), -friction)
            return -spring - dashpot * (1.0 - spring * math.copysign(1.0, velocity) / friction) - viscous * velocity

        return law

    @property
    def reserve(self) -> float:
        """Largest energy that the bristle can hold [J]."""
        return 0.5 * max(self.breakaway, self.coulomb) ** 2 / self.stiffness

    @property
    def increments(self) -> tuple[float, float] | None:
        """Return the slope just after a reversal; None with Stribeck's fall or dampers, which no such bound holds."""
        return None if Signal.VELOCITY in self.needs else (2.0 * self.stiffness, 0.0)

    def linearised(self) -> StateSpace:
        """Return the bristle before it slides, with all dampers."""
        return gain([[-self.stiffness, -(self.damping + self.viscous)]])

"""LuGre friction: a bristle with damping, Stribeck's fall from breakaway to sliding, and viscous friction.

    F = −(σ0·z + σ1(v)·ż + σ2·v),   ż = v − σ0·|v|·z/g(v),   g(v) = fc + (fs − fc)·e^(−(v/vs)²)

(Canudas de Wit, Olsson, Åström & Lischinsky, IEEE Trans. Automatic Control 40(3), 1995, 419). F is against the motion;
sliding steadily it is −(g(v)·sign(v) + σ2·v).

Each period steps the bristle along the way that the handle went, exactly for the g(v) of its end (`numerics.bristle`):
it stays bounded at any speed, where the explicit step explodes above |v| = 2·g/(σ0·T). A scene without Stribeck, σ1 and
σ2 needs no velocity.

Passivity. With ½·σ0·z² stored, F takes energy at every v and z when σ1²·|v| ≤ 4·g(v)·(σ1 + σ2); a constant σ1 breaks
that at high speed, and then gives energy when v rises fast and fs > fc. The usual remedy is a σ1 that falls with speed:
here σ1(v) = min(σ1, g(v)/|v|), at most a quarter of what is allowed, which also keeps |σ0·z + σ1·ż| ≤ fs. So all but
the viscous part is bounded by the breakaway force. Sampled and held, the bristle gives at most 1.092·½·σ0·Δx² in each
period, and the dampers what any held damper gives, σ1 at most (1 + fs/fc) times: a device of damping b takes it where
b > 0.546·σ0·T + (1 + fs/fc)·σ1 + σ2.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.bristle import advance, bind
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damping, Effort, Law, NonNegativeSpeed, PositiveEffort, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class LuGre:
    """Bristle of `stiffness` σ0 [N/m or N·m/rad] and `damping` σ1, `viscous` σ2 [N·s/m or N·m·s/rad].

    `coulomb` fc and `breakaway` fs [N or N·m]; 0, or as much as `coulomb`, leaves Stribeck's fall out, and then
    `stribeck` vs [m/s or rad/s] means nothing.
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
        if 0.0 < self.breakaway < self.coulomb:
            raise ValueError(
                f"breakaway {exactly(self.breakaway)}: expected 0, or at least coulomb, {exactly(self.coulomb)}"
            )
        if self.breakaway > self.coulomb and not self.stribeck:
            raise ValueError(
                f"stribeck {exactly(self.stribeck)}: expected a speed above 0, as breakaway is above coulomb"
            )

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Velocity only for Stribeck's fall and for the dampers."""
        by_speed = self.breakaway > self.coulomb or self.damping or self.viscous
        return (Signal.POSITION, Signal.VELOCITY) if by_speed else (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Position and, if needed, velocity → force or torque on the handle [N or N·m]; the same for every period."""
        if Signal.VELOCITY not in self.needs:
            return bind(self.stiffness, self.coulomb)
        return self._at_speeds()

    def level(self, velocity: float) -> float:
        """g(v): the friction [N or N·m] of steady sliding, without the viscous part."""
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
            stretch = advance(stretch, position - (position if before is None else before), friction / stiffness)
            before = position
            spring = stiffness * stretch
            # σ1(v)·v, in the direction of v and never above g; ż/v = 1 − σ0·z·sign(v)/g
            dashpot = max(min(damping * velocity, friction), -friction)
            return -spring - dashpot * (1.0 - spring * math.copysign(1.0, velocity) / friction) - viscous * velocity

        return law

    def linearised(self) -> StateSpace:
        """The bristle and its dampers, before it slides."""
        return gain([[-self.stiffness, -(self.damping + self.viscous)]])

"""Dry friction that sticks: Coulomb and viscous friction with Karnopp's window around zero velocity.

A plain −fc·sign(v) gives, sampled, a force of the wrong sign after each reversal, and chatters at rest. Karnopp (ASME
J. Dyn. Syst. Meas. Control 107(1), 1985, 100) sets the velocity to zero inside a window |v| ≤ Dv and lets friction
balance the other forces up to the breakaway force fs; outside, friction is fc. A haptic device does not measure the
force of the hand, so here a spring of `stiffness` K from the stick point a does the balancing (as with Salcudean &
Vlaar, ASME J. Dyn. Syst. Meas. Control 119(1), 1997, 127), and the stick point is dragged along where the spring would
pass the limit (Hayward & Armstrong, Experimental Robotics VI, Springer 2000, 403):

    F = −K·(x − a) − B·v,   |x − a| ≤ fs/K where |v| ≤ Dv, else fc/K

So sliding needs no sign of a velocity, and the force never jumps but for the fall from fs to fc at the edge of the
window. Without fs and B the law needs no velocity at all.

Energy. With ½·K·(x − a)² stored it only takes, as dragging only shortens the spring: passive. Sampled and held, the
spring gives at most ½·K·Δx² in each period, whatever an estimate says of v, for |x − a| is never longer after a period
than the way alone would make it. That is the leak of a wall's spring, and a device of damping b takes it while
b > K·T/2 + B. The force is at most fs + B·|v| at any speed.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Damping, Effort, Law, NonNegativeSpeed, PositiveEffort, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Friction:
    """`coulomb` friction fc [N or N·m] that sticks by a spring of `stiffness` K [N/m or N·m/rad].

    `breakaway` fs [N or N·m] holds below the `window` Dv [m/s or rad/s]; 0, or as much as `coulomb`, leaves both out.
    `damping` B [N·s/m or N·m·s/rad] is viscous friction.
    """

    axis: str
    coulomb: PositiveEffort
    stiffness: Stiffness
    breakaway: Effort = 0.0
    window: NonNegativeSpeed = 0.0
    damping: Damping = 0.0
    name: str = "friction"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        if 0.0 < self.breakaway < self.coulomb:
            raise ValueError(f"breakaway {self.breakaway:g}: expected 0, or at least coulomb, {self.coulomb:g}")
        if self.breakaway > self.coulomb and not self.window:
            raise ValueError(f"window {self.window:g}: expected a speed above 0, as breakaway is above coulomb")

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Velocity only for the window and for viscous friction."""
        by_speed = self.breakaway > self.coulomb or self.damping
        return (Signal.POSITION, Signal.VELOCITY) if by_speed else (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Position and, if needed, velocity → force or torque on the handle [N or N·m]; the same for every period."""
        stiffness, damping, window = self.stiffness, self.damping, self.window
        sliding = self.coulomb / stiffness
        sticking = max(self.breakaway, self.coulomb) / stiffness
        anchor: float | None = None

        def held(position: float, longest: float) -> float:
            """The order of the arguments of min and max lets not-a-number through."""
            nonlocal anchor
            stretch = 0.0 * position if anchor is None else max(min(position - anchor, longest), -longest)
            anchor = position - stretch
            return -stiffness * stretch

        def at_speeds(position: float, velocity: float) -> float:
            return held(position, sticking if -window <= velocity <= window else sliding) - damping * velocity

        def at_any_speed(position: float) -> float:
            return held(position, sliding)

        return at_speeds if Signal.VELOCITY in self.needs else at_any_speed

    def linearised(self) -> StateSpace:
        """Sticking."""
        return gain([[-self.stiffness, -self.damping]])

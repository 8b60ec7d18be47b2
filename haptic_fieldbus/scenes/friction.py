"""Dry friction that sticks, with Karnopp's window around zero velocity: the friction condition of USB PID.

A plain −fc·sign(v) gives, sampled, a force of the wrong sign after each reversal, and chatters at rest. Karnopp (ASME
J. Dyn. Syst. Meas. Control 107(1), 1985, 100) sets the velocity to zero inside a window |v| ≤ Dv and lets friction
balance the other forces up to the breakaway force fs; outside, friction is fc. A haptic device does not measure the
force of the hand, so here a spring of `stiffness` K from the stick point a does the balancing (as with Salcudean &
Vlaar, ASME J. Dyn. Syst. Meas. Control 119(1), 1997, 127), and the stick point is dragged along where the spring would
pass the limit (Hayward & Armstrong, Experimental Robotics VI, Springer 2000, 403):

    F = −K·(x − a) − B·v,   |x − a| ≤ fs/K where |v| ≤ Dv, else fc/K

So sliding needs no sign of a velocity, and the force never jumps but for the fall from fs to fc at the edge of the
window. Without fs and B the law needs no velocity at all.

Conditions (USB Device Class Definition for Physical Interface Devices 1.0; in physical units here). The saturation is
fc. The positive and the negative coefficient c₊, c₋ are shares of fc and fs, of the friction against ways towards
positive and towards negative. The metric here is s = x − a, and the dead band w a play about the stick point without a
force: friction takes hold after a way of w from rest, and of 2·w between both directions. With them

    F = −K·(s − w) − B·v above w, −K·(s + w) − B·v below −w, else −B·v;   −w − c₋·f/K ≤ s ≤ w + c₊·f/K

with f = fs inside the window, else fc. A CP offset has no meaning here, as no place is neutral.

Energy. With U = ½·K·(|s| − w)² stored beyond w it only takes, as dragging only brings s nearer to 0, whatever the
limit of either side: passive. Sampled and held, it gives at most ½·K·Δx² in each period, whatever an estimate says of
v, for the slope of U' is at most K, and s is never further from 0 after a period than the way alone would bring it.
That is the leak of a wall's spring, and a device of damping b takes it while b > K·T/2 + B. The force is at most
fs + B·|v| at any speed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics import condition
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import (
    STRICT,
    Damping,
    Effort,
    Law,
    NonNegativeLength,
    NonNegativeSpeed,
    PositiveEffort,
    Share,
    Stiffness,
)
from haptic_fieldbus.signals import Signal

Limit = TypeVar("Limit")


@dataclass(frozen=True)
class Friction:
    """`coulomb` friction fc [N or N·m] that sticks by a spring of `stiffness` K [N/m or N·m/rad].

    `breakaway` fs [N or N·m] holds below the `window` Dv [m/s or rad/s]; 0, or as much as `coulomb`, leaves both out.
    `damping` B [N·s/m or N·m·s/rad] is viscous friction. The coefficients are the shares of coulomb and breakaway, not
    of damping, when the handle moves towards positive and towards negative; one of them is 1. `dead_band` [m or rad] is
    a play on either side of the stick point: friction takes hold only after that way, and after twice as much from one
    direction to the other. What USB PID calls saturation is `coulomb`.
    """

    axis: str
    coulomb: PositiveEffort
    stiffness: Stiffness
    breakaway: Effort = 0.0
    window: NonNegativeSpeed = 0.0
    damping: Damping = 0.0
    positive_coefficient: Share = 1.0
    negative_coefficient: Share = 1.0
    dead_band: NonNegativeLength = 0.0
    name: str = "friction"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        if 0.0 < self.breakaway < self.coulomb:
            raise ValueError(
                f"breakaway {exactly(self.breakaway)}: expected 0, or at least coulomb, {exactly(self.coulomb)}"
            )
        if self.breakaway > self.coulomb and not self.window:
            raise ValueError(f"window {exactly(self.window)}: expected a speed above 0, as breakaway is above coulomb")
        condition.check_coefficients(self.positive_coefficient, self.negative_coefficient, "coulomb")

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Velocity only for the window and for viscous friction."""
        by_speed = self.breakaway > self.coulomb or self.damping
        return (Signal.POSITION, Signal.VELOCITY) if by_speed else (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Position and, if needed, velocity → force or torque on the handle [N or N·m]; the same for every period."""
        breakaway = max(self.breakaway, self.coulomb)
        if self.dead_band or self.positive_coefficient != self.negative_coefficient:
            return self._by_speed(self._sided(), self._ends(self.coulomb), self._ends(breakaway))
        return self._by_speed(self._even(), self.coulomb / self.stiffness, breakaway / self.stiffness)

    def _by_speed(self, held: Callable[[float, Limit], float], sliding: Limit, sticking: Limit) -> Law:
        """The spring of the stick point with the limit that goes with the speed, and damping."""
        damping, window = self.damping, self.window

        def at_speeds(position: float, velocity: float) -> float:
            return held(position, sticking if -window <= velocity <= window else sliding) - damping * velocity

        def at_any_speed(position: float) -> float:
            return held(position, sliding)

        return at_speeds if Signal.VELOCITY in self.needs else at_any_speed

    def _even(self) -> Callable[[float, float], float]:
        stiffness = self.stiffness
        anchor: float | None = None

        def held(position: float, longest: float) -> float:
            """The order of the arguments of min and max lets not-a-number through."""
            nonlocal anchor
            stretch = 0.0 * position if anchor is None else max(min(position - anchor, longest), -longest)
            anchor = position - stretch
            return -stiffness * stretch

        return held

    def _ends(self, effort: float) -> tuple[float, float]:
        """The lowest and the highest x − a."""
        longest, play = effort / self.stiffness, self.dead_band
        return -play - self.negative_coefficient * longest, play + self.positive_coefficient * longest

    def _sided(self) -> Callable[[float, tuple[float, float]], float]:
        stiffness, play = self.stiffness, self.dead_band
        anchor: float | None = None

        def held(position: float, ends: tuple[float, float]) -> float:
            """Not-a-number goes through, as above: also through what is left of the stretch beyond the play."""
            nonlocal anchor
            lowest, highest = ends
            stretch = 0.0 * position if anchor is None else max(min(position - anchor, highest), lowest)
            anchor = position - stretch
            return -stiffness * (stretch - max(min(stretch, play), -play))

        return held

    def linearised(self) -> StateSpace:
        """Sticking, beyond the dead band."""
        return gain([[-self.stiffness, -self.damping]])

"""Dry friction that sticks, with Karnopp's window around zero velocity: the friction condition of USB PID.

A plain −fc·sign(v), sampled, has the wrong sign after each reversal and chatters at rest. Karnopp (ASME J. Dyn. Syst.
Meas. Control 107(1), 1985, 100) sets the velocity to zero inside a window |v| ≤ Dv and lets friction balance the other
forces up to the breakaway force fs; outside, friction is fc. A haptic device does not measure the force of the hand, so
here a spring of `stiffness` K from the stick point a balances it (as with Salcudean & Vlaar, ASME J. Dyn. Syst. Meas.
Control 119(1), 1997, 127). The stick point is dragged along where the spring would exceed the limit (Hayward &
Armstrong, Experimental Robotics VI, Springer 2000, 403):

    F = −K·(x − a) − B·v,   |x − a| ≤ fs/K where |v| ≤ Dv, else fc/K

Sliding therefore needs no sign of a velocity, and the force jumps only from fs to fc at the edge of the window. Without
fs and B the law needs no velocity at all.

Conditions (USB Device Class Definition for Physical Interface Devices 1.0; in physical units here). The saturation is
fc. The positive and the negative coefficient c₊, c₋ are shares of fc and fs, for motion towards positive and towards
negative positions. The metric is s = x − a here, and the dead band w is play about the stick point: friction takes hold
after a distance of w from rest, and of 2·w after a reversal. With them

    F = −K·(s − w) − B·v above w, −K·(s + w) − B·v below −w, else −B·v;   −w − c₋·f/K ≤ s ≤ w + c₊·f/K

where f = fs inside the window, else fc. A CP offset has no meaning here, as no position is neutral.

Energy. With U = ½·K·(|s| − w)² stored beyond w the element only takes energy, as dragging only brings s nearer to 0,
whatever the limit of either side: it is passive. Sampled and held, it gives at most ½·K·Δx² in each period, whatever
the estimate of v: the slope of U' is at most K, and s is never further from 0 after a period than the motion alone
would bring it. The spring of a wall leaks as much, and a device of damping b absorbs it while b > K·T/2 + B. The force
is at most fs + B·|v| at any speed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, TypeVar

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
    """Friction `coulomb` fc [N or N·m] that sticks by a spring of `stiffness` K [N/m or N·m/rad].

    `breakaway` fs [N or N·m] replaces fc at speeds up to `window` Dv [m/s or rad/s]. With `breakaway` 0 or equal to
    `coulomb`, neither has an effect. `damping` B [N·s/m or N·m·s/rad] is viscous friction. The coefficients are shares
    of `coulomb` and `breakaway`, not of `damping`, for motion towards positive and towards negative positions; one of
    them must be 1. `dead_band` [m or rad] is play on either side of the stick point: friction starts after this
    distance from rest, and after twice this distance at a reversal. `coulomb` corresponds to the saturation of USB PID.
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
        """Raise ValueError when a `breakaway` is below `coulomb` or lacks a `window`, or no coefficient is 1."""
        condition.check_breakaway(self.breakaway, self.coulomb, "window", self.window)
        condition.check_coefficients(self.positive_coefficient, self.negative_coefficient, "coulomb")

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Position, and velocity only for the window or viscous friction."""
        by_speed = self.breakaway > self.coulomb or self.damping
        return (Signal.POSITION, Signal.VELOCITY) if by_speed else (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Return the law: position and, if needed, velocity → force or torque [N or N·m]; the same for every period."""
        breakaway = max(self.breakaway, self.coulomb)
        if self.dead_band or self.positive_coefficient != self.negative_coefficient:
            return self._by_speed(self._sided(), self._ends(self.coulomb), self._ends(breakaway))
        return self._by_speed(self._even(), self.coulomb / self.stiffness, breakaway / self.stiffness)

    def _by_speed(self, held: Callable[[float, Limit], float], sliding: Limit, sticking: Limit) -> Law:
        """Return the law of the spring `held` with damping; `sticking` limits it inside the window, else `sliding`."""
        damping, window = self.damping, self.window

        def at_speeds(position: float, velocity: float) -> float:
            return held(position, sticking if -window <= velocity <= window else sliding) - damping * velocity

        def at_any_speed(position: float) -> float:
            return held(position, sliding)

        return at_speeds if Signal.VELOCITY in self.needs else at_any_speed

    def _even(self) -> Callable[[float, float], float]:
        """Return the spring of the stick point for equal limits and no play: position, longest stretch → force."""
        stiffness = self.stiffness
        anchor: float | None = None

        def held(position: float, longest: float) -> float:
            nonlocal anchor
            # min and max keep a not-a-number that comes first, so the order of the arguments lets it through.
            stretch = 0.0 * position if anchor is None else max(min(position - anchor, longest), -longest)
            anchor = position - stretch
            return -stiffness * stretch

        return held

    def _ends(self, effort: float) -> tuple[float, float]:
        """Return the lowest and the highest stretch x − a [m or rad] under a friction `effort` [N or N·m]."""
        longest, play = effort / self.stiffness, self.dead_band
        return -play - self.negative_coefficient * longest, play + self.positive_coefficient * longest

    def _sided(self) -> Callable[[float, tuple[float, float]], float]:
        """Return the spring of the stick point with play and a limit for either side: position, limits → force."""
        stiffness, play = self.stiffness, self.dead_band
        anchor: float | None = None

        def held(position: float, ends: tuple[float, float]) -> float:
            nonlocal anchor
            lowest, highest = ends
            # Not-a-number goes through as above, also through the part of the stretch beyond the play.
            stretch = 0.0 * position if anchor is None else max(min(position - anchor, highest), lowest)
            anchor = position - stretch
            return -stiffness * (stretch - max(min(stretch, play), -play))

        return held

    @property
    def reserve(self) -> float:
        """Largest energy that the spring of the stick point can hold [J]."""
        return 0.5 * max(self.breakaway, self.coulomb) ** 2 / self.stiffness

    @property
    def increments(self) -> tuple[float, float] | None:
        """Return stiffness and damping; None where the force falls at the edge of the window."""
        return None if self.breakaway > self.coulomb else (self.stiffness, self.damping)

    def linearised(self) -> StateSpace:
        """Return the spring that sticks, beyond the dead band, with damping."""
        return gain([[-self.stiffness, -self.damping]])

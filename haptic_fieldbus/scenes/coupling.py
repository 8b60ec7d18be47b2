"""A virtual shaft between two axes: each handle transmits motion and force to the other.

With the `ratio` n and the twist u = x₁ − n·x₂, the forces on the first and on the second axis are

    F₁ = −K·u − B·u̇,    F₂ = −n·F₁,

each positive towards positive positions of its own axis. This is the position-position coupling of bilateral
teleoperation (Lawrence, IEEE Trans. Robotics and Automation 9(5), 1993, 624). A dead band w is play on either side of u
= 0: beyond it F₁ = −K·(u ∓ w) − B·u̇. A saturation is the largest |F₁|.

Between two linear or two rotary axes n is a plain number; a negative one reverses the second axis. Between a linear and
a rotary axis n has a unit, as for a rack and its pinion: metres per radian when the first axis is linear, radians per
metre when it is rotary. It must be given then. Everything else is in the units of the first axis.

In continuous time F₁·v₁ + F₂·v₂ = F₁·u̇: ½·K·u² is stored and B dissipates, so both hands together get back no more
than they gave. Sampled and held for T, the shaft gives up to ½·K·(Δu)² more in each move Δu of the twist. With devices
of damping b₁ and b₂ and without delay it is passive while K·T/2 + |B| ≤ 1/(1/b₁ + n²/b₂)
(`margins.coupled`).
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics import condition
from haptic_fieldbus.numerics.coupled import spring_damper
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import (
    STRICT,
    AnyRatio,
    Damped,
    Damping,
    NonNegativeLength,
    PairLaw,
    PositiveEffort,
    Stiffness,
    TwoAxes,
)


@dataclass(frozen=True)
class Coupling(Damped):
    """A spring of `stiffness` and a damper of `damping` between the first of `axes` and `ratio` times the second.

    `dead_band` is the play on either side, `saturation` the largest force on the first axis. `ratio` defaults to 1;
    between a linear and a rotary axis it is required, in m/rad or rad/m. All values are in the units of the first axis.
    """

    axes: TwoAxes
    stiffness: Stiffness
    damping: Damping = 0.0
    ratio: AnyRatio | None = None
    dead_band: NonNegativeLength = 0.0
    saturation: PositiveEffort | None = None
    name: str = "coupling"
    __pydantic_config__: ClassVar = STRICT

    def __post_init__(self) -> None:
        """Raise ValueError when both axes are the same or the ratio is 0."""
        if len(set(self.axes)) < len(self.axes):
            raise ValueError(f"axes {', '.join(self.axes)}: expected two different axes")
        if self.ratio == 0.0:
            raise ValueError("ratio 0: expected another number; with 0 the second axis would feel nothing")

    @property
    def transmission(self) -> float:
        """The ratio in use: 1 when none is given."""
        return 1.0 if self.ratio is None else self.ratio

    def begin(self, period: float) -> PairLaw:
        """Return a law without memory; not-a-number on either axis gives not-a-number on both."""
        side = condition.Side.limited(self.stiffness, self.damping, self.saturation)
        shaft, ratio = condition.bind(0.0, self.dead_band, side, side), self.transmission

        def sprung(first: float, second: float) -> tuple[float, float]:
            force = shaft(first - ratio * second)
            return force, -ratio * force

        def damped(first: float, first_speed: float, second: float, second_speed: float) -> tuple[float, float]:
            force = shaft(first - ratio * second, first_speed - ratio * second_speed)
            return force, -ratio * force

        return damped if self.damping else sprung

    def stored(self, first: float, second: float) -> float:
        """Return the energy of the spring when the axes are at these positions [J]."""
        beyond = max(abs(first - self.transmission * second) - self.dead_band, 0.0)
        if self.saturation is not None and self.stiffness * beyond > self.saturation:
            return self.saturation * (beyond - 0.5 * self.saturation / self.stiffness)
        return 0.5 * self.stiffness * beyond * beyond

    def linearised(self) -> StateSpace:
        """Return the spring-damper beyond the play and below saturation."""
        return spring_damper(self.stiffness, self.damping, self.transmission)

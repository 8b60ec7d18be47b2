"""A virtual shaft between two axes: turn one, and the other follows; hold one, and the other feels it.

With the twist u = x₁ − n·x₂, n the `ratio`, the force on the first axis and that on the second are

    F₁ = −K·u − B·u̇,    F₂ = −n·F₁,

each positive towards positive positions of its own axis. This is the position-position coupling of bilateral
teleoperation (Lawrence, IEEE Trans. Robotics and Automation 9(5), 1993, 624). A dead band w is play on either side of
u = 0, F₁ = −K·(u ∓ w) − B·u̇ beyond it; a saturation is the largest |F₁|.

Both axes may be linear or both rotary, n then being a plain number; negative turns the second the other way. Of a
linear and a rotary axis n is as of a rack and its pinion, metres per radian where the first axis is linear, radians per
metre where it is rotary, and must be given. Everything else is in the units of the first axis.

In continuous time F₁·v₁ + F₂·v₂ = F₁·u̇: ½·K·u² is stored, B dissipates, and both hands together get back no more than
they gave. Sampled and held at T the shaft gives up to ½·K·(Δu)² more in each move Δu of the twist; with devices of
damping b₁ and b₂ and without delay it is passive while K·T/2 + |B| ≤ 1/(1/b₁ + n²/b₂) (`numerics.coupled_passivity`).
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics import condition
from haptic_fieldbus.numerics.coupled import spring_damper
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import (
    STRICT,
    AnyRatio,
    Damping,
    NonNegativeLength,
    PairLaw,
    PositiveEffort,
    Stiffness,
    TwoAxes,
)
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Coupling:
    """`stiffness` and `damping` between the first of `axes` and `ratio` times the second.

    `dead_band` is the play on either side, `saturation` the largest force on the first axis. A ratio left
    out is 1; between a linear and a rotary axis one must be given, in m/rad or rad/m. All are in the units of the
    first axis.
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
        if len(set(self.axes)) < len(self.axes):
            raise ValueError(f"axes {', '.join(self.axes)}: expected two different axes")
        if self.ratio == 0.0:
            raise ValueError("ratio 0: expected a number other than 0, as the second axis would feel nothing")

    @property
    def transmission(self) -> float:
        """The ratio in use."""
        return 1.0 if self.ratio is None else self.ratio

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Velocity only when there is damping."""
        return (Signal.POSITION, Signal.VELOCITY) if self.damping else (Signal.POSITION,)

    def begin(self, period: float) -> PairLaw:
        """Nothing is remembered; not-a-number in gives not-a-number out, on both axes."""
        side = condition.Side.limited(self.stiffness, self.damping, self.saturation)
        shaft, ratio = condition.bind(0.0, self.dead_band, side, side), self.transmission

        def sprung(first: float, second: float) -> tuple[float, float]:
            force = shaft(first - ratio * second)
            return force, -ratio * force

        def damped(first: float, first_speed: float, second: float, second_speed: float) -> tuple[float, float]:
            force = shaft(first - ratio * second, first_speed - ratio * second_speed)
            return force, -ratio * force

        return damped if self.damping else sprung

    def linearised(self) -> StateSpace:
        """The spring-damper, beyond the play and below saturation."""
        return spring_damper(self.stiffness, self.damping, self.transmission)

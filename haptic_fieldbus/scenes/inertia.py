"""A virtual mass that resists acceleration: the inertia condition of USB PID.

F = −m·(a ∓ w) beyond the dead band w of the acceleration, else 0, with a coefficient and a saturation for either sign
(USB Device Class Definition for Physical Interface Devices 1.0: dead band, coefficients, saturations; `offset` is the
neutral acceleration, the CP offset). Without them F = −m·a, positive towards positive x. The acceleration is the
filtered derivative of the velocity: with the filtered velocity q, q̇ = (v − q)/τ and a = q̇, so a = s/(τ·s + 1)·v.
Below the frequency 1/τ the handle is heavier by m, above it is damped by m/τ. The filter starts at rest, and is exact
for a velocity that runs on straight lines between the samples.

In continuous time it is passive for every m and τ where no condition is set: F·v = −m·q·q̇ − m·τ·q̇², so it stores
½·m·q² and dissipates the rest. Sampled at T, with the velocity by backward difference, it is F(z)/x(z) = −m·(1 −
α)/T²·(z − 1)²/(z·(z − α)), α = e^(−T/τ), and on a device of mass M and damping b

    passive                                            b > 2·m/T·tanh(T/2τ), about m/τ
    stable, no delay, b = 0                            m < 2·M/(1 − α), about 2·M·τ/T
    stable, a whole period of delay, b = 0             m < M·(√((1 + α)² + 4) − 1 − α)/(1 − α), about 0.83·M·τ/T

The first row is the condition of Colgate & Schenkel (J. Robotic Systems 14(1), 1997, 37) at the Nyquist frequency,
where it is strictest; the others are Jury's conditions of z² − α·z + h·(z + 1) and z³ − α·z² + h·(z + 1), h = m·(1 −
α)/2M. A longer τ lets a heavier mass be stable, but adds it later. A step D of the encoder is felt as (m/τ)·D/T.

With a condition the element is no mass any more: the energy taken while the handle speeds up need not equal the energy
given back while it slows down. Its power never exceeds its largest force times the speed.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus.numerics import condition
from haptic_fieldbus.numerics.linear import StateSpace, system_of
from haptic_fieldbus.scenes.element import (
    STRICT,
    Acceleration,
    Duration,
    Law,
    Mass,
    NonNegativeAcceleration,
    PositiveEffort,
    Share,
)
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Inertia:
    """A `mass` [kg or kg·m²] that is added to the handle, with the acceleration filtered by `time_constant` [s].

    `offset` and `dead_band` are accelerations [m/s² or rad/s²], the coefficients shares of the mass at positive and at
    negative acceleration; one of them must be 1. A saturation is the largest force for its sign [N or N·m]; without one
    there is no limit.
    """

    axis: str
    mass: Mass
    time_constant: Duration = 0.02
    offset: Acceleration = 0.0
    dead_band: NonNegativeAcceleration = 0.0
    positive_coefficient: Share = 1.0
    negative_coefficient: Share = 1.0
    positive_saturation: PositiveEffort | None = None
    negative_saturation: PositiveEffort | None = None
    name: str = "inertia"
    __pydantic_config__: ClassVar = STRICT
    needs: ClassVar[tuple[Signal, ...]] = (Signal.VELOCITY,)

    def __post_init__(self) -> None:
        condition.check_coefficients(self.positive_coefficient, self.negative_coefficient, "mass")

    def begin(self, period: float) -> Law:
        """Return a law that filters the velocity, exactly, to an acceleration, and opposes it."""
        force, rise = self._condition(), -math.expm1(-period / self.time_constant) / period
        decay = math.exp(-period / self.time_constant)
        acceleration = last = 0.0

        def law(velocity: float) -> float:
            nonlocal acceleration, last
            # Exact for a velocity that changes on a straight line: a⁺ = α·a + (1 − α)·Δv/T.
            acceleration = decay * acceleration + rise * (velocity - last)
            last = velocity
            return force(acceleration)

        return law

    def _condition(self) -> Law:
        """Return the law from acceleration [m/s² or rad/s²] to force [N or N·m]."""
        # The metric of this condition is the acceleration, so the mass is its coefficient.
        positive = condition.Side.limited(self.positive_coefficient * self.mass, 0.0, self.positive_saturation)
        negative = condition.Side.limited(self.negative_coefficient * self.mass, 0.0, self.negative_saturation)
        return condition.bind(self.offset, self.dead_band, positive, negative)

    @property
    def strongest(self) -> float:
        """Largest force that it may give by itself [N or N·m]: 0 for a plain mass, which gives back what it took."""
        sides = (self.positive_saturation, self.negative_saturation)
        is_plain = self.positive_coefficient == self.negative_coefficient and sides == (None, None)
        if is_plain and not (self.offset or self.dead_band):
            return 0.0
        return max(math.inf if each is None else each for each in sides)

    def linearised(self) -> StateSpace:
        """Return the side with the whole mass: state filtered velocity, inputs (position, velocity), output force."""
        rate = 1.0 / self.time_constant
        return system_of([[-rate]], [[0.0, rate]], [[self.mass * rate]], [[0.0, -self.mass * rate]])

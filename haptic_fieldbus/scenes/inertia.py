"""A virtual mass that resists acceleration: the inertia condition of USB PID.

F = −m·a, positive towards positive x, where the acceleration is the filtered derivative of the velocity: with the
filtered velocity q, q̇ = (v − q)/τ and a = q̇, so a = s/(τ·s + 1)·v. Below 1/τ the handle is heavier by m, above it is
damped by m/τ. (USB Device Class Definition for Physical Interface Devices 1.0.) It begins at rest.

In continuous time it is passive for every m and τ: F·v = −m·q·q̇ − m·τ·q̇², so it stores ½·m·q² and dissipates the
rest. Sampled at T, with the exact step of the filter and velocity by backward difference, it is
F(z)/x(z) = −m·(1 − α)/T²·(z − 1)²/(z·(z − α)), α = e^(−T/τ), and on a device of mass M and damping b

    passive                                            b > 2·m/T·tanh(T/2τ), about m/τ
    stable, no delay, b = 0                            m < 2·M/(1 − α), about 2·M·τ/T
    stable, a whole period of delay, b = 0             m < M·(√((1 + α)² + 4) − 1 − α)/(1 − α), about 0.83·M·τ/T

The first is the condition of Colgate & Schenkel (J. Robotic Systems 14(1), 1997, 37) at the Nyquist frequency, where it
asks most; the others are Jury's conditions of z² − α·z + h·(z + 1) and z³ − α·z² + h·(z + 1), h = m·(1 − α)/2M. A
longer τ lets a heavier mass be stable, but adds it later. A step D of the encoder is felt as (m/τ)·D/T.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.scenes.element import STRICT, Duration, Mass
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Inertia:
    """`mass` [kg or kg·m²] that is added to the handle, its acceleration filtered by `time_constant` [s]."""

    axis: str
    mass: Mass
    time_constant: Duration = 0.02
    name: str = "inertia"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.VELOCITY)

    @property
    def dynamics(self) -> StateSpace:
        """State: the filtered velocity; inputs (position, velocity) of the handle, output force on it."""
        rate = 1.0 / self.time_constant
        return StateSpace(
            a=np.array([[-rate]]),
            b=np.array([[0.0, rate]]),
            c=np.array([[self.mass * rate]]),
            d=np.array([[0.0, -self.mass * rate]]),
        )

    def linearised(self) -> StateSpace:
        """The element is linear: its dynamics."""
        return self.dynamics

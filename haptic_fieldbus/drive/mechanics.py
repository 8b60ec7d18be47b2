"""Mechanics of a simulated bench beyond a rigid shaft: `[axis.NAME.simulation]` of a rig, each part optional.

Only the simulation uses these values, but for the coupling: without its backlash it counts in stability limits too. All
are at the motor shaft and SI, unless a field says otherwise.
"""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.drive.fields import (
    STRICT,
    AnyFloat,
    Damping,
    Friction,
    Inertia,
    Measured,
    NonNegativeFloat,
    PositiveFloat,
)

LARGEST_COGGING = (2.0 * math.pi * 1e4) ** 2
"""Of torque times periods per revolution over inertia [rad/s²]: the shaft then swings in its rest at 10 kHz."""


@dataclass(frozen=True)
class CompliantCoupling:
    """A compliant shaft, belt or gear: spring and damper between motor and load, with the encoder on the motor."""

    stiffness: Annotated[PositiveFloat, Measured(Quantity.STIFFNESS)]
    """[N·m/rad]"""
    load_inertia: Inertia
    """Part of the axis' inertia that lies behind the spring [kg·m²]."""
    damping: Damping = 0.0
    """Damping parallel to the spring [N·m·s/rad]."""
    backlash: Annotated[NonNegativeFloat, Measured(Quantity.LENGTH)] = 0.0
    """Play from one flank to the other [rad]."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Weight:
    """A weight on the handle."""

    torque: Annotated[AnyFloat, Measured(Quantity.EFFORT)]
    """Torque of the weight [N·m].

    Linear mechanism: constant, positive towards positive angles. Rotary mechanism: the largest, at a horizontal lever.
    """
    hanging_at: Annotated[AnyFloat, Measured(Quantity.LENGTH)] = 0.0
    """Angle of a rotary handle at which its lever hangs down [rad], counted from the zero of the simulated encoder."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Cogging:
    """Cogging torque of the motor: −torque·sin(periods_per_revolution·θ), with a stable rest at θ = 0."""

    torque: Friction
    """[N·m]"""
    periods_per_revolution: Annotated[int, Gt(0), Le(1_000_000)]
    """Places of rest in a turn of the motor."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Stribeck:
    """Friction in addition to Coulomb and viscous friction, falling with speed: torque·exp(−(ω/velocity)²)."""

    torque: Friction
    """Friction at rest beyond Coulomb friction [N·m]; the shaft breaks away at the sum of both."""
    velocity: Annotated[PositiveFloat, Measured(Quantity.SPEED)]
    """Speed at which the additional friction has fallen to 1/e [rad/s]."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Mechanics:
    """Optional parts of the simulated mechanics; None: it is not simulated, and costs no time."""

    coupling: CompliantCoupling | None = None
    gravity: Weight | None = None
    cogging: Cogging | None = None
    stribeck: Stribeck | None = None
    __pydantic_config__: ClassVar = STRICT

    @property
    def is_rigid(self) -> bool:
        """True when no optional part is given."""
        return self == Mechanics()

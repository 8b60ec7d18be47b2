"""What a simulated bench has beyond a rigid shaft: `[axis.NAME.simulation]` of a rig, each part off unless asked.

For the simulation only: no plan and no stability limit looks at it. Everything at the motor shaft, SI.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Gt

from haptic_fieldbus.drive.fields import STRICT, NonNegativeFloat, PositiveFloat


@dataclass(frozen=True)
class CompliantCoupling:
    """A shaft, belt or gear that gives way: spring and damper between motor and load, the encoder on the motor."""

    stiffness: PositiveFloat
    """[N·m/rad]"""
    load_inertia: PositiveFloat
    """[kg·m²], the part of the axis' inertia that lies behind the spring."""
    damping: NonNegativeFloat = 0.0
    """[N·m·s/rad], in the spring."""
    backlash: NonNegativeFloat = 0.0
    """[rad], from one flank to the other."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Weight:
    """A weight on the handle."""

    torque: float
    """[N·m]. Linear mechanism: the torque, positive towards positive angles. Rotary: the largest, lever horizontal."""
    hanging_at: float = 0.0
    """[rad] of the handle, counted from the simulated encoder's zero: where the lever of a rotary handle hangs down."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Cogging:
    """Torque −torque·sin(periods·θ) of the motor's slots, at rest at θ = 0."""

    torque: NonNegativeFloat
    """[N·m]"""
    periods_per_revolution: Annotated[int, Gt(0)]
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Stribeck:
    """Friction beyond Coulomb's and viscous, that fades as the shaft slips: torque·exp(−(ω/velocity)²)."""

    torque: NonNegativeFloat
    """[N·m]: the shaft breaks away at Coulomb friction and this."""
    velocity: PositiveFloat
    """[rad/s]"""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Mechanics:
    """The optional parts; `None` is not simulated and costs nothing."""

    coupling: CompliantCoupling | None = None
    gravity: Weight | None = None
    cogging: Cogging | None = None
    stribeck: Stribeck | None = None
    __pydantic_config__: ClassVar = STRICT

    @property
    def is_rigid(self) -> bool:
        """Whether nothing is asked for."""
        return self == Mechanics()

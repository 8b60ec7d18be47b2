"""Types of fields that profile and rig files share, and the range of each physical quantity.

The ranges are far beyond any bench for a hand, and far inside of what arithmetic takes: products and quotients of
values in range stay finite. A value out of range is a slip of a unit or of a digit. The ranges that benches for a hand
have are in `drive.plausible`.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.signals import Workspace

STRICT: dict[str, object] = {"extra": "forbid", "allow_inf_nan": False}
"""Pydantic configuration of all tables: unknown keys, infinity and NaN are faults."""


class Table:
    """A table of a profile or a rig, checked by `STRICT`."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Measured:
    """Annotation of a field of a rig: what it measures, and so the units in which the file may write it."""

    quantity: Quantity
    workspace: Workspace | None = Workspace.ROTARY
    """Rotary: at the motor shaft; linear: of a handle that goes straight; None: of the handle, as its mechanism is."""


PositiveFloat = Annotated[float, Gt(0), Ge(1e-9), Le(1e9)]
"""A number without a range of its own here."""
NonNegativeFloat = Annotated[float, Ge(0), Le(1e9)]
AnyFloat = Annotated[float, Ge(-1e9), Le(1e9)]
Torque = Annotated[float, Gt(0), Ge(1e-6), Le(1e6), Measured(Quantity.EFFORT)]
"""[N·m]"""
Inertia = Annotated[float, Gt(0), Ge(1e-12), Le(1e6), Measured(Quantity.MASS)]
"""[kg·m²]"""
Time = Annotated[float, Gt(0), Ge(1e-6), Le(1e6), Measured(Quantity.TIME)]
"""[s]"""
NonNegativeTime = Annotated[float, Ge(0), Le(1e6), Measured(Quantity.TIME)]
MetresPerRevolution = Annotated[float, Gt(0), Ge(1e-6), Le(1e3), Measured(Quantity.LENGTH, Workspace.LINEAR)]
GearRatio = Annotated[float, Gt(0), Ge(1e-6), Le(1e6)]
Frequency = Annotated[float, Gt(0), Ge(1e-3), Le(1e9), Measured(Quantity.FREQUENCY)]
"""[Hz]"""
Counts = Annotated[int, Ge(-0x8000_0000), Le(0x7FFF_FFFF)]
"""Position actual value of CiA 402, INTEGER32."""
CountsPerRevolution = Annotated[int, Gt(0), Le(0x7FFF_FFFF)]
UInt32 = Annotated[int, Ge(0), Le(0xFFFF_FFFF)]

Friction = Annotated[NonNegativeFloat, Measured(Quantity.EFFORT)]
"""[N·m]"""
Damping = Annotated[NonNegativeFloat, Measured(Quantity.DAMPING)]
"""[N·m·s/rad]"""
TorqueConstant = Annotated[PositiveFloat, Measured(Quantity.EFFORT_PER_CURRENT)]
"""[N·m/A]"""
Interval = tuple[NonNegativeFloat, NonNegativeFloat]
"""Lower and upper end."""
TorqueScale = Annotated[float, Gt(0), Ge(1e-3), Le(1e3)]
"""Torque that is given over torque that was asked for."""
Current = Annotated[PositiveFloat, Measured(Quantity.CURRENT)]
"""[A]"""
LARGEST_SHARE = 0.3
"""Of rated torque, which a person may permit at most before the sign is seen."""
PulseShare = Annotated[float, Gt(0), Le(LARGEST_SHARE)]
Power = Annotated[PositiveFloat, Measured(Quantity.POWER)]
"""[W]"""
HandleEffort = Annotated[PositiveFloat, Measured(Quantity.EFFORT, None)]
"""[N or N·m]"""
HandleSpeed = Annotated[PositiveFloat, Measured(Quantity.SPEED, None)]
HandleAcceleration = Annotated[PositiveFloat, Measured(Quantity.ACCELERATION, None)]
HandleLength = Annotated[PositiveFloat, Measured(Quantity.LENGTH, None)]
"""[m or rad]"""
HandleRange = Annotated[tuple[AnyFloat, AnyFloat], Measured(Quantity.LENGTH, None)]
"""Lower and upper place [m or rad]."""

Ranged = Literal[
    "rated_torque", "torque_constant", "rated_current", "peak_current", "inertia", "viscous_damping",
    "coulomb_friction", "encoder_counts_per_revolution", "mechanism.metres_per_revolution", "mechanism.gear_ratio",
    "limits.effort", "limits.speed", "limits.position", "limits.acceleration", "limits.power",
]  # fmt: skip
"""Keys of an axis whose values have a range (`drive.plausible`)."""

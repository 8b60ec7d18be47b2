"""Types of fields that profile and rig files share, and the range of each physical quantity.

The ranges are far beyond any bench for a hand, and far inside of what arithmetic takes: products and quotients of
values in range stay finite. A value out of range is a slip of a unit or of a digit.
"""

from typing import Annotated

from annotated_types import Ge, Gt, Le

STRICT: dict[str, object] = {"extra": "forbid", "allow_inf_nan": False}
"""Pydantic configuration of all tables: unknown keys, infinity and NaN are faults."""

PositiveFloat = Annotated[float, Gt(0), Ge(1e-9), Le(1e9)]
"""A number without a range of its own here."""
NonNegativeFloat = Annotated[float, Ge(0), Le(1e9)]
AnyFloat = Annotated[float, Ge(-1e9), Le(1e9)]
Torque = Annotated[float, Gt(0), Ge(1e-6), Le(1e6)]
"""[N·m]"""
Inertia = Annotated[float, Gt(0), Ge(1e-12), Le(1e6)]
"""[kg·m²]"""
Time = Annotated[float, Gt(0), Ge(1e-6), Le(1e6)]
"""[s]"""
NonNegativeTime = Annotated[float, Ge(0), Le(1e6)]
MetresPerRevolution = Annotated[float, Gt(0), Ge(1e-6), Le(1e3)]
GearRatio = Annotated[float, Gt(0), Ge(1e-6), Le(1e6)]
Frequency = Annotated[float, Gt(0), Ge(1e-3), Le(1e9)]
"""[Hz]"""
Counts = Annotated[int, Ge(-0x8000_0000), Le(0x7FFF_FFFF)]
"""Position actual value of CiA 402, INTEGER32."""
CountsPerRevolution = Annotated[int, Gt(0), Le(0x7FFF_FFFF)]
UInt32 = Annotated[int, Ge(0), Le(0xFFFF_FFFF)]

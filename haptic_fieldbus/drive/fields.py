"""Types of fields that profile and rig files share."""

from typing import Annotated

from annotated_types import Ge, Gt, Le

STRICT: dict[str, object] = {"extra": "forbid", "allow_inf_nan": False}
"""Pydantic configuration of all tables: unknown keys, infinity and NaN are faults."""

PositiveFloat = Annotated[float, Gt(0)]
NonNegativeFloat = Annotated[float, Ge(0)]
UInt32 = Annotated[int, Ge(0), Le(0xFFFF_FFFF)]

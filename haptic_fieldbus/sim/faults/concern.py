"""The fields that all kinds of faults share, and the types of fields that several have."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from haptic_fieldbus.drive.fields import STRICT

Node = Annotated[int, Ge(1), Le(127)]
ErrorCode = Annotated[int, Ge(0x0001), Le(0xFFFF)]
Count = Annotated[int, Ge(1), Le(1_000_000_000)]
Octet = Annotated[int, Ge(0), Le(0xFF)]
CanId = Annotated[int, Ge(0), Le(0x7FF)]
Share = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True, kw_only=True)
class Concern:
    """The drives and buses that a fault concerns."""

    node: Node | None = None
    bus: str | None = None
    __pydantic_config__: ClassVar = STRICT

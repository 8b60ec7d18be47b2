"""A drive profile: how one drive model offers torque and position, or velocity alone, on a fieldbus.

A profile is a TOML file of `profiles/`. What every protocol needs is here; each protocol adds tables of its own, and
says which object or register carries which signal (`protocols`). `protocols.catalogue.load_profile` reads it.
Units are SI unless a name or an entry's `unit` says otherwise.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from annotated_types import Len

from haptic_fieldbus.drive.fields import STRICT, NonNegativeFloat, PositiveFloat
from haptic_fieldbus.drive.objects import DataType, Order
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class MappedSignal:
    """A signal as a drive carries it: where, in which type and unit."""

    signal: Signal
    address: str
    """As the protocol writes it: `6064h:00 position actual value`, `register 0x0102`."""
    type: DataType
    unit: str = ""
    order: Order = Order.LITTLE


@dataclass(frozen=True)
class DriveSection:
    vendor: Annotated[str, Len(1)]
    model: Annotated[str, Len(1)]
    protocol: Annotated[str, Len(1)]
    evidence: Literal["hardware", "vendor-data", "third-party-code", "standard"]
    """The best that the values rest on; "standard": on CiA 301 and CiA 402 alone, no device was looked at."""
    usable: bool = True
    """False: the profile only documents why the drive cannot render force."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class TimingSection:
    torque_bandwidth: PositiveFloat
    """[Hz]; the torque loop is taken as first order."""
    control_period: NonNegativeFloat
    """[s]; a new target is taken over at the next multiple of it, counted from the latch; 0: at once."""
    mode_change_timeout: PositiveFloat = 1.0
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, kw_only=True)
class DriveProfile(ABC):
    """One drive model; `name` is the file's name without suffix, `source` its path."""

    schema: Literal[1]
    drive: DriveSection
    timing: TimingSection
    sources: dict[str, Annotated[str, Len(1)]] = field(default_factory=dict)
    """Where each value comes from, by key; the source of a table covers all in it."""
    name: str = ""
    source: str = ""
    __pydantic_config__: ClassVar = STRICT

    @property
    def title(self) -> str:
        return f"{self.drive.vendor} {self.drive.model}"

    @abstractmethod
    def offers(self) -> Mapping[Signal, MappedSignal]:
        """What carries each signal."""

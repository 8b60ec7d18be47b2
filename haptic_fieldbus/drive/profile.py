"""A drive profile: how one drive model offers torque and position, or velocity alone, on a fieldbus.

A profile is a TOML file in `profiles/`, read by `protocols.catalogue.load_profile`. This module has the tables that all
protocols share. Each protocol (`protocols`) adds tables of its own, which tell the object or register of each signal.
Units are SI, unless a name or the `unit` of an entry says otherwise.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Len

from haptic_fieldbus.drive.fields import Frequency, NonNegativeTime, Table, Time
from haptic_fieldbus.drive.objects import DataType, Order
from haptic_fieldbus.signals import Signal

ASSUMED = "ASSUMED"
"""Word in the source of a value for which none was found."""
STANDARD = "standard"
"""Evidence of a profile of no particular drive; a run asks the drive which of its objects there are."""


@dataclass(frozen=True)
class MappedSignal:
    """A signal as a drive carries it: address, type, unit and order of octets."""

    signal: Signal
    address: str
    """Address in the notation of the protocol: `6064h:00 position actual value`, `register 0x0102`."""
    type: DataType
    unit: str = ""
    order: Order = Order.LITTLE


@dataclass(frozen=True)
class DriveSection(Table):
    """Drive model, its protocol, and the evidence for the profile."""

    vendor: Annotated[str, Len(1)]
    model: Annotated[str, Len(1)]
    protocol: Annotated[str, Len(1)]
    evidence: Literal["hardware", "vendor-data", "third-party-code", "standard"]
    """Best evidence for the values; "standard": CiA 301 and CiA 402 alone, without any particular device."""
    usable: bool = True
    """False: the profile only documents why the drive cannot render force."""
    commutation_search: bool = False
    """True: the first enabling after power-on may turn the shaft, because the drive looks for its commutation."""


@dataclass(frozen=True)
class TimingSection(Table):
    """Times of a drive: torque loop, controller, change of mode."""

    torque_bandwidth: Frequency
    """Bandwidth of the torque loop, which is taken as first order [Hz]."""
    control_period: NonNegativeTime
    """Period of the drive's controller [s].

    A new target acts at the next multiple of it, counted from the latch of the feedback; with 0 it acts at once.
    """
    mode_change_timeout: Time = 1.0
    """Longest time that the drive may take to change its mode of operation [s]."""
    control_tick: Literal["sync", "free", "unknown"] = "unknown"
    """Whether the controller's ticks are counted from SYNC or run free; unknown: counted as "sync" in the plan, and as
    "free" in its limit."""
    encoder_latency: NonNegativeTime | None = None
    """Age of a position at the SYNC that latches it [s]; None: 0 in the plan, up to a control period in its
    limit."""
    enabling_timeout: Time = 2.0
    """Longest time that the drive may take to *operation enabled* [s]; a commutation search takes part of it."""


@dataclass(frozen=True, kw_only=True)
class DriveProfile(Table, ABC):
    """Profile of one drive model; `name` is the name of the file without suffix, `source` its path."""

    schema: Literal[1]
    drive: DriveSection
    timing: TimingSection
    sources: dict[str, Annotated[str, Len(1)]] = field(default_factory=dict)
    """Origin of each value, by key; the source of a table covers all values in it."""
    name: str = ""
    source: str = ""

    @property
    def title(self) -> str:
        """Vendor and model, as messages name the drive."""
        return f"{self.drive.vendor} {self.drive.model}"

    @property
    def ramp(self) -> float:
        """Time in which the torque goes from zero to rated by a slope of the drive's own [s]; 0: at once."""
        return 0.0

    @property
    def echo(self) -> Signal | None:
        """Signal in which the drive returns a target torque, which proves that set-points act; None: it has none."""
        return None

    @property
    def full_scale(self) -> float | None:
        """Torque at 32767 of a target that is told as a share of it [N·m]; None: it is told otherwise."""
        return None

    @property
    def rating_told(self) -> bool:
        """True when the drive tells the rated value that scales its torque, so that it is compared with the rig."""
        return False

    @property
    def torque_lag(self) -> float:
        """Time constant of the torque behind its target [s]: torque loop, and the slope of the drive's own."""
        return 1.0 / (2 * math.pi * self.timing.torque_bandwidth) + self.ramp

    @property
    def assumed(self) -> tuple[str, ...]:
        """Keys whose values rest on no source but an assumption, in the order of the file."""
        return tuple(key for key, source in self.sources.items() if ASSUMED in source)

    @property
    def guarded(self) -> bool:
        """True when the drive can take the torque away by itself as soon as nothing comes from its master any more."""
        return True

    @property
    def brakes(self) -> bool:
        """True when the drive can be told to brake, and not to free its shaft, when its master is gone."""
        return False

    @abstractmethod
    def offers(self) -> Mapping[Signal, MappedSignal]:
        """Return the signals that the drive offers, each as it is carried."""

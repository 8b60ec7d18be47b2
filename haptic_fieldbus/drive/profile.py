"""A drive profile: how one drive model offers torque and position, or velocity alone, on a fieldbus.

A profile is a TOML file of `profiles/`; these dataclasses are its schema. `catalogue.load_profile` reads it.
Units are SI unless a name or an entry's `unit` says otherwise.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le, Len

from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.signals import Signal

STRICT = {"extra": "forbid", "allow_inf_nan": False}

PositiveFloat = Annotated[float, Gt(0)]
NonNegativeFloat = Annotated[float, Ge(0)]
Index = Annotated[int, Ge(0x1000), Le(0xFFFF)]
UInt32 = Annotated[int, Ge(0), Le(0xFFFF_FFFF)]
TransmissionType = Annotated[int, Ge(0), Le(255)]

TORQUE_UNITS = ("permille_of_rated_torque",)
RATED_TORQUE_UNITS = {"µN·m": 1e-6, "mN·m": 1e-3, "N·m": 1.0}
"""Unit of the rated torque → N·m."""
POSITION_UNITS = ("counts",)
COUNTS_PER_SECOND = "counts/s"
REVOLUTIONS_PER_SECOND = {"rpm": 1 / 60, "0.1 rpm": 1 / 600, "0.01 rpm": 1 / 6_000, "0.001 rpm": 1 / 60_000}
"""One step of a velocity in revolutions of the motor a second: the units of CiA 402-2, 60A9h, that drives have."""
VELOCITY_UNITS = (*REVOLUTIONS_PER_SECOND, COUNTS_PER_SECOND)


def velocity_step(unit: str, counts_per_revolution: int) -> float:
    """One step of a velocity in that unit, at the motor shaft [rad/s]."""
    return 2 * math.pi * REVOLUTIONS_PER_SECOND.get(unit, 1 / counts_per_revolution)


@dataclass(frozen=True)
class MappedObject:
    """An object that carries a signal, as written in a profile."""

    object: Index
    type: DataType
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    unit: str = ""
    __pydantic_config__: ClassVar = STRICT

    @property
    def entry(self) -> ObjectEntry:
        return ObjectEntry(self.object, self.type, self.subindex, self.unit)


@dataclass(frozen=True)
class OptionCode:
    """An option object and the value that it must hold while force is rendered."""

    object: Index
    value: Annotated[int, Ge(-32768), Le(32767)]
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class DriveSection:
    vendor: Annotated[str, Len(1)]
    model: Annotated[str, Len(1)]
    protocol: Literal["canopen", "modbus"]
    evidence: Literal["hardware", "vendor-data", "third-party-code", "standard"]
    """The best that the values rest on; "standard": on CiA 301 and CiA 402 alone, no device was looked at."""
    usable: bool = True
    """False: the profile only documents why the drive cannot render force."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class IdentitySection:
    """Compared with 1018h before anything is written; None is not compared."""

    vendor_id: UInt32 | None = None
    product_codes: tuple[UInt32, ...] = ()
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class TorqueSection:
    mode_of_operation: Annotated[int, Ge(-128), Le(127)]
    target: MappedObject
    actual: MappedObject | None = None
    rated: MappedObject | None = None
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class PositionSection:
    actual: MappedObject
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class VelocitySection:
    actual: MappedObject
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class PdoSection:
    tpdo_types: Annotated[tuple[TransmissionType, ...], Len(1)]
    rpdo_types: Annotated[tuple[TransmissionType, ...], Len(1)]
    rpdo_acts: Literal["reception", "next_sync", "unknown"] = "unknown"
    """When the content of an event-driven RPDO becomes the drive's target."""
    tpdos: Annotated[int, Ge(1), Le(512)] = 4
    rpdos: Annotated[int, Ge(1), Le(512)] = 4
    entries: Annotated[int, Ge(1), Le(64)] = 8
    """Mapping entries of one PDO."""
    inhibit_time_default: NonNegativeFloat = 0.0
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class LinkLossSection:
    """How the drive notices that the master is gone, and what it then does."""

    heartbeat_consumer: Index | None = None
    abort_connection_option: OptionCode | None = None
    fault_reaction_option: OptionCode | None = None
    deadline: PositiveFloat = 0.05
    """[s]; written to the heartbeat consumer."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class TimingSection:
    torque_bandwidth: PositiveFloat
    """[Hz]; the torque loop is taken as first order."""
    control_period: NonNegativeFloat
    """[s]; a new target is taken over at the next multiple of it, counted from SYNC; 0: at once."""
    mode_change_timeout: PositiveFloat = 1.0
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class SimulationSection:
    """Where this drive leaves the standards, for the simulated drive alone; the master finds out like with a real one.

    `sim.quirks` gives each of them its effect, and names a drive that has it.
    """

    pdos_disabled: bool = False
    """After power-on no PDO is valid, not even the first of each direction."""
    cob_ids_missing: bool = False
    """The COB-IDs of PDOs hold no identifier until one is written."""
    absent: tuple[Index, ...] = ()
    """Objects that the drive does not have."""
    sync_honoured: bool = True
    """False: RPDOs act at once, although their transmission type says at the next SYNC."""
    max_torque: Annotated[int, Ge(0), Le(0xFFFF)] | None = None
    """6072h after power-on [‰ of rated torque]."""
    supported_modes: UInt32 | None = None
    """What 6502h says, whatever the drive can do."""
    mode_change_time: NonNegativeFloat = 0.0
    """[s], from the writing of 6060h until 6061h shows it."""
    boot_time: NonNegativeFloat = 0.0
    """[s], from power-on or a reset to the boot-up message."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class DriveProfile:
    """One drive model; `name` is the file's name without suffix, `source` its path."""

    schema: Literal[1]
    drive: DriveSection
    torque: TorqueSection
    pdo: PdoSection
    timing: TimingSection
    position: PositionSection | None = None
    velocity: VelocitySection | None = None
    """What the drive measures itself; read only where there is no position."""
    identity: IdentitySection = field(default_factory=IdentitySection)
    link_loss: LinkLossSection = field(default_factory=LinkLossSection)
    simulation: SimulationSection = field(default_factory=SimulationSection)
    sources: dict[str, Annotated[str, Len(1)]] = field(default_factory=dict)
    """Where each value comes from, by key; the source of a table covers all in it."""
    name: str = ""
    source: str = ""
    __pydantic_config__: ClassVar = STRICT

    @property
    def title(self) -> str:
        return f"{self.drive.vendor} {self.drive.model}"

    def offers(self) -> dict[Signal, ObjectEntry]:
        """The objects that carry each signal."""
        entries = {
            Signal.STATUSWORD: ObjectEntry(0x6041, DataType.UINT16),
            Signal.CONTROLWORD: ObjectEntry(0x6040, DataType.UINT16),
            Signal.TARGET_TORQUE: self.torque.target.entry,
        }
        if self.position is not None:
            entries[Signal.POSITION] = self.position.actual.entry
        if self.velocity is not None:
            entries[Signal.VELOCITY] = self.velocity.actual.entry
        if self.torque.actual is not None:
            entries[Signal.TORQUE_ACTUAL] = self.torque.actual.entry
        return entries

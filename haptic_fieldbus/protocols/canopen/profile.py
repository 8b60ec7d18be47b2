"""A drive profile on CANopen: the tables that only CANopen has.

These dataclasses are the schema of a profile file with `protocol = "canopen"`.
"""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le, Len

from haptic_fieldbus.drive.cia402 import Cia402Profile, Index, LinkLoss
from haptic_fieldbus.drive.fields import STRICT, NonNegativeFloat, PositiveFloat, UInt32
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.errors import UsageError

TransmissionType = Annotated[int, Ge(0), Le(255)]


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


@dataclass(frozen=True, kw_only=True)
class LinkLossSection(LinkLoss):
    """How the drive notices that the master is gone, and what it then does."""

    heartbeat_consumer: Index | None = None
    deadline: PositiveFloat = 0.05
    """[s]; written to the heartbeat consumer."""
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


@dataclass(frozen=True, kw_only=True)
class CanopenProfile(Cia402Profile):
    """A drive model on CANopen."""

    pdo: PdoSection
    link_loss: LinkLossSection = field(default_factory=LinkLossSection)
    simulation: SimulationSection = field(default_factory=SimulationSection)
    __pydantic_config__: ClassVar = STRICT


def canopen_profile(profile: DriveProfile) -> CanopenProfile:
    """A profile that must be one of CANopen; raises UsageError for another."""
    if not isinstance(profile, CanopenProfile):
        raise UsageError(f"{profile.title} speaks {profile.drive.protocol}; here a CANopen drive is needed")
    return profile

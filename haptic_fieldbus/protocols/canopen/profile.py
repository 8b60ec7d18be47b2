"""A drive profile on CANopen: the tables that only CANopen has.

The dataclasses are the schema of a profile file with `protocol = "canopen"`.
"""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le, Len

from haptic_fieldbus.drive.cia402 import Cia402Profile, Index, LinkLoss
from haptic_fieldbus.drive.fields import STRICT, NonNegativeTime, UInt32
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.pdo import Direction

TransmissionType = Annotated[int, Ge(0), Le(255)]
Entries = Annotated[int, Ge(0), Le(64)]


@dataclass(frozen=True)
class PdoSection:
    """PDOs of a drive: their number, size and transmission types."""

    tpdo_types: Annotated[tuple[TransmissionType, ...], Len(1)]
    rpdo_types: Annotated[tuple[TransmissionType, ...], Len(1)]
    rpdo_acts: Literal["reception", "next_sync", "unknown"] = "unknown"
    """Event at which the content of an event-driven RPDO becomes the target of the drive."""
    tpdos: Annotated[int, Ge(0), Le(512)] = 4
    rpdos: Annotated[int, Ge(0), Le(512)] = 4
    entries: Annotated[int, Ge(1), Le(64)] = 8
    """Number of mapping entries of one PDO."""
    tpdo_entries: tuple[Entries, ...] = ()
    """Number of mapping entries of TPDO 1, 2, 3 … where they are not all `entries`; 0: there is no such TPDO, or its
    mapping is fixed."""
    rpdo_entries: tuple[Entries, ...] = ()
    """The same for RPDOs."""
    inhibit_time_default: Annotated[float, Ge(0), Le(6.5535)] = 0.0
    """Inhibit time of a TPDO after power-on [s]; 1800h:03 has 16 bits of 100 µs."""
    __pydantic_config__: ClassVar = STRICT

    def room(self, direction: Direction) -> dict[int, int]:
        """Return the number of mapping entries of each PDO of a direction, by the number of the PDO."""
        sent = direction is Direction.TPDO
        listed = self.tpdo_entries if sent else self.rpdo_entries
        return dict(enumerate(listed or (self.entries,) * (self.tpdos if sent else self.rpdos), start=1))


@dataclass(frozen=True, kw_only=True)
class LinkLossSection(LinkLoss):
    """Detection of a master that is gone, and the reaction of the drive."""

    heartbeat_consumer: Index | None = None
    life_guarding: bool = False
    """True: the drive watches the master's requests of node guarding, by 100Ch and 100Dh; for one without 1016h."""
    deadline: Annotated[float, Gt(0), Ge(0.001), Le(65.535)] = 0.05
    """Longest time without a proof of the master's life [s]; written to the heartbeat consumer, in ms of 16 bits, or
    as the life time."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class SimulationSection:
    """Deviations of this drive from the standards, for the simulation alone; the master meets them as on a real drive.

    `sim.canopen.model.quirks` implements each of them, and names a drive that has it.
    """

    pdos_disabled: bool = False
    """After power-on no PDO is valid, not even the first of each direction."""
    cob_ids_missing: bool = False
    """The COB-IDs of PDOs hold no identifier until one is written."""
    absent: tuple[Index, ...] = ()
    """Objects that the drive does not have."""
    sync_honoured: bool = True
    """False: RPDOs act at once, although by their transmission type they act at the next SYNC."""
    max_torque: Annotated[int, Ge(0), Le(0xFFFF)] | None = None
    """6072h after power-on [‰ of rated torque]."""
    supported_modes: UInt32 | None = None
    """Value of 6502h, whatever the drive can do."""
    mode_change_time: NonNegativeTime = 0.0
    """Time from the writing of 6060h until 6061h shows the mode [s]."""
    boot_time: NonNegativeTime = 0.0
    """Time from power-on or a reset to the boot-up message [s]."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, kw_only=True)
class CanopenProfile(Cia402Profile):
    """Profile of a drive model on CANopen."""

    pdo: PdoSection
    link_loss: LinkLossSection = field(default_factory=LinkLossSection)
    simulation: SimulationSection = field(default_factory=SimulationSection)
    __pydantic_config__: ClassVar = STRICT

    @property
    def guarded(self) -> bool:
        """True when the profile names a watch on the master, and a reaction of the drive to its loss."""
        section = self.link_loss
        reacts = section.abort_connection_option is not None or section.fault_reaction_option is not None
        return reacts and (section.heartbeat_consumer is not None or section.life_guarding)


def canopen_profile(profile: DriveProfile) -> CanopenProfile:
    """Return the profile as one of CANopen; raises UsageError when it is one of another protocol."""
    if not isinstance(profile, CanopenProfile):
        raise UsageError(f"{profile.title} speaks {profile.drive.protocol}; here a CANopen drive is needed")
    return profile

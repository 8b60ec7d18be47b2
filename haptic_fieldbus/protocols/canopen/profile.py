"""A drive profile on CANopen: the tables that only CANopen has.

The dataclasses are the schema of a profile file with `protocol = "canopen"`.
"""

import re
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, Len

from haptic_fieldbus.documents import Document, KeyPath
from haptic_fieldbus.drive import rig
from haptic_fieldbus.drive.cia402 import ECHOES, Cia402Profile, Index, LinkLoss, WrittenObject
from haptic_fieldbus.drive.fields import NonNegativeTime, Table, UInt32
from haptic_fieldbus.drive.profile import DataType, DriveProfile, ObjectEntry
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols import protocol
from haptic_fieldbus.protocols.canopen.pdo import LARGEST_PAYLOAD, OCTETS, Direction, FixedPdo

# Checks of a CANopen profile that its dataclasses cannot state.

# The types and units that the master can scale, by the key of the profile.
_TYPES: dict[KeyPath, tuple[str, ...]] = {
    **dict.fromkeys(protocol.TORQUES, ("int16", "int32")),
    ("position", "actual"): ("int32",),
    ("velocity", "actual"): ("int32",),
}
_UNITS: dict[KeyPath, tuple[str, ...]] = {
    **dict.fromkeys(protocol.TORQUES, rig.TORQUE_UNITS),
    ("torque", "rated"): tuple(rig.RATED_TORQUE_UNITS),
    ("torque", "rated_current"): (rig.MILLIAMPERE,),
    ("position", "actual"): (rig.COUNTS, rig.TENTH_DEGREE),
    ("velocity", "actual"): rig.VELOCITY_UNITS,
}
SECOND_AXIS, PROFILE_END = 0x6800, 0xA000
"""First object of the second axis of a node, and the end of the area of device profiles (CiA 301): 800h for each axis.

The objects that enable a drive are those of its first axis.
"""
_PLACE = re.compile(r"[0-9A-Fa-f]{4}(-[0-9A-Fa-f]{4})?(:[0-9A-Fa-f]{1,2}(-[0-9A-Fa-f]{1,2})?)?")
"""Key of an object, or of several."""
_OPTIONS = (("link_loss", "abort_connection_option"), ("link_loss", "fault_reaction_option"))


def check_profile(document: Document) -> None:
    """Note all faults of a profile that go beyond its schema."""
    protocol.check_motion(document)
    if protocol.check_usable(document):  # a profile of an unusable drive may have any types and units
        protocol.check_types(document, _TYPES)
        protocol.check_units(document, _UNITS)
    _check_objects(document)
    # What is asked is the target itself, which every profile has.
    protocol.check_echo(document, ECHOES.keys() - {"asked"}, "object")
    # A node has either heartbeats or node guarding (CiA 301 7.2.8.3.2).
    guarding, expected = ("link_loss", "life_guarding"), "expected exactly one of them"
    if document.value(*guarding) is True and "heartbeat_consumer" in document.table("link_loss"):
        document.fault(guarding, f"true together with link_loss.heartbeat_consumer; {expected}")
    _check_fixed(document)
    _check_simulated(document)
    for path in (*document.rows("setup", "writes"), ("torque", "slope")):
        protocol.check_fits(document, (*path, "value"), document.value(*path, "value"), document.value(*path, "type"))


def _check_objects(document: Document) -> None:
    """Note an object that two keys name: each object has one use, so the second is a slip of copying."""
    used: dict[tuple[int, str], str] = {}
    for path in (*_UNITS, *_OPTIONS):
        index, subindex = document.value(*path, "object"), str(document.value(*path, "subindex") or 0)
        if not isinstance(index, int):
            continue
        name = ".".join(map(str, path))
        if SECOND_AXIS <= index < PROFILE_END:
            document.fault((*path, "object"), f"0x{index:04X} is of a second axis; only the first can be driven")
        first = used.setdefault((index, subindex), name)
        if first != name:
            document.fault((*path, "object"), f"0x{index:04X} is already used by {first}; expected another object")


def _check_fixed(document: Document) -> None:
    """Note a fixed mapping that no frame carries, and a PDO that is named twice."""
    for key in ("tpdo_fixed", "rpdo_fixed"):
        numbers: set[object] = set()
        for path in document.rows("pdo", key):
            bits = [value & 0xFF for value in document.rows(*path, "maps").values() if isinstance(value, int)]
            if sum(bits) > 8 * LARGEST_PAYLOAD or any(each not in OCTETS for each in bits):
                expected = "objects of 8, 16 or 32 bits, 64 together, as in [0x60400010, 0x60710010]"
                document.fault((*path, "maps"), f"not a PDO mapping; expected {expected}")
            number = document.value(*path, "number")
            if type(number) is int and number in numbers:
                document.fault((*path, "number"), f"{number} is already used; expected another one")
            numbers |= {number} if type(number) is int else set()


def _check_simulated(document: Document) -> None:
    """Note a key of the simulated drive that names no object."""
    forms = 'expected hexadecimal numbers or ranges as in "6007", "60C2:01" or "1400-1403:05"'
    for table in ("objects", "differs"):
        for key in document.table("simulation", table):
            if not _PLACE.fullmatch(key):
                document.fault(("simulation", table, key), f"no object; {forms}")


AccessType = Literal["ro", "wo", "rw", "rwr", "rww", "const"]
"""Access types of an EDS (CiA 306-1)."""
NO_SUCH = "left out: the drive has no "
"""Beginning of the source of what a drive was found to lack; the object follows."""
TransmissionType = Annotated[int, Ge(0), Le(255)]
Entries = Annotated[int, Ge(0), Le(64)]


@dataclass(frozen=True)
class PdoSection(Table):
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
    tpdo_fixed: tuple[FixedPdo, ...] = ()
    """TPDOs with a mapping that cannot be written; they have no room."""
    rpdo_fixed: tuple[FixedPdo, ...] = ()
    """The same for RPDOs."""
    inhibit_time_default: Annotated[float, Ge(0), Le(6.5535)] = 0.0
    """Inhibit time of a TPDO after power-on [s]; 1800h:03 has 16 bits of 100 µs."""

    def room(self, direction: Direction) -> dict[int, int]:
        """Return the number of mapping entries of each PDO of a direction, by the number of the PDO."""
        sent = direction is Direction.TPDO
        listed = self.tpdo_entries if sent else self.rpdo_entries
        room = dict(enumerate(listed or (self.entries,) * (self.tpdos if sent else self.rpdos), start=1))
        return room | {each.number: 0 for each in self.fixed(direction)}

    def fixed(self, direction: Direction) -> tuple[FixedPdo, ...]:
        """Return the PDOs of a direction with a fixed mapping."""
        return self.tpdo_fixed if direction is Direction.TPDO else self.rpdo_fixed


@dataclass(frozen=True, kw_only=True)
class LinkLossSection(LinkLoss):
    """Detection of a master that is gone, and the reaction of the drive."""

    heartbeat_consumer: Index | None = None
    life_guarding: bool = False
    """True: the drive watches the master's requests of node guarding, by 100Ch and 100Dh; for one without 1016h."""
    reacts: bool = False
    """True: the drive lets go by itself when its watch ends, although it has no option object that says so."""
    deadline: Annotated[float, Gt(0), Ge(0.001), Le(65.535)] = 0.05
    """Longest time without a proof of the master's life [s]; written to the heartbeat consumer, in ms of 16 bits, or
    as the life time."""


@dataclass(frozen=True)
class SetupSection(Table):
    """Objects that the drive needs to hold before its mode is set, in the order in which they are written."""

    writes: tuple[WrittenObject, ...] = ()


@dataclass(frozen=True)
class SyncSection(Table):
    """Objects that tell the drive the period of the loop, and the periods that it takes."""

    interpolation_time: Index | None = None
    """60C2h: the period is sub-index 1 times ten to the power of sub-index 2 [s]."""
    powers: tuple[Annotated[int, Ge(-9), Le(0)], ...] = (-3,)
    """Values of 60C2h:02 that the drive takes, the best first."""
    values: tuple[Annotated[int, Ge(1), Le(255)], Annotated[int, Ge(1), Le(255)]] = (1, 255)
    """Smallest and largest value of 60C2h:01."""
    cycle_period: Index | None = None
    """1006h, communication cycle period [µs]."""
    shortest_period: NonNegativeTime = 0.0
    """Shortest period that the drive takes [s]; 0: none is known."""


@dataclass(frozen=True)
class ShownObject(Table):
    """A value that only the vendor's tool can set, which is read and shown."""

    name: Annotated[str, Len(1)]
    object: Index
    type: DataType
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    unit: str = ""
    needed: bool = False
    """True: with 0 the drive was never commissioned, and is refused."""

    @property
    def entry(self) -> ObjectEntry:
        """The object as an entry of the object dictionary."""
        return ObjectEntry(self.object, self.type, self.subindex)


@dataclass(frozen=True)
class CommissioningSection(Table):
    """Settings that a person makes with the vendor's tool: motor data, commutation, current loop, I²t."""

    tool: str = ""
    shown: tuple[ShownObject, ...] = ()


@dataclass(frozen=True)
class SimulatedObject(Table):
    """One sub-index of the simulated drive as the real drive has it; None: as the simulated drive has it anyway.

    The values are those of an EDS. `value` is the power-on value; "$NODEID+0x180" contains the node-ID.
    """

    absent: bool = False
    type: DataType | None = None
    """Needed for an object that the simulated drive does not have otherwise."""
    access: AccessType | None = None
    value: int | str | None = None
    low: int | None = None
    high: int | None = None
    mappable: bool | None = None


@dataclass(frozen=True)
class SimulationSection(Table):
    """Deviations of this drive from the standards, for the simulation alone; the master meets them as on a real drive.

    `sim.canopen.slave` implements each of them, and the README of the profiles names drives that have it.
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
    modes: tuple[Annotated[int, Ge(-128), Le(127)], ...] | None = None
    """Modes of operation that the drive has; None: all that the simulated drive implements."""
    objects: dict[str, SimulatedObject] = field(default_factory=dict)
    """Differences of the drive from the simulated one, by index and sub-index, each a number or a range: "6007", …"""
    differs: dict[str, Annotated[str, Len(1)]] = field(default_factory=dict)
    """Why the simulated drive differs from the vendor's file all the same, by index, or index and sub-index."""


@dataclass(frozen=True, kw_only=True)
class CanopenProfile(Cia402Profile):
    """Profile of a drive model on CANopen."""

    pdo: PdoSection
    setup: SetupSection = field(default_factory=SetupSection)
    sync: SyncSection = field(default_factory=SyncSection)
    commissioning: CommissioningSection = field(default_factory=CommissioningSection)
    link_loss: LinkLossSection = field(default_factory=LinkLossSection)
    simulation: SimulationSection = field(default_factory=SimulationSection)

    @property
    def guarded(self) -> bool:
        """True when the profile names a watch on the master, and a reaction of the drive to its loss."""
        section = self.link_loss
        reacts = section.reacts or section.abort_connection_option or section.fault_reaction_option
        return bool(reacts) and (section.heartbeat_consumer is not None or section.life_guarding)

    @property
    def brakes(self) -> bool:
        return self.guarded and self.link_loss.abort_connection_option is not None


def canopen_profile(profile: DriveProfile) -> CanopenProfile:
    """Return the profile as one of CANopen; raises UsageError when it is one of another protocol."""
    if not isinstance(profile, CanopenProfile):
        raise UsageError(f"{profile.title} uses {profile.drive.protocol}; expected a CANopen drive")
    return profile

"""Profile of a drive with the objects of CiA 402, on any protocol: the object of each signal, and option codes.

Reference: IEC 61800-7-201 (CiA 402-2).
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Le

from haptic_fieldbus.drive.fields import Table, UInt32
from haptic_fieldbus.drive.profile import DataType, DriveProfile, MappedSignal, ObjectEntry
from haptic_fieldbus.drive.rig import is_current
from haptic_fieldbus.signals import Signal

Index = Annotated[int, Ge(0x1000), Le(0xFFFF)]
"""Index of an object; the indices below 1000h are those of data types."""


ECHOES = {"demand": Signal.TORQUE_DEMAND, "actual": Signal.TORQUE_ACTUAL, "asked": Signal.TARGET_ASKED}
"""Way of `torque.echo` → signal that comes back."""


@dataclass(frozen=True)
class MappedObject(Table):
    """An object that carries a signal, as written in a profile."""

    object: Index
    type: DataType
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    unit: str = ""

    @property
    def entry(self) -> ObjectEntry:
        """The object as an entry of the object dictionary."""
        return ObjectEntry(self.object, self.type, self.subindex, self.unit)


@dataclass(frozen=True)
class OptionCode(Table):
    """An option object and the value that it must hold while force is rendered."""

    object: Index
    value: Annotated[int, Ge(-32768), Le(32767)]  # option codes are of the type INTEGER16

    @property
    def entry(self) -> ObjectEntry:
        """The object as an entry of the object dictionary."""
        return ObjectEntry(self.object, DataType.INT16)


@dataclass(frozen=True)
class WrittenObject(Table):
    """An object that is written before the drive is enabled, and read back."""

    object: Index
    type: DataType
    value: Annotated[int, Ge(-0x8000_0000), Le(0xFFFF_FFFF)]
    subindex: Annotated[int, Ge(0), Le(255)] = 0

    @property
    def entry(self) -> ObjectEntry:
        """The object as an entry of the object dictionary."""
        return ObjectEntry(self.object, self.type, self.subindex)


@dataclass(frozen=True)
class IdentitySection(Table):
    """Identity that is compared with 1018h before anything is written; None, or no codes: not compared."""

    vendor_id: UInt32 | None = None
    product_codes: tuple[UInt32, ...] = ()


@dataclass(frozen=True)
class TorqueSection(Table):
    """Torque objects, and the mode of operation in which the drive follows its target torque."""

    mode_of_operation: Annotated[int, Ge(-128), Le(127)]
    target: MappedObject
    actual: MappedObject | None = None
    rated: MappedObject | None = None
    demand: MappedObject | None = None
    """Target torque as the drive has taken it over, in the unit of `target`: 6074h, or an object of the vendor."""
    echo: Literal["demand", "actual", "asked", "none"] = "none"
    """Object in which a set-point comes back, so that the loop sees whether its set-points act; asked: `target` itself,
    which is read between the periods."""
    rated_current: MappedObject | None = None
    """Rated current, read at configuration and compared with the rig; for a unit that is a share of it."""
    slope: WrittenObject | None = None
    """Torque slope (6087h) of a drive that ramps to its target [‰ of rated torque per s]; its value is written."""
    controlword: Annotated[int, Ge(0), Le(0xFFFF)] = 0
    """Bits of the controlword that the mode needs beside those of *enable operation*."""


@dataclass(frozen=True)
class PositionSection(Table):
    """Object of the position actual value."""

    actual: MappedObject


@dataclass(frozen=True)
class VelocitySection(Table):
    """Object of the velocity actual value."""

    actual: MappedObject


@dataclass(frozen=True, kw_only=True)
class LinkLoss(Table):
    """Options that decide how the drive reacts when its master is gone; None: the drive has no such object."""

    abort_connection_option: OptionCode | None = None
    fault_reaction_option: OptionCode | None = None


@dataclass(frozen=True, kw_only=True)
class Cia402Profile(DriveProfile):
    """A drive model described by its objects."""

    torque: TorqueSection
    position: PositionSection | None = None
    velocity: VelocitySection | None = None
    """Velocity measured by the drive; read only when the drive offers no position."""
    identity: IdentitySection = field(default_factory=IdentitySection)
    link_loss: LinkLoss = field(default_factory=LinkLoss)

    @property
    def ramp(self) -> float:
        """Time in which the torque goes from zero to rated by the drive's own slope [s]; 0: at once."""
        slope = self.torque.slope
        return 0.0 if slope is None or not slope.value else 1e3 / slope.value

    @property
    def rating_told(self) -> bool:
        told = self.torque.rated_current if is_current(self.torque.target.unit) else self.torque.rated
        return told is not None

    @property
    def echo(self) -> Signal | None:
        """Signal that `torque.echo` names."""
        return ECHOES.get(self.torque.echo)

    def entries(self) -> dict[Signal, ObjectEntry]:
        """Return the object that carries each signal which the drive offers."""
        torque, position, velocity = self.torque, self.position, self.velocity
        # The standard fixes the objects of statusword and controlword; a profile gives all others.
        named = {
            Signal.STATUSWORD: ObjectEntry(0x6041, DataType.UINT16),
            Signal.CONTROLWORD: ObjectEntry(0x6040, DataType.UINT16),
            Signal.TARGET_TORQUE: torque.target.entry,
            Signal.POSITION: position.actual.entry if position else None,
            Signal.VELOCITY: velocity.actual.entry if velocity else None,
            Signal.TORQUE_ACTUAL: torque.actual.entry if torque.actual else None,
            Signal.TORQUE_DEMAND: torque.demand.entry if torque.demand else None,
            Signal.TARGET_ASKED: torque.target.entry if self.echo is Signal.TARGET_ASKED else None,
        }
        return {signal: entry for signal, entry in named.items() if entry is not None}

    def offers(self) -> dict[Signal, MappedSignal]:
        """Return each signal as the drive carries it, in the form that is common to all protocols."""
        return {
            signal: MappedSignal(signal, str(entry), entry.type, entry.unit) for signal, entry in self.entries().items()
        }

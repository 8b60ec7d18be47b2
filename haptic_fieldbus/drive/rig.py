"""A rig: the drives, motors and mechanics of one bench.

All values are at the motor shaft and SI, except `limits`, which are in the workspace of the axis (N or N·m, m or rad).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Len

from haptic_fieldbus.drive.fields import (
    STRICT,
    Counts,
    CountsPerRevolution,
    Current,
    Damping,
    Friction,
    GearRatio,
    HandleAcceleration,
    HandleEffort,
    HandleLength,
    HandleRange,
    HandleSpeed,
    Inertia,
    MetresPerRevolution,
    PositiveFloat,
    Power,
    PulseShare,
    Ranged,
    Time,
    Torque,
    TorqueConstant,
    UInt32,
)
from haptic_fieldbus.drive.identity import Identity, digest_of, known_number
from haptic_fieldbus.drive.mechanics import Mechanics
from haptic_fieldbus.signals import Workspace

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler


class ByKind:
    """Mark of a union whose member is chosen by `kind`, so that a faulty table is checked against that member alone."""

    def __get_pydantic_core_schema__(self, source: Any, handler: "GetCoreSchemaHandler") -> Any:
        """Return the schema of a union discriminated by `kind`, for Pydantic."""
        from pydantic import Field  # a rig that is made in Python does without it

        return handler.generate_schema(Annotated[source, Field(discriminator="kind")])


@dataclass(frozen=True)
class BusSection:
    """A bus of a rig, with the keys that all protocols share; each protocol may add keys of its own."""

    interface: Annotated[str, Len(1)]
    """What speaks to the wires: an interface of python-can, or the first word of a bus name of another protocol."""
    channel: Annotated[str, Len(1)]
    """Which of them, as the interface names it."""
    protocol: ClassVar[str] = ""
    # Further keys are checked by the section of the protocol, which is chosen by `interface`.
    __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "ignore"}

    @property
    def simulated(self) -> bool:
        """True when the bus is simulated."""
        return False

    @property
    def rehearsed(self) -> bool:
        """True when the bus is treated as a real one, and its drives are simulated in this program."""
        return False

    @property
    def lateness(self) -> float:
        """Time by which the simulated host of a simulated bus may be late in a period [s]."""
        return 0.0

    @property
    def wires(self) -> str:
        """What tells one pair of wires from another."""
        return f"{self.interface}:{self.channel}"


@dataclass(frozen=True)
class LinearMechanism:
    """A capstan, belt or screw: the handle moves by `metres_per_revolution` for each turn of the motor."""

    kind: Literal["linear"]
    """Chooses this table."""
    metres_per_revolution: MetresPerRevolution
    """[m] of the handle for a turn of the motor."""
    sign: Literal[-1, 1] = 1
    """-1 where the handle goes to its negative side while the drive counts up."""
    zero: Literal["start"] | Counts = "start"
    """Zero of the handle: its place when the drive is enabled, as with `--zero here`, or an encoder count."""
    __pydantic_config__: ClassVar = STRICT

    @property
    def ratio(self) -> float:
        """Metres of the handle per radian of the motor."""
        return self.metres_per_revolution / (2 * math.pi)

    @property
    def workspace(self) -> Workspace:
        return Workspace.LINEAR


@dataclass(frozen=True)
class RotaryMechanism:
    """A gear, or none: the motor turns `gear_ratio` times as far as the handle."""

    kind: Literal["rotary"]
    """Chooses this table."""
    gear_ratio: GearRatio = 1.0
    """Turns of the motor for a turn of the handle."""
    sign: Literal[-1, 1] = 1
    """-1 where the handle goes to its negative side while the drive counts up."""
    zero: Literal["start"] | Counts = "start"
    """Zero of the handle: its place when the drive is enabled, as with `--zero here`, or an encoder count."""
    __pydantic_config__: ClassVar = STRICT

    @property
    def ratio(self) -> float:
        """Radians of the handle per radian of the motor."""
        return 1.0 / self.gear_ratio

    @property
    def workspace(self) -> Workspace:
        return Workspace.ROTARY


@dataclass(frozen=True)
class Limits:
    """Limits of the handle, in its workspace."""

    effort: HandleEffort | None = None
    """[N or N·m] that the motor may give to the handle; None: its rated torque."""
    speed: HandleSpeed | None = None
    """[m/s or rad/s] at which a run ends; None: one that `plan` shows."""
    position: HandleRange | None = None
    """[m or rad], the lower and the upper place at which a run ends; None: not limited."""
    drift: HandleLength | None = None
    """[m or rad] by which a position that is integrated from velocity may be uncertain; no other position is."""
    acceleration: HandleAcceleration | None = None
    """[m/s² or rad/s²]; None: what the motor and a hand can do to the inertia, where it is known."""
    power: Power | None = None
    """[W] that the motor may give to the hand; None: not limited."""
    stall: Time | None = None
    """[s] for which counts may stand still under torque before the limit falls, where no pulse can ask the encoder
    sooner; None: 90 s."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Permissions:
    """Permissions beyond what a run does by itself; no other value of a rig raises the torque that they bound."""

    sign_pulse: PulseShare | None = None
    """Largest share of rated torque before the sign is seen; None: 0.15."""
    sign_effort: HandleEffort | None = None
    """[N or N·m] at the handle, the most before the sign is seen; None: 5 N or 0.25 N·m."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Proved:
    """Outcome of the last proof of a drive's guard, as a run has written it into the rig file."""

    guard: Literal["proved", "none"]
    """"none": the drive did not let go in time when it was left alone."""
    profile: Annotated[str, Len(1)]
    """Profile of the drive then; a proof with another one does not count."""
    asked_ms: PositiveFloat
    """Time for which the guard was set [ms]; a proof of another time does not count."""
    date: Annotated[str, Len(1)]
    """When that was."""
    guard_ms: PositiveFloat | None = None
    """Measured time from the last thing that we sent until the motor was off [ms]; None: it stayed on."""
    serial: UInt32 | None = None
    """Serial number of the drive; a proof of another drive does not count. None: the drive tells none."""
    vendor: UInt32 | None = None
    """Vendor of the drive, as it told; compared like its serial number."""
    product: UInt32 | None = None
    """Product code of the drive, as it told; compared like its serial number."""
    revision: UInt32 | None = None
    """Revision of the drive, as it told; after an update of its firmware the proof does not count."""
    digest: Annotated[str, Len(1)] | None = None
    """Digest of the values above, of all that was written to the drive for its guard, and of its bus and node. A proof
    with another one does not count; None: an earlier version made the proof, and it does not count either."""
    __pydantic_config__: ClassVar = STRICT

    @property
    def drive(self) -> Identity:
        """The drive whose guard was proved."""
        return Identity(
            known_number(self.vendor),
            known_number(self.product),
            known_number(self.revision),
            known_number(self.serial),
        )

    def digest_with(self, written: Iterable[str]) -> str:
        """Return the digest of the values of this table and of what was written for the guard."""
        own = (self.guard, self.guard_ms, self.asked_ms, self.profile)
        numbers = (self.vendor, self.product, self.revision, self.serial)
        return digest_of((*map(str, (*own, *numbers)), *written))


@dataclass(frozen=True)
class Seen:
    """What was seen on this very bench, and need not be looked for again."""

    sign: Literal["seen"] | None = None
    """That torque moves a simulated drive the right way; on a real bus it is looked for at every start."""
    direction: Literal["confirmed"] | None = None
    """That positions grow to the positive side, as a person has shown."""
    date: Annotated[str, Len(1)] | None = None
    """When that was."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class RigAxis:
    """One drive with its motor and mechanism, at the motor shaft; None: unknown."""

    bus: str
    """Name of its [bus.NAME]."""
    node: Annotated[int, Ge(0)]
    """Number of the drive on its bus, in the range of the protocol."""
    profile: str
    """Drive profile by name, or a file in the folder of the rig."""
    mechanism: Annotated[LinearMechanism | RotaryMechanism, ByKind()]
    encoder_counts_per_revolution: CountsPerRevolution
    """Counts of the position actual value in a turn of the motor."""
    rated_torque: Torque | None = None
    """[N·m] of the motor; compared with what the drive states."""
    torque_constant: TorqueConstant | None = None
    """[N·m/A]; needed only for drives whose torque is given as a current."""
    rated_current: Current | None = None
    """[A]; needed only for drives whose torque is given in ‰ of it."""
    peak_current: Current | None = None
    """[A] of the power stage; needed only for drives whose torque is given as a share of it."""
    inertia: Inertia | None = None
    """[kg·m²] of motor, mechanism and handle together."""
    viscous_damping: Damping | None = None
    """[N·m·s/rad], the friction that grows with speed."""
    coulomb_friction: Friction = 0.0
    """[N·m], the friction that does not."""
    on_link_loss: Literal["free", "brake"] = "free"
    """Reaction of the drive when its master is gone: the shaft is free, or the drive brakes by quick stop."""
    raise_max_torque: bool = False
    """Whether a run may raise the drive's own torque limits to that of the axis, and put them back at its end."""
    emergency_stop: Literal["power"] | None = None
    """"power": a person within reach can cut the power of the motor; needed where no guard of the drive does it."""
    proved: Proved | None = None
    """Proof that the drive lets go by itself; written by a run, None before the first proof."""
    i_know: tuple[Ranged, ...] = ()
    """Keys of this axis whose values are right although they are out of the usual range, as `inertia`."""
    limits: Limits = field(default_factory=Limits)
    permissions: Permissions = field(default_factory=Permissions)
    seen: Seen = field(default_factory=Seen)
    simulation: Mechanics = field(default_factory=Mechanics)
    """Mechanics of a simulated bench beyond a rigid shaft; without effect on anything but the simulation."""
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Rig:
    """The bench: buses and axes by name; `source` is the file's path, empty for the shipped bench."""

    bus: Annotated[dict[str, BusSection], Len(1)]
    axis: Annotated[dict[str, RigAxis], Len(1)]
    source: str = ""
    __pydantic_config__: ClassVar = STRICT

    def unproved(self) -> "Rig":
        """Return the same bench, of which nothing was proved."""
        return replace(self, axis={name: replace(axis, proved=None) for name, axis in self.axis.items()})


def metres_per_revolution(axis: RigAxis) -> float:
    """Return the way of the handle in a turn of the motor [m]; 0 where it turns."""
    return axis.mechanism.metres_per_revolution if isinstance(axis.mechanism, LinearMechanism) else 0.0


COUNTS_PER_REVOLUTION = 4096
"""Of the shipped bench."""


SHIPPED_LIMITS = {
    # So far the hand of each library scene goes at most; the speed is above what a hand reaches in free space.
    Workspace.LINEAR: Limits(speed=10.0, position=(-0.1, 0.1)),
    Workspace.ROTARY: Limits(speed=1.0e4),  # a knob turns without end
}
"""Limits of the shipped bench."""


def shipped_mechanism(workspace: Workspace) -> LinearMechanism | RotaryMechanism:
    """How the motor of the shipped bench moves the handle."""
    if workspace is Workspace.LINEAR:
        return LinearMechanism("linear", metres_per_revolution=0.05)
    return RotaryMechanism("rotary", gear_ratio=1.0)


def default_axis(workspace: Workspace, *, bus: str, node: int, profile: str) -> RigAxis:
    """Return an axis of the shipped bench, which is simulated when no rig file is given."""
    return RigAxis(
        bus=bus,
        node=node,
        profile=profile,
        mechanism=shipped_mechanism(workspace),
        encoder_counts_per_revolution=COUNTS_PER_REVOLUTION,
        rated_torque=0.4,
        torque_constant=0.05,
        rated_current=8.0,
        peak_current=20.0,
        inertia=4.0e-5,
        viscous_damping=1.0e-4,
        coulomb_friction=2.0e-3,
        # The limits of a simulated drive are nobody's settings.
        raise_max_torque=True,
        limits=SHIPPED_LIMITS[workspace],
        # A test per profile proves it.
        seen=Seen(sign="seen"),
    )

"""A rig: the drives, motors and mechanics of one bench.

All values are at the motor shaft and SI, except `limits`, which are in the workspace of the axis (N or N·m, m or rad).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Gt, Le, Len

from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.drive import fields
from haptic_fieldbus.drive.fields import Table
from haptic_fieldbus.drive.profile import Identity, digest_of, known_number
from haptic_fieldbus.signals import Workspace

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler


# The truth of a simulated bench: `[axis.NAME.simulation]` of a rig, each part optional. Values that the axis states too
# replace those in the simulation alone, so that a bench can differ from its rig as real ones do.
#
# Only the simulation uses these values, but for the coupling: without its backlash it counts in stability limits too.
# All are at the motor shaft and SI, unless a field says otherwise.

LARGEST_COGGING = (2.0 * math.pi * 1e4) ** 2
"""Of torque times periods per revolution over inertia [rad/s²]: the shaft then swings in its rest at 10 kHz."""


@dataclass(frozen=True)
class CompliantCoupling(Table):
    """A compliant shaft, belt or gear: spring and damper between motor and load, with the encoder on the motor."""

    stiffness: Annotated[fields.PositiveFloat, fields.Measured(Quantity.STIFFNESS)]
    """[N·m/rad]"""
    load_inertia: fields.Inertia
    """Load inertia: the part of the axis' inertia behind the spring [kg·m²]."""
    damping: fields.Damping = 0.0
    """Damping parallel to the spring [N·m·s/rad]."""
    backlash: Annotated[fields.NonNegativeFloat, fields.Measured(Quantity.LENGTH)] = 0.0
    """Play from one flank to the other [rad]."""


@dataclass(frozen=True)
class Weight(Table):
    """A weight on the handle."""

    torque: Annotated[fields.AnyFloat, fields.Measured(Quantity.EFFORT)]
    """Torque of the weight [N·m]. Linear mechanism: constant, positive towards positive angles. Rotary mechanism: the
    largest torque, with the lever horizontal.
    """
    hanging_at: Annotated[fields.AnyFloat, fields.Measured(Quantity.LENGTH)] = 0.0
    """Angle of a rotary handle at which its lever hangs down [rad], counted from the zero of the simulated encoder."""


@dataclass(frozen=True)
class Cogging(Table):
    """Cogging torque of the motor: −torque·sin(periods_per_revolution·θ), with a stable rest at θ = 0."""

    torque: fields.Friction
    """[N·m]"""
    periods_per_revolution: Annotated[int, Gt(0), Le(1_000_000)]
    """Number of stable rest positions per turn of the motor."""


@dataclass(frozen=True)
class Stribeck(Table):
    """Friction in addition to Coulomb and viscous friction, falling with speed: torque·exp(−(ω/velocity)²)."""

    torque: fields.Friction
    """Friction at rest beyond Coulomb friction [N·m]; the shaft breaks away at the sum of both."""
    velocity: Annotated[fields.PositiveFloat, fields.Measured(Quantity.SPEED)]
    """Speed at which the additional friction has fallen to 1/e [rad/s]."""


@dataclass(frozen=True)
class Mechanics(Table):
    """Simulated bench where it differs from the axis. An omitted part is not simulated, an omitted value is the axis'.
    Plans and limits follow from the values of the axis and from `coupling`.
    """

    coupling: CompliantCoupling | None = None
    gravity: Weight | None = None
    cogging: Cogging | None = None
    stribeck: Stribeck | None = None
    inertia: fields.Inertia | None = None
    """True inertia [kg·m²]. If omitted: the value of the axis."""
    viscous_damping: fields.Damping | None = None
    """True viscous damping [N·m·s/rad]. If omitted: the value of the axis."""
    coulomb_friction: fields.Friction | None = None
    """True Coulomb friction [N·m]. If omitted: the value of the axis."""
    torque_bandwidth: fields.Frequency | None = None
    """True bandwidth of the torque loop [Hz]. If omitted: the value of the profile."""
    encoder_counts_per_revolution: fields.CountsPerRevolution | None = None
    """True counts per turn of the motor; the drive is configured as the axis states. If omitted: the value of the
    axis."""
    torque_scale: fields.TorqueScale = 1.0
    """Torque of the motor over the torque that was asked for; the drive reports the torque that was asked for."""

    @property
    def is_rigid(self) -> bool:
        """True when no part beyond a rigid shaft is given."""
        return self.coupling is None and self.gravity is None and self.cogging is None and self.stribeck is None


# Units of a drive's values, as named in profiles: the size of one step, in SI at the motor shaft.

PERMILLE, MILLIAMPERE, PERMILLE_OF_CURRENT = "permille_of_rated_torque", "mA", "permille_of_rated_current"
PEAK_SHARE, PEAK_SHARE_HIGH = "peak_current/32760", "peak_current/32760/65536"
"""Current of the power stage in 16 bits; and the same in the high word of 32 bits."""
_NEEDED = {
    PERMILLE: (1e-3, ("rated_torque",)),
    MILLIAMPERE: (1e-3, ("torque_constant",)),
    PERMILLE_OF_CURRENT: (1e-3, ("rated_current", "torque_constant")),
    PEAK_SHARE: (1 / 32760, ("peak_current", "torque_constant")),
    PEAK_SHARE_HIGH: (1 / 32760 / 65536, ("peak_current", "torque_constant")),
}
"""Unit of torque → share, and keys of a rig's axis, whose product is one step [N·m]."""
TORQUE_UNITS = tuple(_NEEDED)
SHARES_OF_RATED = (PERMILLE, PERMILLE_OF_CURRENT)
"""Units of torque that are a share of a rated value of the drive."""
RATED_TORQUE_UNITS = {"µN·m": 1e-6, "mN·m": 1e-3, "N·m": 1.0}
"""Unit of the rated torque → size of one step [N·m]."""
FULL_SCALE, MILLINEWTON = "full_scale/32767", "mN"
FULL_SCALE_STEPS = 32767
"""Largest value in the unit `FULL_SCALE`, whatever the type of its register."""
"""A torque of the profile's own in 16 bits; and the force of a motor that goes straight."""
ABSOLUTE_TORQUE_UNITS = (*RATED_TORQUE_UNITS, FULL_SCALE, MILLINEWTON)
"""Units of torque that need no value of the motor."""
COUNTS, TENTH_DEGREE = "counts", "0.1 deg"
STEPS_PER_REVOLUTION = {"mrad": 2e3 * math.pi, TENTH_DEGREE: 3600.0}
"""Unit of a position that is none of the encoder → number of steps in one revolution of the motor."""
METRES = {"µm": 1e-6}
"""Unit of the position of a motor that goes straight → size of one step [m]."""
COUNTS_PER_SECOND = "counts/s"
REVOLUTIONS_PER_SECOND = {"rpm": 1 / 60, "0.1 rpm": 1 / 600, "0.01 rpm": 1 / 6_000, "0.001 rpm": 1 / 60_000}
"""Unit of a velocity (CiA 402-2, 60A9h) → size of one step in revolutions of the motor a second."""
VELOCITY_UNITS = (*REVOLUTIONS_PER_SECOND, COUNTS_PER_SECOND)


def torque_step(unit: str, axis: "RigAxis", full_scale: float | None = None) -> float | None:
    """Return one step of torque [N·m]; None when the rig lacks the value that it follows from (`needed_for`).

    `full_scale` is that of the profile [N·m].
    """
    if unit == FULL_SCALE:
        return None if full_scale is None else full_scale / FULL_SCALE_STEPS
    if unit == MILLINEWTON:
        return 1e-3 * axis.mechanism.ratio if axis.mechanism.kind == "linear" else None
    if unit in RATED_TORQUE_UNITS:
        return RATED_TORQUE_UNITS[unit]
    share, keys = _NEEDED[unit]
    factors = [getattr(axis, key) for key in keys]
    return None if None in factors else math.prod(factors) * share


def is_current(unit: str) -> bool:
    """Return whether a torque of this unit is a current, so that the rig's torque constant scales it."""
    return unit in _NEEDED and "torque_constant" in _NEEDED[unit][1]


def needed_for(unit: str, axis: "RigAxis | None" = None) -> str:
    """Return the keys of a rig's axis from which a step of torque follows, in words; only those that `axis` lacks."""
    if unit in ABSOLUTE_TORQUE_UNITS:
        return "linear mechanism"
    return " and ".join(key for key in _NEEDED[unit][1] if axis is None or getattr(axis, key) is None)


def steps_per_revolution(unit: str, counts_per_revolution: int, metres_per_revolution: float = 0.0) -> float:
    """Return the number of position steps in one revolution of the motor; 0 for a length without a linear mechanism."""
    if unit in METRES:
        return metres_per_revolution / METRES[unit]
    return STEPS_PER_REVOLUTION.get(unit, counts_per_revolution)


def velocity_step(unit: str, counts_per_revolution: int) -> float:
    """Return one step of a velocity [rad/s]; a unit not in revolutions is taken as counts a second."""
    return 2 * math.pi * REVOLUTIONS_PER_SECOND.get(unit, 1 / counts_per_revolution)


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
    """Interface to the bus: an interface of python-can, or the first word of a bus name of another protocol."""
    channel: Annotated[str, Len(1)]
    """Channel of the interface, in the notation of the interface."""
    protocol: ClassVar[str] = ""
    stands_for_real: ClassVar[bool] = False
    """True for a simulated bus in the place of a real one of a rig: the limit is that of the real one."""
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

    def in_place_of_real(self) -> "BusSection":
        """Return this simulated bus as one in the place of a real one."""
        return self

    @property
    def lateness(self) -> float:
        """Time by which the simulated host of a simulated bus may be late in a period [s]."""
        return 0.0

    @property
    def wires(self) -> str:
        """Key that distinguishes one pair of wires from another."""
        return f"{self.interface}:{self.channel}"

    @property
    def route(self) -> str:
        """Wires and stated delay of the adapter: a delay that was measured holds for them."""
        return self.wires


@dataclass(frozen=True)
class LinearMechanism(Table):
    """A capstan, belt or screw: the handle moves by `metres_per_revolution` for each turn of the motor."""

    kind: Literal["linear"]
    """Chooses this table."""
    metres_per_revolution: fields.MetresPerRevolution
    """Travel of the handle per turn of the motor [m]."""
    sign: Literal[-1, 1] = 1
    """-1 if the handle moves to its negative side while the drive counts up."""
    zero: Literal["start"] | fields.Counts = "start"
    """Zero of the handle: "start", its position at enabling (as with `--zero here`), or an encoder count."""
    workspace: ClassVar[Workspace] = Workspace.LINEAR

    @property
    def ratio(self) -> float:
        """Metres of the handle per radian of the motor."""
        return self.metres_per_revolution / (2 * math.pi)


@dataclass(frozen=True)
class RotaryMechanism(Table):
    """A gear, or none: the motor turns `gear_ratio` times as far as the handle."""

    kind: Literal["rotary"]
    """Chooses this table."""
    gear_ratio: fields.GearRatio = 1.0
    """Turns of the motor for a turn of the handle."""
    sign: Literal[-1, 1] = 1
    """-1 where the handle goes to its negative side while the drive counts up."""
    zero: Literal["start"] | fields.Counts = "start"
    """Zero of the handle: its place when the drive is enabled, as with `--zero here`, or an encoder count."""
    workspace: ClassVar[Workspace] = Workspace.ROTARY

    @property
    def ratio(self) -> float:
        """Radians of the handle per radian of the motor."""
        return 1.0 / self.gear_ratio


@dataclass(frozen=True)
class Limits(Table):
    """Limits of the handle, in its workspace."""

    effort: fields.HandleEffort | None = None
    """Largest force of the motor at the handle [N or N·m]. None: from its rated torque."""
    speed: fields.HandleSpeed | None = None
    """Speed at which a run trips [m/s or rad/s]. None: the value that `plan` shows."""
    position: fields.HandleRange | None = None
    """Lower and upper position at which a run trips [m or rad]. None: no limit."""
    drift: fields.HandleLength | None = None
    """Largest uncertainty of a position integrated from velocity [m or rad]; without effect on drives that report their
    position."""
    acceleration: fields.HandleAcceleration | None = None
    """Acceleration at which a run trips [m/s² or rad/s²]. None: the largest acceleration of the inertia by motor and
    hand, if the inertia is known."""
    power: fields.Power | None = None
    """Largest power from the motor to the hand [W]. None: no limit."""
    stall: fields.Time | None = None
    """Time for which encoder counts may stay constant under torque before the torque limit falls [s]; used if torque
    pulses cannot test the encoder sooner. None: 90 s."""


@dataclass(frozen=True)
class Permissions(Table):
    """Permissions for more torque before the motor direction is confirmed; no other key of a rig raises these
    limits."""

    sign_pulse: fields.PulseShare | None = None
    """Largest share of rated torque before the motor direction is confirmed. None: 0.15."""
    sign_effort: fields.HandleEffort | None = None
    """Largest force at the handle before the motor direction is confirmed [N or N·m]. None: 5 N or 0.25 N·m."""


@dataclass(frozen=True)
class Proved(Table):
    """Result of the last watchdog proof of the drive; a run writes it into the rig file."""

    guard: Literal["proved", "none"]
    """"none": the watchdog did not fire in time."""
    profile: Annotated[str, Len(1)]
    """Profile of the drive at the proof; with another profile the proof is not valid."""
    asked_ms: fields.PositiveFloat
    """Set time of the watchdog [ms]; for another time the proof is not valid."""
    date: Annotated[str, Len(1)]
    """Date of the entry. (Proved: "Date of the proof."; Seen: "Date of the observation.")"""
    guard_ms: fields.PositiveFloat | None = None
    """Measured time from our last frame until the motor was off [ms]. None: it stayed on."""
    serial: fields.UInt32 | None = None
    """Serial number of the drive; for another drive the proof is not valid. None: the drive has no serial number."""
    vendor: fields.UInt32 | None = None
    """Vendor-ID read from the drive; checked like the serial number."""
    product: fields.UInt32 | None = None
    """Product code read from the drive; checked like the serial number."""
    revision: fields.UInt32 | None = None
    """Revision read from the drive; after a firmware update the proof is not valid."""
    digest: Annotated[str, Len(1)] | None = None
    """Digest of the values above, of the watchdog settings written to the drive, and of its bus and node. With another
    digest the proof is not valid. None: an earlier version made the proof; it is not valid either."""

    @property
    def drive(self) -> Identity:
        """The drive whose guard was proved."""
        return Identity(*map(known_number, (self.vendor, self.product, self.revision, self.serial)))

    def digest_with(self, written: Iterable[str]) -> str:
        """Return the digest of the values of this table and of what was written for the guard."""
        own = (self.guard, self.guard_ms, self.asked_ms, self.profile)
        numbers = (self.vendor, self.product, self.revision, self.serial)
        return digest_of((*map(str, (*own, *numbers)), *written))


@dataclass(frozen=True)
class Seen(Table):
    """Observations on this bench that later runs need not repeat."""

    sign: Literal["seen"] | None = None
    """"seen": the motor direction of a simulated drive is confirmed; on a real bus it is tested at every start."""
    direction: Literal["confirmed"] | None = None
    """"confirmed": a person showed that positions grow to the positive side."""
    date: Annotated[str, Len(1)] | None = None
    """When that was."""


@dataclass(frozen=True)
class Identified(Table):
    """Values measured by `haptic-fieldbus identify`, each with its interval of 95 %. They take the place of the values
    of the axis in plans and limits."""

    inertia: fields.Inertia | None = None
    """[kg·m²]"""
    inertia_interval: Annotated[fields.Interval, fields.Measured(Quantity.MASS)] | None = None
    """Interval of 95 % of the value above [kg·m²]."""
    viscous_damping: fields.Damping | None = None
    """[N·m·s/rad]"""
    viscous_damping_interval: Annotated[fields.Interval, fields.Measured(Quantity.DAMPING)] | None = None
    """Interval of 95 % of the value above [N·m·s/rad]."""
    coulomb_friction: fields.Friction | None = None
    """[N·m]"""
    coulomb_friction_interval: Annotated[fields.Interval, fields.Measured(Quantity.EFFORT)] | None = None
    """Interval of 95 % of the value above [N·m]."""
    delay_and_lag: fields.NonNegativeTime | None = None
    """Time from the latch of a sample until its torque acts, with the lag of the torque loop [s]."""
    delay_and_lag_interval: Annotated[fields.Interval, fields.Measured(Quantity.TIME)] | None = None
    """Interval of 95 % of the value above [s]."""
    torque_lag: fields.NonNegativeTime | None = None
    """Time constant of the torque loop [s]."""
    torque_lag_interval: Annotated[fields.Interval, fields.Measured(Quantity.TIME)] | None = None
    """Interval of 95 % of the value above [s]."""
    date: Annotated[str, Len(1)] | None = None
    """Date of the measurement."""
    profile: Annotated[str, Len(1)] | None = None
    """Profile of the drive at the measurement."""
    rate: fields.Frequency | None = None
    """Loop rate at the measurement [Hz]."""
    planned_delay: fields.NonNegativeTime | None = None
    """Delay and lag that the plan of the measurement expected [s]; the difference is kept at other rates. None: the
    measured delay is not used."""
    serial: fields.UInt32 | None = None
    """Serial number of the drive; a run on another drive is refused. None: the drive has no serial number."""
    top_speed: fields.NonNegativeFloat | None = None
    """Largest speed of the motor in the measurement [rad/s]."""
    residual_counts: fields.NonNegativeFloat | None = None
    """Motion that the fit leaves unexplained, root mean square [counts]."""
    axis: Annotated[str, Len(1)] | None = field(default=None, repr=False)
    """Name of the axis at the measurement; on another one no value counts. None: a table of an earlier version."""
    simulated: bool = field(default=False, repr=False)
    """True: measured on a simulated bus; on a real one no value counts."""
    bus: Annotated[str, Len(1)] | None = field(default=None, repr=False)
    """Interface, channel and adapter at the measurement. With others the longest delay of the profile counts too. None:
    a table of an earlier version, as with others."""
    units: Annotated[str, Len(1)] | None = field(default=None, repr=False)
    """Units by which the profile scaled torque and position at the measurement; with others no value counts. None: a
    table of an earlier version."""
    resonance: fields.Frequency | None = field(default=None, repr=False)
    """Resonance of an elastic shaft [Hz]. With it there is no measured value, and no limit is known unless
    `simulation.coupling` states the shaft."""
    digest: Annotated[str, Len(1)] | None = None
    """Digest of the values above and of the values of the axis on which they rest; with another digest none of them
    counts. None: the values are judged like stated ones."""


@dataclass(frozen=True)
class Contradicted(Table):
    """Values below those of the axis that an ordinary run has shown, each with its interval; a run writes them. Until
    the values of the axis or its measurement change, limits rest on them."""

    inertia: fields.Inertia | None = None
    """[kg·m²]"""
    inertia_interval: Annotated[fields.Interval, fields.Measured(Quantity.MASS)] | None = None
    """Interval of the value above [kg·m²]."""
    viscous_damping: fields.Damping | None = None
    """[N·m·s/rad]"""
    viscous_damping_interval: Annotated[fields.Interval, fields.Measured(Quantity.DAMPING)] | None = None
    """Interval of the value above [N·m·s/rad]."""
    simulated: bool = False
    """True: the run was on a simulated bus, and the values count there only."""
    date: Annotated[str, Len(1)] | None = None
    """Date of the run."""
    digest: Annotated[str, Len(1)] | None = None
    """Digest of the values above and of the values that they contradict; with another digest none of them counts."""


@dataclass(frozen=True)
class RigAxis(Table):
    """One drive with its motor and mechanism; values are at the motor shaft. An omitted value is unknown."""

    bus: str
    """Name of its [bus.NAME]."""
    node: Annotated[int, Ge(0)]
    """Node-ID (CANopen) or unit id (Modbus) of the drive on its bus."""
    profile: str
    """Drive profile by name, or a file in the folder of the rig."""
    mechanism: Annotated[LinearMechanism | RotaryMechanism, ByKind()]
    encoder_counts_per_revolution: fields.CountsPerRevolution
    """Counts of the position actual value per turn of the motor."""
    rated_torque: fields.Torque | None = None
    """Rated torque of the motor [N·m]; compared with the value of the drive."""
    torque_constant: fields.TorqueConstant | None = None
    """Torque constant [N·m/A]; needed only for drives whose torque unit is a current."""
    rated_current: fields.Current | None = None
    """Rated current [A]; needed only for drives whose torque unit is ‰ of the rated current."""
    peak_current: fields.Current | None = None
    """Peak current of the power stage [A]; needed only for drives whose torque unit is a share of it."""
    inertia: fields.Inertia | None = None
    """Inertia of motor, mechanism and handle together [kg·m²]."""
    viscous_damping: fields.Damping | None = None
    """Viscous friction [N·m·s/rad]; it grows with speed."""
    coulomb_friction: fields.Friction | None = None
    """Coulomb friction [N·m]; it does not depend on speed. An omitted value is unknown, and not 0."""
    on_link_loss: Literal["free", "brake"] = "free"
    """Reaction of the drive to the loss of its master: the shaft is free, or the drive brakes by quick stop first."""
    raise_max_torque: bool = False
    """True: a run may raise the torque limits in the drive to the limit of the axis, and restores them at its end."""
    emergency_stop: Literal["power"] | None = None
    """"power": a person can cut the motor power by an emergency stop within reach; needed if the drive has no working
    watchdog."""
    proved: Proved | None = None
    """Watchdog proof: the drive switches off by itself; written by a run, None before the first proof."""
    i_know: tuple[fields.Ranged, ...] = ()
    """Keys of this axis whose values are right although they are outside the plausible range, such as `inertia`."""
    limits: Limits = field(default_factory=Limits)
    permissions: Permissions = field(default_factory=Permissions)
    seen: Seen = field(default_factory=Seen)
    identified: Identified = field(default_factory=Identified)
    contradicted: Contradicted = field(default_factory=Contradicted)
    simulation: Mechanics = field(default_factory=Mechanics)
    """Simulated bench where it differs from the values of the axis."""


@dataclass(frozen=True)
class Rig(Table):
    """Bench: buses and axes by name. `source` is the path of the file; empty for the shipped bench."""

    bus: Annotated[dict[str, BusSection], Len(1)]
    axis: Annotated[dict[str, RigAxis], Len(1)]
    source: str = ""

    def unproved(self) -> "Rig":
        """Return the same bench without watchdog proofs."""
        return replace(self, axis={name: replace(axis, proved=None) for name, axis in self.axis.items()})


MECHANICAL = ("inertia", "viscous_damping", "coulomb_friction")
"""Values of an axis without which no limit is known; `identify` measures them."""


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

"""The parts of a simulated drive, built from profile and rig: plant, loops and units.

Values that a rig leaves open (inertia, damping, rated torque) are those of the shipped bench.
"""

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from random import Random

from haptic_fieldbus.drive import rig
from haptic_fieldbus.drive.cia402 import Cia402Profile
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.sim.drive.dictionary import Dictionary
from haptic_fieldbus.sim.drive.objects import Defaults, Objects
from haptic_fieldbus.sim.drive.servo import FirmwareTimes
from haptic_fieldbus.sim.drive.stage import LAGS, Gains
from haptic_fieldbus.sim.drive.units import Units
from haptic_fieldbus.sim.hand import LEADER, Grip, Hand, grip
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant

_RAMP = 0.05
"""Time in which the default ramp reaches the default profile velocity [s]; chosen here."""
_START_JITTER_NS = 40_000
_DRIFT = 5e-5
"""Largest error of the clock of a drive; crystals have 20 to 100 ppm."""
_RESET_NS = (20_000_000, 30_000_000)


@dataclass(frozen=True)
class DriveSettings:
    """Properties of a drive that neither profile nor rig states; a world draws the random ones from its seed."""

    serial: int = 1
    encoder_phase: float = 0.0
    """Position of the encoder's zero within a count, −0.5 to 0.5 [counts]."""
    start_delay_ns: int = 0
    """Time from power-on to the boot-up message."""
    reset_ns: int = 20_000_000
    """Time from a reset to the boot-up message."""
    max_torque_permille: int = 3000
    """6072h, 6073h, 60E0h and 60E1h after power-on [‰ of rated torque]."""
    rated_current: float | None = None
    """6075h [A]; None: that of the rig."""
    modes: frozenset[int] | None = None
    """Modes of operation by the numbers of 6060h, None: all; the profile's torque mode is always offered."""
    without: frozenset[int] = frozenset()
    """Objects of CiA 402-2 that are not in the dictionary; the drive works with their power-on values."""
    mode_change_ns: int = 0
    """Time from the writing of 6060h until 6061h follows; the old mode stays active until then."""
    following_error_faults: bool = False
    """Whether a following error is a fault (8611h) and not only bit 13; the standard leaves this open."""
    sto_error: int = 0
    """Error code of the fault when safe torque off opens while torque is made; 0: no fault, voltage is disabled."""
    position: float = 0.0
    """Shaft angle at power-on [rad]."""
    velocity: float = 0.0
    """Shaft speed at power-on [rad/s]."""
    tick_phase: float = 0.0
    """First control tick after power-on, as a share of the control period; for ticks that run free."""
    tick_drift: float = 0.0
    """Relative error of the drive's clock, positive when it is slow; for ticks that run free."""
    full_scale: float | None = None
    """Full-scale torque, which the value 32767 means in drives with this unit [N·m]; None: no such unit."""
    led: bool = False
    """Whether a hand moves the handle while the drive is off (`LEADER`)."""
    velocity_unit: str | None = None
    """Unit of velocity after power-on, None: that of the profile."""


def drawn_settings(seed: int | str, node: int) -> DriveSettings:
    """Return the random properties of one drive, drawn from the seed and its number on the bus."""
    # A generator for each drive, so that adding a drive changes no other one.
    random = Random(f"{seed}/{node}")
    return DriveSettings(
        serial=random.getrandbits(32),
        encoder_phase=random.random() - 0.5,
        start_delay_ns=random.randrange(_START_JITTER_NS),
        reset_ns=random.randrange(*_RESET_NS),
        tick_phase=random.random(),
        tick_drift=random.uniform(-_DRIFT, _DRIFT),
    )


BUILT_KEYS = ("inertia", "viscous_damping", "coulomb_friction", "encoder_counts_per_revolution")
"""Values of an axis that its simulated bench may have otherwise."""


def as_built(axis: rig.RigAxis) -> rig.RigAxis:
    """Return the axis with the values that its simulated bench really has (`[axis.NAME.simulation]`)."""
    given = {key: getattr(axis.simulation, key) for key in BUILT_KEYS}
    # What nobody states may have been measured.
    given |= {key: getattr(axis.identified, key) for key in rig.MECHANICAL if getattr(axis, key) is given[key] is None}
    return replace(axis, **{key: value for key, value in given.items() if value is not None})


def known_mechanics(axis: rig.RigAxis) -> tuple[float, float, float]:
    """Return inertia [kg·m²], viscous damping [N·m·s/rad] and rated torque [N·m] of the axis.

    Unknown values are those of the shipped bench; raises ValueError when that has none.
    """
    return _known(axis, "inertia"), _known(axis, "viscous_damping"), _known(axis, "rated_torque")


def _known(axis: rig.RigAxis, key: str) -> float:
    """Return a value of the axis, or that of the shipped bench; raises ValueError when that has none."""
    given: float | None = getattr(axis, key)
    if given is None:
        given = getattr(rig.default_axis(axis.mechanism.workspace, bus="", node=1, profile=axis.profile), key)
    if given is None:
        raise ValueError(f"the shipped bench has unknown values: {key}")
    return given


def build_plant(
    profile: DriveProfile, axis: rig.RigAxis, hand: Hand | None, settings: DriveSettings, t_ns: int
) -> Body:
    """Return motor, load and hand at the motor shaft, from `t_ns` on; a rigid shaft unless the rig has more parts."""
    built = as_built(axis)
    inertia, damping, _ = known_mechanics(built)
    shaft = Shaft(inertia, damping, built.coulomb_friction or 0.0, _lag(profile, axis))
    held = grip(hand, axis.mechanism) if hand is not None else None
    plant = _plant(axis, shaft, held, settings, t_ns)
    if settings.led:
        plant.lead_when_off(grip(LEADER, axis.mechanism))
    return plant


def _plant(axis: rig.RigAxis, shaft: Shaft, held: Grip | None, settings: DriveSettings, t_ns: int) -> Body:
    position, velocity = settings.position, settings.velocity
    if axis.simulation.is_rigid:
        return Plant(shaft, held, position=position, velocity=velocity, t_ns=t_ns)
    # Imported here because most rigs are rigid (decision 0007).
    from haptic_fieldbus.sim.mechanics.loaded_plant import Load, LoadedPlant

    mechanism = axis.mechanism
    lever = mechanism.sign * mechanism.ratio if isinstance(mechanism, rig.RotaryMechanism) else None
    load = Load(shaft, axis.simulation, lever)
    return LoadedPlant(load, held, position=position, velocity=velocity, t_ns=t_ns)


def build_timing(profile: Cia402Profile, settings: DriveSettings) -> FirmwareTimes:
    """Return the times of the drive's firmware; without a statement of the profile: locked to SYNC, no latency."""
    timing = profile.timing
    return FirmwareTimes(
        round(timing.control_period * 1e9),
        timing.control_tick == "free",
        settings.tick_phase,
        settings.tick_drift,
        round((timing.encoder_latency or 0.0) * 1e9),
    )


def build_gains(profile: Cia402Profile, axis: rig.RigAxis, tick: float) -> Gains:
    """Return the gains of the drive's own loops for a control tick [s]; they were tuned on the bench as it is."""
    inertia, damping, _ = known_mechanics(as_built(axis))
    return Gains(inertia, damping, 1 / (LAGS * (tick + _lag(profile, axis))))


def build_units(profile: Cia402Profile, axis: rig.RigAxis, objects: Objects, dictionary: Dictionary) -> Units:
    """Return the factor group of this drive, with its own units if the profile names some."""
    counts_per_radian = axis.encoder_counts_per_revolution / (2 * math.pi)
    unit = _own_velocity_unit(profile)
    own = rig.velocity_step(unit, axis.encoder_counts_per_revolution) if unit != rig.COUNTS_PER_SECOND else None
    position = profile.position.actual.unit if profile.position is not None else rig.COUNTS
    angle = Fraction(1, 3600) if position == rig.TENTH_DEGREE else None
    return Units(counts_per_radian, objects.table, dictionary, own, angle)


def _own_velocity_unit(profile: Cia402Profile) -> str:
    return profile.velocity.actual.unit if profile.velocity is not None else rig.COUNTS_PER_SECOND


def object_defaults(profile: Cia402Profile, axis: rig.RigAxis, settings: DriveSettings) -> Defaults:
    """Return the power-on values that follow from the bench.

    The ramps are the acceleration of the inertia alone with half of rated torque. The profile velocity is the speed
    after `_RAMP`.
    """
    inertia, _, rated = known_mechanics(axis)
    counts = axis.encoder_counts_per_revolution
    acceleration = 0.5 * rated / inertia
    unit = settings.velocity_unit or _own_velocity_unit(profile)
    steps = steps_of_position(profile.position.actual.unit if profile.position is not None else rig.COUNTS, axis)
    return Defaults(
        rated_torque=rated,
        serial=settings.serial,
        modes=settings.modes,
        without=settings.without,
        max_torque_permille=settings.max_torque_permille,
        rated_current_ma=round((settings.rated_current or _known(axis, "rated_current")) * 1e3),
        peak_current=_known(axis, "peak_current"),
        torque_constant=_known(axis, "torque_constant"),
        counts_per_revolution=counts,
        velocity=_whole(_RAMP * acceleration / rig.velocity_step(unit, counts)),
        acceleration=_whole(acceleration * steps / (2 * math.pi)),
        lever=axis.mechanism.ratio if isinstance(axis.mechanism, rig.LinearMechanism) else 0.0,
        full_scale=settings.full_scale or 0.0,
    )


def steps_of_position(unit: str, axis: rig.RigAxis) -> float:
    """Return the number of position units in one revolution of the motor."""
    straight = axis.mechanism.metres_per_revolution if isinstance(axis.mechanism, rig.LinearMechanism) else 0.0
    return rig.steps_per_revolution(unit, axis.encoder_counts_per_revolution, straight)


def _whole(value: float) -> int:
    """Return a value rounded to an UNSIGNED32 from 1 up, so small that its double is an UNSIGNED32 too."""
    return max(1, min(0x7FFF_FFFF, round(value)))


def _lag(profile: DriveProfile, axis: rig.RigAxis) -> float:
    """Return the time constant of the torque loop [s]."""
    return 1 / (2 * math.pi * (axis.simulation.torque_bandwidth or profile.timing.torque_bandwidth))

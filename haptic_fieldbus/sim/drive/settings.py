"""What a simulated drive is built from: profile and rig become plant, loops and units.

What a rig leaves open (inertia, damping, rated torque unknown) is taken from the shipped bench.
"""

import math
from dataclasses import dataclass

from haptic_fieldbus.drive.cia402 import Cia402Profile
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis, RotaryMechanism, default_axis
from haptic_fieldbus.drive.units import COUNTS_PER_SECOND, velocity_step
from haptic_fieldbus.sim.drive.dictionary import Dictionary
from haptic_fieldbus.sim.drive.object_table import Defaults
from haptic_fieldbus.sim.drive.objects import Objects
from haptic_fieldbus.sim.drive.stage import Gains, gains
from haptic_fieldbus.sim.drive.units import Units
from haptic_fieldbus.sim.hand import Hand, grip
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.mechanics.motion import Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant

_RAMP = 0.05
"""[s]; chosen here."""


@dataclass(frozen=True)
class DriveSettings:
    """What is neither in profile nor rig; the world draws the random ones from its seed."""

    serial: int = 1
    encoder_phase: float = 0.0
    """[counts], −0.5 to 0.5: where within a count the encoder's zero lies."""
    start_delay_ns: int = 0
    """From power-on to the boot-up message."""
    reset_ns: int = 20_000_000
    """The same after a reset."""
    max_torque_permille: int = 3000
    """6072h, 6073h, 60E0h and 60E1h after power-on [‰ of rated torque]."""
    rated_current: float = 5.0
    """6075h [A]; assumed, nothing else depends on it."""
    modes: frozenset[int] | None = None
    """Modes of operation that the drive has, by the numbers of 6060h; the profile's torque mode always, None: all."""
    without: frozenset[int] = frozenset()
    """Objects of CiA 402-2 that the drive does not show; it works with their power-on values."""
    mode_change_ns: int = 0
    """From the writing of 6060h until 6061h follows; until then the old mode goes on."""
    following_error_faults: bool = False
    """Whether a following error is a fault (8611h) and not only bit 13: the standard leaves it open."""
    sto_error: int = 0
    """Error code of the fault when safe torque off opens while torque is made; 0: no fault, voltage is disabled."""
    position: float = 0.0
    """Shaft angle at power-on [rad]."""
    velocity: float = 0.0
    """Shaft speed at power-on [rad/s]."""


def known_mechanics(axis: RigAxis) -> tuple[float, float, float]:
    """Inertia [kg·m²], viscous damping [N·m·s/rad] and rated torque [N·m] of the axis, or of the shipped bench."""
    bench = default_axis(axis.mechanism.workspace, bus=axis.bus, node=axis.node, profile=axis.profile)
    inertia = axis.inertia if axis.inertia is not None else bench.inertia
    damping = axis.viscous_damping if axis.viscous_damping is not None else bench.viscous_damping
    rated = axis.rated_torque if axis.rated_torque is not None else bench.rated_torque
    if inertia is None or damping is None or rated is None:
        raise ValueError("the shipped bench has unknown values")
    return inertia, damping, rated


def build_plant(profile: DriveProfile, axis: RigAxis, hand: Hand | None, settings: DriveSettings, t_ns: int) -> Body:
    """Motor, load and hand at the motor shaft, from `t_ns` on; rigid unless the rig asks for more."""
    inertia, damping, _ = known_mechanics(axis)
    shaft = Shaft(inertia, damping, axis.coulomb_friction, _lag(profile))
    held = grip(hand, axis.mechanism) if hand is not None else None
    position, velocity = settings.position, settings.velocity
    if axis.simulation.is_rigid:
        return Plant(shaft, held, position=position, velocity=velocity, t_ns=t_ns)
    from haptic_fieldbus.sim.mechanics.load import Load
    from haptic_fieldbus.sim.mechanics.loaded_plant import LoadedPlant

    mechanism = axis.mechanism
    lever = mechanism.sign * mechanism.ratio if isinstance(mechanism, RotaryMechanism) else None
    load = Load(shaft, axis.simulation, lever)
    return LoadedPlant(load, held, position=position, velocity=velocity, t_ns=t_ns)


def build_gains(profile: Cia402Profile, axis: RigAxis, tick: float) -> Gains:
    """Of the drive's own loops [s]."""
    inertia, damping, _ = known_mechanics(axis)
    return gains(inertia, damping, _lag(profile), tick)


def build_units(profile: Cia402Profile, axis: RigAxis, objects: Objects, dictionary: Dictionary) -> Units:
    """The factor group of this drive, and its own unit of velocity where the profile names one."""
    counts_per_radian = axis.encoder_counts_per_revolution / (2 * math.pi)
    unit = _velocity_unit(profile)
    own = velocity_step(unit, axis.encoder_counts_per_revolution) if unit != COUNTS_PER_SECOND else None
    return Units(counts_per_radian, objects.table, dictionary, own)


def _velocity_unit(profile: Cia402Profile) -> str:
    return profile.velocity.actual.unit if profile.velocity is not None else COUNTS_PER_SECOND


def object_defaults(profile: Cia402Profile, axis: RigAxis, settings: DriveSettings) -> Defaults:
    """Ramps that half of rated torque makes with the inertia alone, and the speed they reach in `_RAMP`."""
    inertia, _, rated = known_mechanics(axis)
    counts = axis.encoder_counts_per_revolution
    acceleration = 0.5 * rated / inertia * counts / (2 * math.pi)
    in_counts = 2 * math.pi / counts / velocity_step(_velocity_unit(profile), counts)
    return Defaults(
        max_torque_permille=settings.max_torque_permille,
        rated_current_ma=round(settings.rated_current * 1e3),
        counts_per_revolution=counts,
        velocity=_whole(_RAMP * acceleration * in_counts),
        acceleration=_whole(acceleration),
    )


def _whole(value: float) -> int:
    """In an UNSIGNED32 that can be doubled."""
    return max(1, min(0x7FFF_FFFF, round(value)))


def _lag(profile: DriveProfile) -> float:
    """Of the torque loop [s]."""
    return 1 / (2 * math.pi * profile.timing.torque_bandwidth)

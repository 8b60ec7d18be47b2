"""What a simulated drive is built from: profile and rig become plant, PDOs and options.

What a rig leaves open (inertia, damping, rated torque unknown) is taken from the shipped bench.
"""

import math
from dataclasses import dataclass

from haptic_fieldbus.drive.objects import ObjectEntry
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis, default_axis
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim.hand import Hand, grip
from haptic_fieldbus.sim.motion import Shaft
from haptic_fieldbus.sim.node import NodeOptions
from haptic_fieldbus.sim.pdo import INVALID, PdoDefaults
from haptic_fieldbus.sim.plant import Plant

_NO_RTR = 1 << 30
_PREDEFINED = 4
"""CiA 301, table 39: PDOs with an identifier of their own."""


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
    """Targets are limited to this [‰ of rated torque]."""
    position: float = 0.0
    """Shaft angle at power-on [rad]."""
    velocity: float = 0.0
    """Shaft speed at power-on [rad/s]."""


def known(axis: RigAxis) -> tuple[float, float, float]:
    """Inertia [kg·m²], viscous damping [N·m·s/rad] and rated torque [N·m] of the axis, or of the shipped bench."""
    bench = default_axis(axis.mechanism.workspace, bus=axis.bus, node=axis.node, profile=axis.profile)
    inertia = axis.inertia if axis.inertia is not None else bench.inertia
    damping = axis.viscous_damping if axis.viscous_damping is not None else bench.viscous_damping
    rated = axis.rated_torque if axis.rated_torque is not None else bench.rated_torque
    if inertia is None or damping is None or rated is None:
        raise ValueError("the shipped bench has unknown values")
    return inertia, damping, rated


def build_plant(profile: DriveProfile, axis: RigAxis, hand: Hand | None, settings: DriveSettings, t_ns: int) -> Plant:
    """Motor, load and hand at the motor shaft, from `t_ns` on."""
    inertia, damping, _ = known(axis)
    lag = 1 / (2 * math.pi * profile.timing.torque_bandwidth)
    return Plant(
        Shaft(inertia, damping, axis.coulomb_friction, lag),
        grip(hand, axis.mechanism) if hand is not None else None,
        position=settings.position,
        velocity=settings.velocity,
        t_ns=t_ns,
    )


def node_options(node: int, profile: DriveProfile, settings: DriveSettings) -> NodeOptions:
    """PDOs after power-on: the first of each direction valid, all with the predefined identifiers, event-driven."""
    signals = profile.offers()
    status, control = signals[Signal.STATUSWORD], signals[Signal.CONTROLWORD]
    inhibit = round(profile.pdo.inhibit_time_default * 1e4)
    return NodeOptions(
        rpdos=_defaults(
            profile.pdo.rpdos, 0x200 + node, profile.pdo.entries, 0, control, signals[Signal.TARGET_TORQUE]
        ),
        tpdos=_defaults(
            profile.pdo.tpdos, 0x180 + node, profile.pdo.entries, inhibit, status, signals[Signal.POSITION]
        ),
        consumer=profile.link_loss.heartbeat_consumer,
        acts_at_sync=profile.pdo.rpdo_acts == "next_sync",
        reset_ns=settings.reset_ns,
    )


def _defaults(
    count: int, first_id: int, max_entries: int, inhibit: int, word: ObjectEntry, value: ObjectEntry
) -> list[PdoDefaults]:
    """PDO 1 carries the word, PDO 2 word and value where it has room, the others nothing."""
    both = (word.mapping, value.mapping) if max_entries > 1 else ()
    mappings = {1: (word.mapping,), 2: both}
    return [
        PdoDefaults(
            number=number,
            cob_id=(0 if number == 1 else INVALID)
            | _NO_RTR
            | (first_id + 0x100 * (number - 1) if number <= _PREDEFINED else 0),
            mapping=mappings.get(number, ()),
            max_entries=max_entries,
            inhibit_time=inhibit,
        )
        for number in range(1, count + 1)
    ]

"""The place of a drive on a simulated bus."""

from dataclasses import dataclass

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.sim.faults import Fault
from haptic_fieldbus.sim.hand import Hand


@dataclass(frozen=True)
class DriveOnBus:
    """A drive to put on the bus under a node-ID; `position` [rad] and `velocity` [rad/s] are those of its shaft."""

    node: int
    profile: DriveProfile
    axis: RigAxis
    hand: Hand | None = None
    faults: tuple[Fault, ...] = ()
    position: float = 0.0
    velocity: float = 0.0
    booted: bool = True
    """True: the bench was switched on before the program came.

    False: it is switched on now, and the boot-up message follows.
    """
    led: bool = False
    """True: a hand moves the handle while the drive is off."""

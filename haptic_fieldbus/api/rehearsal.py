"""A rehearsal of the first day with a drive: its bench is simulated inside this program, in real time."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from haptic_fieldbus.api import Trial
from haptic_fieldbus.defaults import DEFAULT_HAND, DEFAULT_PROTOCOL
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.host_request import rig_of


@contextmanager
def rehearsal(task: Task, trial: Trial) -> Iterator[Rig]:
    """Simulate the bench of a task for a `with` block; yield its rig, which a run treats as that of a real bench.

    A hand moves each handle while its drive is off, unless the trial names the hand none. No file is written: `source`
    of the rig is empty. Raises DocumentError, UsageError for a drive on another bus than CAN, or
    PlanError for what cannot be rendered.
    """
    selection = load(replace(task, rig=None, bus=None))
    hand = hand_named(trial.hand or selection.scene.hand or DEFAULT_HAND)
    slots = []
    for name, axis in selection.rig.axis.items():
        profile = load_profile(axis.profile, task.profiles)
        if profile.drive.protocol != DEFAULT_PROTOCOL:
            raise UsageError(
                f"{axis.profile} uses {profile.drive.protocol}; rehearse supports CANopen only; use --drive maxon_epos4"
            )
        # Each hand waits for the force, and is where the scene holds its axis.
        holding = hand.after(trial.fade_in) if hand is not None and selection.scene.holds(name) else None
        # The power of a real drive has to be cut by somebody: that is not taken for granted here.
        slots.append(DriveOnBus(axis.node, profile, replace(axis, emergency_stop=None), holding, led=hand is not None))
    check_stable(selection.plan)
    # Imported here, because a trial that is refused needs no bus.
    from haptic_fieldbus.sim.canopen.bus import embedded_bus

    with embedded_bus(slots, trial.seed) as section:
        yield rig_of(BusName(section.channel, section), slots, tuple(selection.rig.axis))

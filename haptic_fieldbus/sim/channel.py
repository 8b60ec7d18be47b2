"""The text form of the drives on a simulated bus: `maxon_epos4@5,generic_cia402@6`, profile @ node-ID."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.faults import Fault
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.slot import Slot

_NODES = range(1, 128)
"""Node-IDs of CANopen."""


@dataclass(frozen=True)
class NamedDrive:
    """The name or file of a profile, and a node-ID."""

    profile: str
    node: int


def drives_of(channel: str) -> list[NamedDrive]:
    """Parse the drives of a channel; raises UsageError when one is not written as `profile@node-ID`."""
    return [drive_of(item) for item in channel.split(",")]


def drive_of(text: str, nodes: range = _NODES) -> NamedDrive:
    """Parse one drive, `profile@node-ID`; raises UsageError when it is written otherwise."""
    name, _, number = text.strip().rpartition("@")
    if not name or not number.isdecimal() or int(number) not in nodes:
        raise UsageError(f'"{text}": expected profile@node-ID, such as generic_cia402@5')
    return NamedDrive(name, int(number))


def slot_of(
    drive: NamedDrive,
    bus: str,
    workspace: Workspace,
    hand: Hand | None = None,
    faults: Iterable[Fault] = (),
    *,
    booted: bool = True,
    profiles: str | Path | None = None,
) -> Slot:
    """Return the slot of a drive on the shipped bench; `profiles` is a folder of own profiles (see `load_profile`).

    Raises ProfileError or EdsError for a bad profile file, UsageError for an unknown profile.
    """
    axis = default_axis(workspace, bus=bus, node=drive.node, profile=drive.profile)
    return Slot(drive.node, load_profile(drive.profile, profiles), axis, hand, tuple(faults), booted=booted)

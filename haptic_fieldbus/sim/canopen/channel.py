"""Which drives are on a simulated bus, as a channel says it: `maxon_epos4@5,generic_cia402@6`, profile @ node-ID."""

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


@dataclass(frozen=True)
class NamedDrive:
    """A profile's name or file, and the node-ID."""

    profile: str
    node: int


def drives_of(channel: str) -> list[NamedDrive]:
    """The drives of a channel; UsageError where one is not written as it should be."""
    return [drive_of(item) for item in channel.split(",")]


def drive_of(text: str) -> NamedDrive:
    """One drive, `profile@node-ID`; UsageError when it is not written so."""
    name, _, number = text.strip().rpartition("@")
    if not name or not number.isdecimal() or int(number) not in _NODES:
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
    """The drive on the shipped bench, its profile also by name from the folder `profiles` (see `load_profile`).

    Raises ProfileError or UsageError when it cannot be made.
    """
    axis = default_axis(workspace, bus=bus, node=drive.node, profile=drive.profile)
    return Slot(drive.node, load_profile(drive.profile, profiles), axis, hand, tuple(faults), booted=booted)

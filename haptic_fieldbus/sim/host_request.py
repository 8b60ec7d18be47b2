"""Request of `simulate`: drives with their node-IDs, hosted on a bus that other programs can join."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Protocol

from haptic_fieldbus.defaults import (
    DEFAULT_FADE_IN,
    DEFAULT_HOSTED_HAND,
    DEFAULT_NODE,
    DEFAULT_PROTOCOL,
    HIGHEST_NUMBER,
)
from haptic_fieldbus.documents import is_path
from haptic_fieldbus.drive.rig import Rig, RigAxis, Seen, default_axis
from haptic_fieldbus.errors import DocumentError, UsageError
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.protocols.registry import parse_bus, protocol_named
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import Fault, HostFault, LineFault, of_no_drive
from haptic_fieldbus.sim.hand import Hand, hand_named

# The text form of the drives on a simulated bus: `maxon_epos4@5,generic_cia402@6`, profile @ node-ID.

_NODES = range(1, 128)
"""Node-IDs of CANopen."""


@dataclass(frozen=True)
class NamedDrive:
    """The name or file of a profile, and a node-ID."""

    profile: str
    node: int


def drive_of(text: str, nodes: Sequence[int] = _NODES) -> NamedDrive:
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
    axis: RigAxis | None = None,
) -> DriveOnBus:
    """Return the slot of a drive; `axis` is that of a rig, None: that of the shipped bench.

    `profiles` is a folder of own profiles (see `load_profile`).

    Raises ProfileError or EdsError for a bad profile file, UsageError for an unknown profile.
    """
    axis = axis or default_axis(workspace, bus=bus, node=drive.node, profile=drive.profile)
    return DriveOnBus(drive.node, load_profile(drive.profile, profiles), axis, hand, tuple(faults), booted=booted)


_BUS = "simulated"
"""Name of the bus in a rig that is written."""
# Modules as texts, so that only the protocol of the bus is imported. Each has `host` and `KINDS`.
_HOSTS = {"canopen": "haptic_fieldbus.sim.canopen.hosting", "modbus": "haptic_fieldbus.sim.modbus.hosting"}


_TELL_EXCHANGE = ("canopen",)
"""Protocols on which a drive knows the start of an exchange, so that the hand that moves its handle can rest."""


@dataclass(frozen=True)
class HostRequest:
    """Drives to host and the bus to host them on.

    `drives` are written `PROFILE` or `PROFILE@NODE`; the first without a node-ID gets `node`, the others the next free
    ones. No drives: the default drive of such a bus.
    """

    drives: Sequence[str]
    bus: str | None
    node: int = DEFAULT_NODE
    hand: str = DEFAULT_HOSTED_HAND
    faults: tuple[Fault, ...] = ()
    profiles: str | Path | None = None
    """Folder of one's own profiles (see `load_profile`)."""
    axes: tuple[RigAxis, ...] = ()
    """Axes of a rig, whose drives and simulated benches are hosted in the place of `drives`."""


def resolve(request: HostRequest) -> tuple[BusName, list[DriveOnBus]]:
    """Return the bus of a request and the slots to put on it.

    Raises one UsageError with all errors of the request, or ProfileError or EdsError for a bad profile file.
    """
    faults = [
        f'fault "{fault.kind}" is a fault of the bus or of the host, which `simulate` does not simulate'
        for fault in request.faults
        if isinstance(fault, LineFault | HostFault)
    ] + [
        f'fault "{fault.kind}" names the bus "{fault.bus}"; `simulate` has one bus, remove the key'
        for fault in request.faults
        if fault.bus is not None
    ]
    slots: list[DriveOnBus] = []
    bus, drives, hand = None, [], None
    with collecting(faults):
        hand = hand_named(request.hand)
        # As in a run on a simulated bus: the hand waits until force has faded in.
        hand = hand.after(DEFAULT_FADE_IN) if hand is not None else None
    with collecting(faults):
        bus = joined_bus(request.bus)
        faults += _strange(bus, request.faults)
    with collecting(faults):
        protocol = protocol_named(bus.section.protocol if bus is not None else DEFAULT_PROTOCOL)
        texts = [f"{axis.profile}@{axis.node}" for axis in request.axes]
        nodes: Sequence[int] = protocol.nodes
        if bus is not None:
            interface = bus.section.interface
            nodes = [each for each in range(HIGHEST_NUMBER + 1) if not protocol.wanted_node(each, interface)]
        first = request.node
        if first not in nodes:
            faults.append(f"node {first}: a node-ID is a whole number from {nodes[0]} to {nodes[-1]}")
            first = nodes[0]
        drives = numbered(texts or request.drives or [protocol.default_drive], first, nodes)
    for drive, axis in zip(drives, request.axes or [None] * len(drives), strict=False):
        with collecting(faults):
            bench = (drive, request.bus or "", Workspace.LINEAR, hand, request.faults)
            slot = slot_of(*bench, booted=False, profiles=request.profiles, axis=axis)
            spoken = slot.profile.drive.protocol
            if bus is not None and spoken != bus.section.protocol:
                wrong = f"{slot.axis.profile} uses {spoken}, but {bus.text} is a {bus.section.protocol} bus"
                raise UsageError(wrong)
            slots.append(replace(slot, led=hand is not None and spoken in _TELL_EXCHANGE))
    if drives:
        faults += of_no_drive(request.faults, {drive.node for drive in drives})
    if bus is None or faults:
        raise UsageError("\n".join(faults))
    return bus, slots


class HostFunction(Protocol):
    """A function that hosts drives on a bus until `stopped()` is True, and returns the number of unsent frames.

    `opened` is called with the bus once it is open, `ready` for each drive, and `tell` with sentences for people.
    """

    def __call__(
        self,
        bus: BusName,
        slots: Sequence[DriveOnBus],
        seed: int,
        ready: Callable[[DriveOnBus], None],
        stopped: Callable[[], bool],
        tell: Callable[[str], None] = ...,
        opened: Callable[[BusName], None] = ...,
    ) -> int: ...


def host_on(bus: BusName) -> HostFunction:
    """Return the function that hosts drives on a bus; raises UsageError when there is none for its protocol."""
    host: HostFunction = _hosting(bus).host
    return host


def _hosting(bus: BusName) -> ModuleType:
    if bus.section.protocol not in _HOSTS:
        raise UsageError(f"{bus.text}: drives on {bus.section.protocol} cannot be hosted")
    return import_module(_HOSTS[bus.section.protocol])


def _strange(bus: BusName, faults: Iterable[Fault]) -> list[str]:
    """Return a sentence for each fault that is impossible for drives on this bus."""
    kinds: frozenset[str] = _hosting(bus).KINDS
    return [
        f'drives on {bus.section.protocol} do not support the fault "{fault.kind}"; remove it'
        for fault in faults
        if fault.kind not in kinds and not isinstance(fault, LineFault | HostFault)
    ]


@contextmanager
def collecting(faults: list[str]) -> Iterator[None]:
    """Append the fault that a `with` block raises, so that all faults are told at once."""
    try:
        yield
    except (UsageError, DocumentError) as error:
        faults.append(str(error))


def rig_of(bus: BusName, slots: Sequence[DriveOnBus], names: Sequence[str] = ()) -> Rig:
    """Return the rig with which another program renders a scene on these drives.

    The axes are called by `names`; without any they are called handle, handle2 and so on. A profile that is not shipped
    is named by its file.
    """
    axes = {}
    for number, slot in enumerate(slots, start=1):
        name = names[number - 1] if names else "handle" if number == 1 else f"handle{number}"
        shipped = slot.profile.name in profile_names() and not is_path(slot.axis.profile)
        profile = slot.profile.name if shipped else str(Path(slot.profile.source).absolute())
        # A handle that no hand moves cannot show its direction, and need not: how it is built is known. The file may
        # become that of a real bench, so nobody has said in it that a drive's own limit may be raised.
        seen = Seen() if slot.led else Seen(direction="confirmed")
        axes[name] = replace(slot.axis, bus=_BUS, profile=profile, seen=seen, raise_max_torque=False)
    return Rig({_BUS: bus.section}, axes)


def joined_bus(text: str | None) -> BusName:
    """Parse the name of a bus that other programs can join.

    Raises UsageError for no bus, an unknown one, or the simulated one, which exists inside a single program.
    """
    example = "socketcan:can0, udp_multicast:239.74.163.2, modbus-tcp:127.0.0.1:0"
    if text is None:
        raise UsageError(f"--bus is required: the bus on which the drives are hosted, for example {example}")
    name = parse_bus(text)
    if name.simulated:
        raise UsageError(f'bus "{text}": other programs cannot join it; host on {example} or virtual:CHANNEL')
    return name


def numbered(texts: Sequence[str], first: int, nodes: Sequence[int]) -> list[NamedDrive]:
    """Return every drive with its number: the stated number, otherwise the next free one from `first` on.

    `nodes` are the valid numbers of the protocol, `first` among them. Raises UsageError for a number that is used twice
    or out of range, and when none is left.
    """
    asking = [text.rpartition("@")[2].isdecimal() and "@" in text for text in texts]
    taken = [drive_of(text, nodes).node for text, asks in zip(texts, asking, strict=True) if asks]
    if twice := sorted({node for node in taken if taken.count(node) > 1}):
        raise UsageError(f"node-ID {', '.join(map(str, twice))} is used twice")
    free = (node for node in nodes if node >= first and node not in taken)
    drives = []
    for text, asks in zip(texts, asking, strict=True):
        node = drive_of(text, nodes).node if asks else next(free, None)
        if node is None:
            raise UsageError(f"no free node-ID for {text}")
        drives.append(drive_of(text, nodes) if asks else NamedDrive(text, node))
    return drives

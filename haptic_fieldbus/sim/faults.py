"""Faults of a simulated drive or bus, as data: the kinds of `[[fault]]` in a TOML file.

`at` [s] counts from the drive's first *operation enabled*; faults without it exist from power-on. `node` is the node-ID
of the drive, None every drive of the bus; `bus` is a bus of the rig, None every bus. `duration` [s] None is for ever.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le

from haptic_fieldbus.documents import read_document
from haptic_fieldbus.drive.fields import STRICT, Counts, NonNegativeTime, Time, UInt32
from haptic_fieldbus.drive.rig import ByKind
from haptic_fieldbus.errors import FaultFileError

Node = Annotated[int, Ge(1), Le(127)]
ErrorCode = Annotated[int, Ge(0x0001), Le(0xFFFF)]


@dataclass(frozen=True, kw_only=True)
class Concern:
    """The drives and buses that a fault concerns."""

    node: Node | None = None
    bus: str | None = None
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Emergency(Concern):
    """An emergency message, without any effect on the drive."""

    kind: Literal["emergency"]
    at: NonNegativeTime
    code: ErrorCode


@dataclass(frozen=True)
class DriveFault(Concern):
    """A fault that the drive detects: emergency message, fault reaction, *fault*."""

    kind: Literal["drive_fault"]
    at: NonNegativeTime
    # 2310h: continuous over current.
    code: ErrorCode = 0x2310


@dataclass(frozen=True)
class NodeReset(Concern):
    """A restart of the node by its watchdog; the boot-up message comes `duration` [s] later."""

    kind: Literal["node_reset"]
    at: NonNegativeTime
    duration: Time = 0.001


@dataclass(frozen=True)
class Silence(Concern):
    """A disconnected cable of the node: it neither sends nor receives."""

    kind: Literal["silence"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class MissingTpdos(Concern):
    """The loss of the next `count` TPDOs inside the node."""

    kind: Literal["missing_tpdos"]
    at: NonNegativeTime
    count: Annotated[int, Ge(1), Le(1_000_000_000)] = 1


@dataclass(frozen=True)
class MissingRpdos(Concern):
    """The loss of the next `count` RPDOs inside the node, None all of them; the drive keeps its last set-point."""

    kind: Literal["missing_rpdos"]
    at: NonNegativeTime
    count: Annotated[int, Ge(1), Le(1_000_000_000)] | None = None


@dataclass(frozen=True)
class HeartbeatLost(Concern):
    """The end of the node's own heartbeat; everything else continues."""

    kind: Literal["heartbeat_lost"]
    at: NonNegativeTime


@dataclass(frozen=True)
class EncoderJump(Concern):
    """A loss or gain of encoder counts."""

    kind: Literal["encoder_jump"]
    at: NonNegativeTime
    counts: Counts


@dataclass(frozen=True)
class PositionStuck(Concern):
    """An encoder that keeps its last counts while the shaft moves."""

    kind: Literal["position_stuck"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class BusOff(Concern):
    """Bus-off of the master's controller: an error frame, then it neither sends nor receives."""

    kind: Literal["bus_off"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class ErrorFrame(Concern):
    """A disturbed frame that the master's controller reports; no frame is lost."""

    kind: Literal["error_frame"]
    at: NonNegativeTime


@dataclass(frozen=True)
class MissingNode(Concern):
    """A node that is absent from the bus."""

    kind: Literal["missing_node"]


@dataclass(frozen=True)
class WrongIdentity(Concern):
    """Another vendor-ID or product code in 1018h; None leaves the right one."""

    kind: Literal["wrong_identity"]
    vendor_id: UInt32 | None = None
    product_code: UInt32 | None = None


@dataclass(frozen=True)
class SdoRefusal(Concern):
    """An abort of every SDO access to one entry, with this code."""

    kind: Literal["sdo_abort"]
    object: Annotated[int, Ge(0), Le(0xFFFF)]
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    code: UInt32 = 0x0601_0002


@dataclass(frozen=True)
class DeadGuard(Concern):
    """A watch on the master that acts `factor` times as late as it was set, None: never."""

    kind: Literal["dead_guard"]
    factor: Annotated[float, Ge(1), Le(1000)] | None = None


TimedFault = (
    Emergency
    | DriveFault
    | NodeReset
    | Silence
    | MissingTpdos
    | MissingRpdos
    | HeartbeatLost
    | EncoderJump
    | PositionStuck
    | BusOff
    | ErrorFrame
)
LastingFault = MissingNode | WrongIdentity | SdoRefusal | DeadGuard
Fault = TimedFault | LastingFault


@dataclass(frozen=True)
class FaultFile:
    """A file of faults: `[[fault]] kind = "silence", at = 1.0`."""

    fault: tuple[Annotated[Fault, ByKind()], ...] = ()
    __pydantic_config__: ClassVar = STRICT


def load_faults(path: str | Path) -> tuple[Fault, ...]:
    """Return the faults of a file; raises FaultFileError that lists everything wrong in it."""
    document = read_document(Path(path), FaultFileError)
    return document.checked(document.validate(FaultFile)).fault


def faults_of(faults: Iterable[Fault], node: int) -> tuple[Fault, ...]:
    """Return the faults that concern one drive of a bus."""
    return tuple(fault for fault in faults if fault.node in (None, node))


def faults_on(faults: Iterable[Fault], bus: str) -> tuple[Fault, ...]:
    """Return the faults that concern one bus of a rig."""
    return tuple(fault for fault in faults if fault.bus in (None, bus))

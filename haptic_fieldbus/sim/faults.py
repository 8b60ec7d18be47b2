"""Faults of a simulated drive or bus, as data: what a `[[fault]]` of a TOML file may say.

`at` [s] counts from the drive's first *operation enabled*; faults without it are there from power-on. `node` names the
drive, None every drive of the bus; `bus` is its bus in the rig, None every bus. `duration` [s], None: for good.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le

from haptic_fieldbus.documents import read_document
from haptic_fieldbus.drive.fields import STRICT, NonNegativeFloat, PositiveFloat, UInt32
from haptic_fieldbus.drive.rig import ByKind
from haptic_fieldbus.errors import FaultFileError

Node = Annotated[int, Ge(1), Le(127)]
ErrorCode = Annotated[int, Ge(0x0001), Le(0xFFFF)]


@dataclass(frozen=True, kw_only=True)
class Concern:
    """Whom a fault befalls."""

    node: Node | None = None
    bus: str | None = None
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Emergency(Concern):
    """An emergency message, the drive goes on."""

    kind: Literal["emergency"]
    at: NonNegativeFloat
    code: ErrorCode


@dataclass(frozen=True)
class DriveFault(Concern):
    """The drive detects a fault: emergency, fault reaction, fault."""

    kind: Literal["drive_fault"]
    at: NonNegativeFloat
    code: ErrorCode = 0x2310


@dataclass(frozen=True)
class NodeReset(Concern):
    """The node's watchdog restarts it; the boot-up message comes `duration` [s] later."""

    kind: Literal["node_reset"]
    at: NonNegativeFloat
    duration: PositiveFloat = 0.001


@dataclass(frozen=True)
class Silence(Concern):
    """The node's cable is off: nothing is sent, nothing is received."""

    kind: Literal["silence"]
    at: NonNegativeFloat
    duration: PositiveFloat | None = None


@dataclass(frozen=True)
class MissingTpdos(Concern):
    """The next `count` TPDOs are not sent."""

    kind: Literal["missing_tpdos"]
    at: NonNegativeFloat
    count: Annotated[int, Ge(1)] = 1


@dataclass(frozen=True)
class HeartbeatLost(Concern):
    """The node's own heartbeat stops, all else goes on."""

    kind: Literal["heartbeat_lost"]
    at: NonNegativeFloat


@dataclass(frozen=True)
class EncoderJump(Concern):
    """The encoder loses or gains counts."""

    kind: Literal["encoder_jump"]
    at: NonNegativeFloat
    counts: int


@dataclass(frozen=True)
class PositionStuck(Concern):
    """The encoder shows what it showed, whatever the shaft does."""

    kind: Literal["position_stuck"]
    at: NonNegativeFloat
    duration: PositiveFloat | None = None


@dataclass(frozen=True)
class BusOff(Concern):
    """The master's controller goes bus-off: an error frame, then nothing is sent or received by it."""

    kind: Literal["bus_off"]
    at: NonNegativeFloat
    duration: PositiveFloat | None = None


@dataclass(frozen=True)
class ErrorFrame(Concern):
    """The master's controller reports a disturbed frame; nothing is lost."""

    kind: Literal["error_frame"]
    at: NonNegativeFloat


@dataclass(frozen=True)
class MissingNode(Concern):
    """The node is not there."""

    kind: Literal["missing_node"]


@dataclass(frozen=True)
class WrongIdentity(Concern):
    """1018h says another vendor or product; None: as it is."""

    kind: Literal["wrong_identity"]
    vendor_id: UInt32 | None = None
    product_code: UInt32 | None = None


@dataclass(frozen=True)
class SdoRefusal(Concern):
    """Every SDO access to one entry is aborted with this code."""

    kind: Literal["sdo_abort"]
    object: Annotated[int, Ge(0), Le(0xFFFF)]
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    code: UInt32 = 0x0601_0002


TimedFault = (
    Emergency
    | DriveFault
    | NodeReset
    | Silence
    | MissingTpdos
    | HeartbeatLost
    | EncoderJump
    | PositionStuck
    | BusOff
    | ErrorFrame
)
LastingFault = MissingNode | WrongIdentity | SdoRefusal
Fault = TimedFault | LastingFault


@dataclass(frozen=True)
class FaultFile:
    """A file of faults: `[[fault]] kind = "silence", at = 1.0`."""

    fault: tuple[Annotated[Fault, ByKind()], ...] = ()
    __pydantic_config__: ClassVar = STRICT


def load_faults(path: str | Path) -> tuple[Fault, ...]:
    """The faults of a file; raises FaultFileError with all that is wrong in it."""
    document = read_document(Path(path), FaultFileError)
    return document.checked(document.validate(FaultFile)).fault


def faults_of(faults: Iterable[Fault], node: int) -> tuple[Fault, ...]:
    """Those that concern one drive of a bus."""
    return tuple(fault for fault in faults if fault.node in (None, node))


def faults_on(faults: Iterable[Fault], bus: str) -> tuple[Fault, ...]:
    """Those that concern one bus of a rig."""
    return tuple(fault for fault in faults if fault.bus in (None, bus))

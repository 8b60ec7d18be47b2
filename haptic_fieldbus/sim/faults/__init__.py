"""Faults of a simulated bench, as data: the kinds of `[[fault]]` in a TOML file.

`at` [s] counts from *operation enabled*, and counts anew if a drive is enabled again before any fault has happened;
faults without `at` exist from power-on. `node` is the node-ID of the drive, None every drive of the bus; `bus` is a bus
of the rig, None every bus. `duration` [s] None is for ever.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, ClassVar, get_args

from haptic_fieldbus.documents import read_document
from haptic_fieldbus.drive.fields import STRICT
from haptic_fieldbus.drive.rig import ByKind
from haptic_fieldbus.errors import FaultFileError
from haptic_fieldbus.sim.faults.kinds import AnswerCorrupted as AnswerCorrupted
from haptic_fieldbus.sim.faults.kinds import AnswerDelayed as AnswerDelayed
from haptic_fieldbus.sim.faults.kinds import AnswerDisturbance as AnswerDisturbance
from haptic_fieldbus.sim.faults.kinds import AnswerException as AnswerException
from haptic_fieldbus.sim.faults.kinds import AnswerFault as AnswerFault
from haptic_fieldbus.sim.faults.kinds import AnswerGarbage as AnswerGarbage
from haptic_fieldbus.sim.faults.kinds import AnswerLost as AnswerLost
from haptic_fieldbus.sim.faults.kinds import AnswerSwapped as AnswerSwapped
from haptic_fieldbus.sim.faults.kinds import AnswerTruncated as AnswerTruncated
from haptic_fieldbus.sim.faults.kinds import AnswerWrongUnit as AnswerWrongUnit
from haptic_fieldbus.sim.faults.kinds import BusOff as BusOff
from haptic_fieldbus.sim.faults.kinds import ClockStep as ClockStep
from haptic_fieldbus.sim.faults.kinds import ConnectionReset as ConnectionReset
from haptic_fieldbus.sim.faults.kinds import DeadGuard as DeadGuard
from haptic_fieldbus.sim.faults.kinds import Disturbance as Disturbance
from haptic_fieldbus.sim.faults.kinds import DriveFault as DriveFault
from haptic_fieldbus.sim.faults.kinds import DriveFaultKind as DriveFaultKind
from haptic_fieldbus.sim.faults.kinds import DuplicateNode as DuplicateNode
from haptic_fieldbus.sim.faults.kinds import Emergency as Emergency
from haptic_fieldbus.sim.faults.kinds import EncoderJump as EncoderJump
from haptic_fieldbus.sim.faults.kinds import EncoderReversed as EncoderReversed
from haptic_fieldbus.sim.faults.kinds import EncoderScaling as EncoderScaling
from haptic_fieldbus.sim.faults.kinds import ErrorFrame as ErrorFrame
from haptic_fieldbus.sim.faults.kinds import FaultTargets as FaultTargets
from haptic_fieldbus.sim.faults.kinds import ForeignFrame as ForeignFrame
from haptic_fieldbus.sim.faults.kinds import ForeignSetPoints as ForeignSetPoints
from haptic_fieldbus.sim.faults.kinds import FrameDelayed as FrameDelayed
from haptic_fieldbus.sim.faults.kinds import FrameDropped as FrameDropped
from haptic_fieldbus.sim.faults.kinds import FrameDuplicated as FrameDuplicated
from haptic_fieldbus.sim.faults.kinds import FrameGroup as FrameGroup
from haptic_fieldbus.sim.faults.kinds import FrameWrongLength as FrameWrongLength
from haptic_fieldbus.sim.faults.kinds import FrameWrongNode as FrameWrongNode
from haptic_fieldbus.sim.faults.kinds import HandFault as HandFault
from haptic_fieldbus.sim.faults.kinds import HandHit as HandHit
from haptic_fieldbus.sim.faults.kinds import HandRelease as HandRelease
from haptic_fieldbus.sim.faults.kinds import HeartbeatLost as HeartbeatLost
from haptic_fieldbus.sim.faults.kinds import HostFault as HostFault
from haptic_fieldbus.sim.faults.kinds import HostLate as HostLate
from haptic_fieldbus.sim.faults.kinds import HostPaused as HostPaused
from haptic_fieldbus.sim.faults.kinds import InterfaceDown as InterfaceDown
from haptic_fieldbus.sim.faults.kinds import LastingFault as LastingFault
from haptic_fieldbus.sim.faults.kinds import LineDisturbance as LineDisturbance
from haptic_fieldbus.sim.faults.kinds import LineFault as LineFault
from haptic_fieldbus.sim.faults.kinds import MissingNode as MissingNode
from haptic_fieldbus.sim.faults.kinds import MissingRpdos as MissingRpdos
from haptic_fieldbus.sim.faults.kinds import MissingTpdos as MissingTpdos
from haptic_fieldbus.sim.faults.kinds import NodeReset as NodeReset
from haptic_fieldbus.sim.faults.kinds import PositionStuck as PositionStuck
from haptic_fieldbus.sim.faults.kinds import SafeTorqueOff as SafeTorqueOff
from haptic_fieldbus.sim.faults.kinds import SdoRefusal as SdoRefusal
from haptic_fieldbus.sim.faults.kinds import Silence as Silence
from haptic_fieldbus.sim.faults.kinds import SlowCompute as SlowCompute
from haptic_fieldbus.sim.faults.kinds import SyncIgnored as SyncIgnored
from haptic_fieldbus.sim.faults.kinds import TorqueDead as TorqueDead
from haptic_fieldbus.sim.faults.kinds import TorqueReversed as TorqueReversed
from haptic_fieldbus.sim.faults.kinds import TorqueSaturated as TorqueSaturated
from haptic_fieldbus.sim.faults.kinds import WrongIdentity as WrongIdentity

# Files of faults: read, checked, and written.

TimedFault = DriveFaultKind | LineFault | AnswerFault | HostFault | HandFault
"""Kinds that happen at an instant."""
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


def toml_of(faults: Iterable[Fault]) -> str:
    """Return the text of a file of these faults; a value that is the default of its key is left out."""
    return "\n".join("[[fault]]\n" + "".join(_lines(fault)) for fault in faults)


def kinds_of(union: object) -> frozenset[str]:
    """Return the names of the kinds in a union of them."""
    return frozenset(kind.__annotations__["kind"].__args__[0] for kind in get_args(union))


def faults_of(faults: Iterable[Fault], node: int) -> tuple[Fault, ...]:
    """Return the faults that concern one drive of a bus."""
    return tuple(fault for fault in faults if fault.node in (None, node))


def faults_on(faults: Iterable[Fault], bus: str) -> tuple[Fault, ...]:
    """Return the faults that concern one bus of a rig."""
    return tuple(fault for fault in faults if fault.bus in (None, bus))


def _lines(fault: Fault) -> Iterable[str]:
    # `node` and `bus` are declared first, because they are inherited; `kind` stands first for the reader.
    names = sorted((field.name for field in fields(fault)), key=lambda name: name != "kind")
    defaults = {field.name: field.default for field in fields(fault)}
    for name in names:
        value = getattr(fault, name)
        if value != defaults[name] and value is not None:
            yield f"{name} = {_text(value)}\n"


def _text(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return str(list(value)) if isinstance(value, tuple) else repr(value)

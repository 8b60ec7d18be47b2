"""Faults of a simulated bench, as data: the kinds of `[[fault]]` in a TOML file.

`at` [s] counts from *operation enabled*, and counts anew if a drive is enabled again before any fault has happened;
faults without `at` exist from power-on. `node` is the node-ID of the drive, None every drive of the bus; `bus` is a bus
of the rig, None every bus. `duration` [s] None is for ever.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeVar, dataclass_transform, get_args

from annotated_types import Ge, Le, Len

from haptic_fieldbus.documents import read_document
from haptic_fieldbus.drive.fields import STRICT, Counts, NonNegativeTime, Time, UInt32
from haptic_fieldbus.drive.rig import ByKind
from haptic_fieldbus.errors import Fault as FileFault
from haptic_fieldbus.errors import FaultFileError

# The fields that all kinds of faults share, and the types of fields that several have.

Kind = TypeVar("Kind")
Node = Annotated[int, Ge(1), Le(127)]
ErrorCode = Annotated[int, Ge(0x0001), Le(0xFFFF)]
Count = Annotated[int, Ge(1), Le(1_000_000_000)]
Octet = Annotated[int, Ge(0), Le(0xFF)]
CanId = Annotated[int, Ge(0), Le(0x7FF)]
Share = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True, kw_only=True)
class FaultTargets:
    """The drives and buses that a fault concerns."""

    node: Node | None = None
    bus: str | None = None
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class NamedFault(FaultTargets):
    """A fault of a kind; each kind adds its own keys."""

    kind: str


@dataclass(frozen=True)
class AtInstant(NamedFault):
    """A fault that happens once, `at` seconds after *operation enabled*."""

    at: NonNegativeTime


@dataclass(frozen=True)
class CountAtInstant(AtInstant):
    """A fault of the next `count` frames, answers or messages."""

    count: Count = 1


@dataclass(frozen=True)
class OpenCountAtInstant(AtInstant):
    """A fault of the next `count` messages; None: of all."""

    count: Count | None = None


@dataclass(frozen=True)
class OpenEndAtInstant(AtInstant):
    """A fault that lasts for `duration` [s]; None: for ever."""

    duration: Time | None = None


@dataclass(frozen=True)
class DelayAtInstant(AtInstant):
    """A delay [s], `count` times."""

    delay: Time
    count: Count = 1


@dataclass_transform(frozen_default=True)
def kind(name: str) -> Callable[[type[Kind]], type[Kind]]:
    """Return the decorator of one kind of faults: a frozen dataclass with this name as the only value of `kind`."""

    def named(kind: type[Kind]) -> type[Kind]:
        kind.__annotations__ = {"kind": Literal.__getitem__(name), **kind.__annotations__}
        return dataclass(frozen=True)(kind)

    return named


# Faults of the bus: frames that do not arrive as they were sent, other frames, and the controller of the master.
#
# A disturbed frame is on the wire as its sender sent it; what its receivers get is something else, or nothing.

FrameGroup = Literal["tpdo", "rpdo", "sync", "heartbeat", "emergency", "sdo", "nmt"]
"""Frames by their service; SYNC and NMT commands belong to every node, a heartbeat to the one that sends it."""


@dataclass(frozen=True)
class FramesAtInstant(AtInstant):
    """A fault of the next `count` frames of a service."""

    frames: FrameGroup = "tpdo"
    count: Count = 1


@kind("frame_dropped")
class FrameDropped(FramesAtInstant):
    """The loss of the next `count` frames of a service between sender and receivers."""


@kind("frame_delayed")
class FrameDelayed(AtInstant):
    """The late arrival of the next `count` frames of a service, by `delay` [s]."""

    delay: Time
    frames: FrameGroup = "tpdo"
    count: Count = 1


@kind("frame_duplicated")
class FrameDuplicated(FramesAtInstant):
    """The next `count` frames of a service arrive twice."""


@kind("frame_wrong_length")
class FrameWrongLength(AtInstant):
    """The next `count` frames of a service arrive with another length: cut off, or filled up with zeros."""

    length: Annotated[int, Ge(0), Le(8)]
    frames: FrameGroup = "tpdo"
    count: Count = 1


@kind("frame_wrong_node")
class FrameWrongNode(AtInstant):
    """The next `count` frames of a service arrive under the identifier of the node `to`."""

    to: Node
    frames: FrameGroup = "tpdo"
    count: Count = 1


@kind("foreign_frame")
class ForeignFrame(AtInstant):
    """A frame of another program, `count` times, one every `interval` [s]."""

    can_id: CanId
    data: Annotated[tuple[Octet, ...], Len(0, 8)] = ()
    count: Count = 1
    interval: Time = 0.001


@kind("bus_off")
class BusOff(OpenEndAtInstant):
    """Bus-off of the master's controller: an error frame, then it neither sends nor receives."""


@kind("interface_down")
class InterfaceDown(OpenEndAtInstant):
    """The interface of the master is down: sending and receiving fail with "Network is down"."""


@kind("error_frame")
class ErrorFrame(AtInstant):
    """A disturbed frame that the master's controller reports; no frame is lost."""


Disturbance = FrameDropped | FrameDelayed | FrameDuplicated | FrameWrongLength | FrameWrongNode
"""Kinds that act on the way from a sender to its receivers."""
LineFault = Disturbance | ForeignFrame | BusOff | InterfaceDown | ErrorFrame
"""Kinds of the bus, which concern all of its drives at once."""


# Faults of requests and answers on Modbus: an answer that does not come as it was sent, or another master.
#
# Those of answers concern the next `count` answers of a drive on a line; the drive has carried out the requests.


@kind("answer_lost")
class AnswerLost(CountAtInstant):
    """No answer comes."""


@kind("answer_delayed")
class AnswerDelayed(DelayAtInstant):
    """Answers come later by `delay` [s]."""


@kind("answer_swapped")
class AnswerSwapped(CountAtInstant):
    """Each answer arrives after the next request: the master receives the answer to an earlier request."""


@kind("answer_garbage")
class AnswerGarbage(CountAtInstant):
    """Random octets come in the place of answers."""


@kind("answer_corrupted")
class AnswerCorrupted(CountAtInstant):
    """One bit of each answer is inverted: on RTU the checksum detects it; on TCP the bit is in the header."""


@kind("answer_truncated")
class AnswerTruncated(AtInstant):
    """Answers end after `length` octets."""

    length: Annotated[int, Ge(0), Le(260)] = 4
    count: Count = 1


@kind("answer_wrong_unit")
class AnswerWrongUnit(AtInstant):
    """Answers carry the unit id `to`."""

    to: Annotated[int, Ge(1), Le(247)]
    count: Count = 1


@kind("answer_exception")
class AnswerException(AtInstant):
    """The drive answers with an exception and does not execute the request."""

    code: Annotated[int, Ge(1), Le(255)] = 4
    count: Count = 1


@kind("connection_reset")
class ConnectionReset(OpenEndAtInstant):
    """The connection is reset, or the serial adapter unplugged, for `duration` [s]."""


@kind("foreign_set_points")
class ForeignSetPoints(AtInstant):
    """Set-points of another master that no device on the line receives: a target torque of `share` of rated torque,
    `count` times, every `interval` [s]. Each acts until the next set-point of either master."""

    share: Annotated[float, Ge(-1), Le(1)] = 0.8
    interval: Time = 0.05
    count: Count | None = None


AnswerDisturbance = (
    AnswerLost
    | AnswerDelayed
    | AnswerSwapped
    | AnswerGarbage
    | AnswerCorrupted
    | AnswerTruncated
    | AnswerWrongUnit
    | AnswerException
)
"""Kinds that concern the next answers of a drive."""
LineDisturbance = AnswerDisturbance | ConnectionReset
"""Kinds that disturb a line or its frames."""
AnswerFault = LineDisturbance | ForeignSetPoints
"""Kinds of a Modbus line, its masters and its drives' answers."""


# Faults of the computer that the loop runs on, and of the hand on the handle.


@kind("host_late")
class HostLate(DelayAtInstant):
    """A busy computer: the loop wakes up `delay` [s] late, the next `count` times that it waits."""


@kind("host_paused")
class HostPaused(AtInstant):
    """A computer that does nothing for `duration` [s], as after SIGSTOP or in sleep mode."""

    duration: Time


@kind("clock_step")
class ClockStep(AtInstant):
    """The clock of the computer steps by `step` [s]; everything else continues."""

    step: Annotated[float, Ge(-1000.0), Le(1000.0)]


@kind("slow_compute")
class SlowCompute(AtInstant):
    """A slow computer: each of the next `count` periods takes `extra` [s] longer."""

    extra: Time
    count: Count = 1


@kind("hand_release")
class HandRelease(AtInstant):
    """The hand releases the handle."""


@kind("hand_hit")
class HandHit(AtInstant):
    """A blow of the hand: an additional signed `force` [N] for `duration` [s]."""

    force: Annotated[float, Ge(-1000.0), Le(1000.0)] = 100.0
    duration: Time = 0.02


HostFault = HostLate | HostPaused | ClockStep | SlowCompute
HandFault = HandRelease | HandHit


# Faults of a drive and its node, from an instant on, or from power-on.


@kind("emergency")
class Emergency(AtInstant):
    """An emergency message, without any effect on the drive."""

    code: ErrorCode


@kind("drive_fault")
class DriveFault(AtInstant):
    """A fault that the drive detects: emergency message, fault reaction, *fault*. Its cause lasts for `duration` [s];
    until then the fault cannot be reset. 0: for an instant.
    """

    # 2310h: continuous over current.
    code: ErrorCode = 0x2310
    duration: NonNegativeTime | None = 0.0


@kind("safe_torque_off")
class SafeTorqueOff(OpenEndAtInstant):
    """Safe torque off opens, and closes after `duration` [s]; torque ends at once."""


@kind("node_reset")
class NodeReset(AtInstant):
    """A restart of the node by its watchdog; the boot-up message comes `duration` [s] later."""

    duration: Time = 0.001


@kind("silence")
class Silence(OpenEndAtInstant):
    """A disconnected cable of the node: it neither sends nor receives."""


@kind("missing_tpdos")
class MissingTpdos(CountAtInstant):
    """The loss of the next `count` TPDOs inside the node."""


@kind("missing_rpdos")
class MissingRpdos(OpenCountAtInstant):
    """The loss of the next `count` RPDOs inside the node; the drive keeps its last set-point."""


@kind("sync_ignored")
class SyncIgnored(OpenCountAtInstant):
    """The loss of the next `count` SYNC messages inside the node."""


@kind("heartbeat_lost")
class HeartbeatLost(AtInstant):
    """The end of the node's own heartbeat; everything else continues."""


@kind("duplicate_node")
class DuplicateNode(AtInstant):
    """A second node with the same node-ID joins: each frame of the node is sent twice."""


@kind("encoder_jump")
class EncoderJump(AtInstant):
    """A sudden offset of `counts` encoder counts."""

    counts: Counts


@kind("position_stuck")
class PositionStuck(OpenEndAtInstant):
    """An encoder that repeats its last counts while the shaft moves."""


@kind("encoder_scaling")
class EncoderScaling(AtInstant):
    """An encoder that counts `factor` times as much for the same motion from here on; negative: backwards."""

    factor: Annotated[float, Ge(-1000.0), Le(1000.0)]


@kind("encoder_reversed")
class EncoderReversed(AtInstant):
    """An encoder that counts backwards from here on."""


@kind("torque_dead")
class TorqueDead(AtInstant):
    """A current loop without torque; the drive reports no fault, only a torque actual value of 0."""


@kind("torque_saturated")
class TorqueSaturated(AtInstant):
    """A current loop that reaches no more than `share` of rated torque."""

    share: Share = 0.1


@kind("torque_reversed")
class TorqueReversed(AtInstant):
    """A motor with reversed direction: current and torque actual value are as commanded."""


@kind("missing_node")
class MissingNode(NamedFault):
    """A node that is absent from the bus."""


@kind("wrong_identity")
class WrongIdentity(NamedFault):
    """Another vendor-ID or product code in 1018h."""

    vendor_id: UInt32 | None = None
    product_code: UInt32 | None = None


@kind("sdo_abort")
class SdoRefusal(NamedFault):
    """An abort of every SDO access to one entry, with this code."""

    object: Annotated[int, Ge(0), Le(0xFFFF)]
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    code: UInt32 = 0x0601_0002


@kind("dead_guard")
class DeadGuard(NamedFault):
    """A drive watchdog that fires after `factor` times its set time; without `factor` it never fires."""

    factor: Annotated[float, Ge(1), Le(1000)] | None = None


DriveFaultKind = (
    Emergency
    | DriveFault
    | SafeTorqueOff
    | NodeReset
    | Silence
    | MissingTpdos
    | MissingRpdos
    | SyncIgnored
    | HeartbeatLost
    | DuplicateNode
    | EncoderJump
    | PositionStuck
    | EncoderScaling
    | EncoderReversed
    | TorqueDead
    | TorqueSaturated
    | TorqueReversed
)
"""Kinds of one drive that happen at an instant."""
LastingFault = MissingNode | WrongIdentity | SdoRefusal | DeadGuard
"""Kinds that exist from power-on."""


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
    """Return the faults of a file, one at least; raises FaultFileError that lists everything wrong in it."""
    document = read_document(Path(path), FaultFileError)
    found = document.checked(document.validate(FaultFile)).fault
    if not found:
        raise FaultFileError(path, [FileFault("", "no fault in it; expected tables [[fault]]")])
    return found


def toml_of(faults: Iterable[Fault]) -> str:
    """Return the text of a file of these faults; a value that is the default of its key is left out."""
    return "\n".join("[[fault]]\n" + "".join(_lines(fault)) for fault in faults)


def kinds_of(union: object) -> frozenset[str]:
    """Return the names of the kinds in a union of them, or of one kind."""
    return frozenset(kind.__annotations__["kind"].__args__[0] for kind in get_args(union) or (union,))


def faults_of(faults: Iterable[Fault], node: int) -> tuple[Fault, ...]:
    """Return the faults that concern one drive of a bus."""
    return tuple(fault for fault in faults if fault.node in (None, node))


def faults_on(faults: Iterable[Fault], bus: str) -> tuple[Fault, ...]:
    """Return the faults that concern one bus of a rig."""
    return tuple(fault for fault in faults if fault.bus in (None, bus))


def _lines(fault: Fault) -> Iterable[str]:
    # `node` and `bus` are declared first, because they are inherited; `kind` stands first for the reader.
    for field in sorted(fields(fault), key=lambda field: field.name != "kind"):
        value = getattr(fault, field.name)
        if value != field.default and value is not None:
            yield f"{field.name} = {_text(value)}\n"


def _text(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return str(list(value)) if isinstance(value, tuple) else repr(value)

"""Faults of a simulated bench, as data: the kinds of `[[fault]]` in a TOML file.

`at` [s] counts from *operation enabled*, and counts anew if a drive is enabled again before any fault has happened;
faults without `at` exist from power-on. `node` is the node-ID of the drive, None every drive of the bus; `bus` is a bus
of the rig, None every bus. `duration` [s] None is for ever.
"""

import json
from collections.abc import Collection, Iterable
from dataclasses import KW_ONLY, dataclass, fields
from pathlib import Path
from typing import Annotated, Literal, dataclass_transform, get_args

from annotated_types import Ge, Le, Len

from haptic_fieldbus.documents import Document, read_document
from haptic_fieldbus.drive.fields import Counts, NonNegativeTime, Table, Time, UInt32
from haptic_fieldbus.drive.rig import ByKind
from haptic_fieldbus.errors import Fault as FileFault
from haptic_fieldbus.errors import FaultFileError, wrong_kind

# The fields that all kinds of faults share, and the types of fields that several have.

Node = Annotated[int, Ge(1), Le(255)]
"""Number of a drive on its bus: a node-ID of CANopen, up to 127, or a Modbus unit."""
NodeId = Annotated[int, Ge(1), Le(127)]
ErrorCode = Annotated[int, Ge(0x0001), Le(0xFFFF)]
Count = Annotated[int, Ge(1), Le(1_000_000_000)]
Octet = Annotated[int, Ge(0), Le(0xFF)]
CanId = Annotated[int, Ge(0), Le(0x7FF)]
Share = Annotated[float, Ge(0), Le(1)]


@dataclass_transform(frozen_default=True)
class FaultTable(Table):
    """A frozen dataclass for each class below; one that is given a name has it as the only value of its key `kind`."""

    def __init_subclass__(cls, kind: str = "") -> None:
        if kind:
            cls.__annotations__ = {"kind": Literal.__getitem__(kind), **cls.__annotations__}
        dataclass(frozen=True)(cls)


class NamedFault(FaultTable):
    """A fault of a kind, with the drives and buses that it concerns; each kind adds its own keys."""

    kind: str
    _: KW_ONLY
    node: Node | None = None
    bus: str | None = None


class AtInstant(NamedFault):
    """A fault that happens once, `at` seconds after *operation enabled*."""

    at: NonNegativeTime


class CountAtInstant(AtInstant):
    """A fault of the next `count` frames, answers or messages."""

    count: Count = 1


class OpenCountAtInstant(AtInstant):
    """A fault of the next `count` messages; None: of all."""

    count: Count | None = None


class OpenEndAtInstant(AtInstant):
    """A fault that lasts for `duration` [s]; None: for ever."""

    duration: Time | None = None


class DelayAtInstant(AtInstant):
    """A delay [s], `count` times."""

    delay: Time
    count: Count = 1


# Faults of the bus: frames that do not arrive as they were sent, other frames, and the controller of the master.
#
# A disturbed frame is on the wire as its sender sent it; what its receivers get is something else, or nothing.

FrameGroup = Literal["tpdo", "rpdo", "sync", "heartbeat", "emergency", "sdo", "nmt"]
"""Frames by their service; SYNC and NMT commands belong to every node, a heartbeat to the one that sends it."""


class FramesAtInstant(AtInstant):
    """A fault of the next `count` frames of a service."""

    frames: FrameGroup = "tpdo"
    count: Count = 1


class FrameDropped(FramesAtInstant, kind="frame_dropped"):
    """The loss of the next `count` frames of a service between sender and receivers."""


class FrameDelayed(AtInstant, kind="frame_delayed"):
    """The late arrival of the next `count` frames of a service, by `delay` [s]."""

    delay: Time
    frames: FrameGroup = "tpdo"
    count: Count = 1


class FrameDuplicated(FramesAtInstant, kind="frame_duplicated"):
    """The next `count` frames of a service arrive twice."""


class FrameWrongLength(AtInstant, kind="frame_wrong_length"):
    """The next `count` frames of a service arrive with another length: cut off, or filled up with zeros."""

    length: Annotated[int, Ge(0), Le(8)]
    frames: FrameGroup = "tpdo"
    count: Count = 1


class FrameWrongNode(AtInstant, kind="frame_wrong_node"):
    """The next `count` frames of a service arrive under the identifier of the node `to`."""

    to: NodeId
    frames: FrameGroup = "tpdo"
    count: Count = 1


class ForeignFrame(AtInstant, kind="foreign_frame"):
    """A frame of another program, `count` times, one every `interval` [s]."""

    can_id: CanId
    data: Annotated[tuple[Octet, ...], Len(0, 8)] = ()
    count: Count = 1
    interval: Time = 0.001


class BusOff(OpenEndAtInstant, kind="bus_off"):
    """Bus-off of the master's controller: an error frame, then it neither sends nor receives."""


class InterfaceDown(OpenEndAtInstant, kind="interface_down"):
    """The interface of the master is down: sending and receiving fail with "Network is down"."""


class ErrorFrame(AtInstant, kind="error_frame"):
    """A disturbed frame that the master's controller reports; no frame is lost."""


Disturbance = FrameDropped | FrameDelayed | FrameDuplicated | FrameWrongLength | FrameWrongNode
"""Kinds that act on the way from a sender to its receivers."""
LineFault = Disturbance | ForeignFrame | BusOff | InterfaceDown | ErrorFrame
"""Kinds of the bus, which concern all of its drives at once."""


# Faults of requests and answers on Modbus: an answer that does not come as it was sent, or another master.
#
# Those of answers concern the next `count` answers of a drive on a line; the drive has carried out the requests.


class AnswerLost(CountAtInstant, kind="answer_lost"):
    """No answer comes."""


class AnswerDelayed(DelayAtInstant, kind="answer_delayed"):
    """Answers come later by `delay` [s]."""


class AnswerSwapped(CountAtInstant, kind="answer_swapped"):
    """Each answer arrives after the next request: the master receives the answer to an earlier request."""


class AnswerGarbage(CountAtInstant, kind="answer_garbage"):
    """Random octets come in the place of answers."""


class AnswerCorrupted(CountAtInstant, kind="answer_corrupted"):
    """One bit of each answer is inverted: on RTU the checksum detects it; on TCP the bit is in the header."""


class AnswerTruncated(AtInstant, kind="answer_truncated"):
    """Answers end after `length` octets."""

    length: Annotated[int, Ge(0), Le(260)] = 4
    count: Count = 1


class AnswerWrongUnit(AtInstant, kind="answer_wrong_unit"):
    """Answers carry the unit id `to`."""

    to: Annotated[int, Ge(1), Le(247)]
    count: Count = 1


class AnswerException(AtInstant, kind="answer_exception"):
    """The drive answers with an exception and does not execute the request."""

    code: Annotated[int, Ge(1), Le(255)] = 4
    count: Count = 1


class ConnectionReset(OpenEndAtInstant, kind="connection_reset"):
    """The connection is reset, or the serial adapter unplugged, for `duration` [s]."""


class ForeignSetPoints(AtInstant, kind="foreign_set_points"):
    """Set-points of another master that no device on the line receives: a target torque of `share` of rated torque,
    `count` times, every `interval` [s]. Each acts until the next set-point of either master."""

    share: Annotated[float, Ge(-1), Le(1)] = 0.8
    interval: Time = 0.05
    count: Count | None = None


LateAnswer = AnswerLost | AnswerDelayed | AnswerSwapped
WrongAnswer = AnswerGarbage | AnswerCorrupted | AnswerTruncated | AnswerWrongUnit | AnswerException
AnswerDisturbance = LateAnswer | WrongAnswer
"""Kinds that concern the next answers of a drive."""
LineDisturbance = AnswerDisturbance | ConnectionReset
"""Kinds that disturb a line or its frames."""
AnswerFault = LineDisturbance | ForeignSetPoints
"""Kinds of a Modbus line, its masters and its drives' answers."""


# Faults of the computer that the loop runs on, and of the hand on the handle.


class HostLate(DelayAtInstant, kind="host_late"):
    """A busy computer: the loop wakes up `delay` [s] late, the next `count` times that it waits."""


class HostPaused(AtInstant, kind="host_paused"):
    """A computer that does nothing for `duration` [s], as after SIGSTOP or in sleep mode."""

    duration: Time


class ClockStep(AtInstant, kind="clock_step"):
    """The clock of the computer steps by `step` [s]; everything else continues."""

    step: Annotated[float, Ge(-1000.0), Le(1000.0)]


class SlowCompute(AtInstant, kind="slow_compute"):
    """A slow computer: each of the next `count` periods takes `extra` [s] longer."""

    extra: Time
    count: Count = 1


class HandRelease(AtInstant, kind="hand_release"):
    """The hand releases the handle."""


class HandHit(AtInstant, kind="hand_hit"):
    """A blow of the hand: an additional signed `force` [N] for `duration` [s]."""

    force: Annotated[float, Ge(-1000.0), Le(1000.0)] = 100.0
    duration: Time = 0.02


HostFault = HostLate | HostPaused | ClockStep | SlowCompute
HandFault = HandRelease | HandHit


# Faults of a drive and its node, from an instant on, or from power-on.


class Emergency(AtInstant, kind="emergency"):
    """An emergency message, without any effect on the drive."""

    code: ErrorCode


class DriveFault(AtInstant, kind="drive_fault"):
    """A fault that the drive detects: emergency message, fault reaction, *fault*. Its cause lasts for `duration` [s];
    until then the fault cannot be reset. 0: for an instant.
    """

    # 2310h: continuous over current.
    code: ErrorCode = 0x2310
    duration: NonNegativeTime | None = 0.0


class SafeTorqueOff(OpenEndAtInstant, kind="safe_torque_off"):
    """Safe torque off opens, and closes after `duration` [s]; torque ends at once."""


class NodeReset(AtInstant, kind="node_reset"):
    """A restart of the node by its watchdog; the boot-up message comes `duration` [s] later."""

    duration: Time = 0.001


class Silence(OpenEndAtInstant, kind="silence"):
    """A disconnected cable of the node: it neither sends nor receives."""


class MissingTpdos(CountAtInstant, kind="missing_tpdos"):
    """The loss of the next `count` TPDOs inside the node."""


class MissingRpdos(OpenCountAtInstant, kind="missing_rpdos"):
    """The loss of the next `count` RPDOs inside the node; the drive keeps its last set-point."""


class SyncIgnored(OpenCountAtInstant, kind="sync_ignored"):
    """The loss of the next `count` SYNC messages inside the node."""


class HeartbeatLost(AtInstant, kind="heartbeat_lost"):
    """The end of the node's own heartbeat; everything else continues."""


class DuplicateNode(AtInstant, kind="duplicate_node"):
    """A second node with the same node-ID joins: each frame of the node is sent twice."""


class EncoderJump(AtInstant, kind="encoder_jump"):
    """A sudden offset of `counts` encoder counts."""

    counts: Counts


class PositionStuck(OpenEndAtInstant, kind="position_stuck"):
    """An encoder that repeats its last counts while the shaft moves."""


class EncoderScaling(AtInstant, kind="encoder_scaling"):
    """An encoder that counts `factor` times as much for the same motion from here on; negative: backwards."""

    factor: Annotated[float, Ge(-1000.0), Le(1000.0)]


class EncoderReversed(AtInstant, kind="encoder_reversed"):
    """An encoder that counts backwards from here on."""


class TorqueDead(AtInstant, kind="torque_dead"):
    """A current loop without torque; the drive reports no fault, only a torque actual value of 0."""


class TorqueSaturated(AtInstant, kind="torque_saturated"):
    """A current loop that reaches no more than `share` of rated torque."""

    share: Share = 0.1


class TorqueReversed(AtInstant, kind="torque_reversed"):
    """A motor with reversed direction: current and torque actual value are as commanded."""


class MissingNode(NamedFault, kind="missing_node"):
    """A node that is absent from the bus."""


class WrongIdentity(NamedFault, kind="wrong_identity"):
    """Another vendor-ID or product code in 1018h."""

    vendor_id: UInt32 | None = None
    product_code: UInt32 | None = None


class SdoRefusal(NamedFault, kind="sdo_abort"):
    """An abort of every SDO access to one entry, with this code."""

    object: Annotated[int, Ge(0), Le(0xFFFF)]
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    code: UInt32 = 0x0601_0002


class DeadGuard(NamedFault, kind="dead_guard"):
    """A drive watchdog that fires after `factor` times its set time; without `factor` it never fires."""

    factor: Annotated[float, Ge(1), Le(1000)] | None = None


MessageFault = MissingTpdos | MissingRpdos | SyncIgnored | HeartbeatLost | DuplicateNode
"""Kinds of the messages of a CANopen node."""
EncoderFault = EncoderJump | PositionStuck | EncoderScaling | EncoderReversed
MotorFault = TorqueDead | TorqueSaturated | TorqueReversed
DriveFaultKind = Emergency | DriveFault | SafeTorqueOff | NodeReset | Silence | MessageFault | EncoderFault | MotorFault
"""Kinds of one drive that happen at an instant."""
LastingFault = MissingNode | WrongIdentity | SdoRefusal | DeadGuard
"""Kinds that exist from power-on."""


# Files of faults: read, checked, and written.

TimedFault = DriveFaultKind | LineFault | AnswerFault | HostFault | HandFault
"""Kinds that happen at an instant."""
Fault = TimedFault | LastingFault


@dataclass(frozen=True)
class FaultFile(Table):
    """A file of faults: `[[fault]] kind = "silence", at = 1.0`."""

    fault: tuple[Annotated[Fault, ByKind()], ...] = ()


def load_faults(path: str | Path) -> tuple[Fault, ...]:
    """Return the faults of a file, one at least; raises FaultFileError that lists everything wrong in it."""
    document = read_document(Path(path), FaultFileError)
    if not (found := document.checked(document.validate(FaultFile)).fault):
        raise FaultFileError(path, [FileFault("", "no fault in it; expected tables [[fault]]")])
    return found


def checked_faults(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Return faults that were made in Python, checked as those of a file; raises FaultFileError or TypeError."""
    for fault in (given := tuple(faults)):
        if not isinstance(fault, Fault):
            raise wrong_kind("fault", "an object of haptic_fieldbus.sim.faults", fault)
    if not given:  # then the schema of a file is not built
        return ()
    document = Document("faults", toml_of(given), FaultFileError)
    return document.checked(document.validate(FaultFile)).fault


def of_no_drive(faults: Iterable[Fault], nodes: Collection[int]) -> list[str]:
    """Return a sentence for each fault whose node is none of these."""
    here = ", ".join(map(str, sorted(nodes)))
    return [
        f'fault "{fault.kind}" is of node {fault.node}; the drives have: {here}'
        for fault in faults
        if fault.node is not None and fault.node not in nodes
    ]


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
    for field in fields(fault):
        value = getattr(fault, field.name)
        if value != field.default and value is not None:
            # Texts, numbers and lists are written in TOML as in JSON.
            yield f"{field.name} = {json.dumps(value, ensure_ascii=False)}\n"

"""The kinds of faults of a simulated bench: of drives, frames, answers and the host."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Le, Len

from haptic_fieldbus.drive.fields import STRICT, Counts, NonNegativeTime, Time, UInt32

# The fields that all kinds of faults share, and the types of fields that several have.

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
class AtInstant(FaultTargets):
    """A fault that happens once, `at` seconds after *operation enabled*; each kind adds its name and its own keys."""

    kind: str
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


@dataclass(frozen=True)
class FrameDropped(FramesAtInstant):
    """The loss of the next `count` frames of a service between sender and receivers."""

    kind: Literal["frame_dropped"]


@dataclass(frozen=True)
class FrameDelayed(AtInstant):
    """The late arrival of the next `count` frames of a service, by `delay` [s]."""

    kind: Literal["frame_delayed"]
    delay: Time
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameDuplicated(FramesAtInstant):
    """The next `count` frames of a service arrive twice."""

    kind: Literal["frame_duplicated"]


@dataclass(frozen=True)
class FrameWrongLength(AtInstant):
    """The next `count` frames of a service arrive with another length: cut off, or filled up with zeros."""

    kind: Literal["frame_wrong_length"]
    length: Annotated[int, Ge(0), Le(8)]
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameWrongNode(AtInstant):
    """The next `count` frames of a service arrive under the identifier of the node `to`."""

    kind: Literal["frame_wrong_node"]
    to: Node
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class ForeignFrame(AtInstant):
    """A frame of another program, `count` times, one every `interval` [s]."""

    kind: Literal["foreign_frame"]
    can_id: CanId
    data: Annotated[tuple[Octet, ...], Len(0, 8)] = ()
    count: Count = 1
    interval: Time = 0.001


@dataclass(frozen=True)
class BusOff(OpenEndAtInstant):
    """Bus-off of the master's controller: an error frame, then it neither sends nor receives."""

    kind: Literal["bus_off"]


@dataclass(frozen=True)
class InterfaceDown(OpenEndAtInstant):
    """The interface of the master is down: to send and to receive fails with "Network is down"."""

    kind: Literal["interface_down"]


@dataclass(frozen=True)
class ErrorFrame(AtInstant):
    """A disturbed frame that the master's controller reports; no frame is lost."""

    kind: Literal["error_frame"]


Disturbance = FrameDropped | FrameDelayed | FrameDuplicated | FrameWrongLength | FrameWrongNode
"""Kinds that act on the way from a sender to its receivers."""
LineFault = Disturbance | ForeignFrame | BusOff | InterfaceDown | ErrorFrame
"""Kinds of the bus, which concern all of its drives at once."""


# Faults of requests and answers on Modbus: an answer that does not come as it was sent, or another master.
#
# Those of answers concern the next `count` answers of a drive on a line; the drive has carried out the requests.


@dataclass(frozen=True)
class AnswerLost(CountAtInstant):
    """No answer comes."""

    kind: Literal["answer_lost"]


@dataclass(frozen=True)
class AnswerDelayed(DelayAtInstant):
    """Answers come later by `delay` [s]."""

    kind: Literal["answer_delayed"]


@dataclass(frozen=True)
class AnswerSwapped(CountAtInstant):
    """Each answer arrives after the next request: the master receives the answer to an earlier request."""

    kind: Literal["answer_swapped"]


@dataclass(frozen=True)
class AnswerGarbage(CountAtInstant):
    """Random octets come in the place of answers."""

    kind: Literal["answer_garbage"]


@dataclass(frozen=True)
class AnswerCorrupted(CountAtInstant):
    """One bit of each answer is inverted: on RTU the checksum detects it; on TCP the bit is in the header."""

    kind: Literal["answer_corrupted"]


@dataclass(frozen=True)
class AnswerTruncated(AtInstant):
    """Answers end after `length` octets."""

    kind: Literal["answer_truncated"]
    length: Annotated[int, Ge(0), Le(260)] = 4
    count: Count = 1


@dataclass(frozen=True)
class AnswerWrongUnit(AtInstant):
    """Answers carry the unit id `to`."""

    kind: Literal["answer_wrong_unit"]
    to: Annotated[int, Ge(1), Le(247)]
    count: Count = 1


@dataclass(frozen=True)
class AnswerException(AtInstant):
    """The drive answers with an exception and does not execute the request."""

    kind: Literal["answer_exception"]
    code: Annotated[int, Ge(1), Le(255)] = 4
    count: Count = 1


@dataclass(frozen=True)
class ConnectionReset(OpenEndAtInstant):
    """The connection is reset, or the serial adapter unplugged, for `duration` [s]."""

    kind: Literal["connection_reset"]


@dataclass(frozen=True)
class ForeignSetPoints(AtInstant):
    """Set-points of another master that no device on the line receives: a target torque of `share` of rated torque,
    `count` times, every `interval` [s]. Each acts until the next set-point of either master."""

    kind: Literal["foreign_set_points"]
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


@dataclass(frozen=True)
class HostLate(DelayAtInstant):
    """A busy computer: the loop wakes up `delay` [s] late, the next `count` times that it waits."""

    kind: Literal["host_late"]


@dataclass(frozen=True)
class HostPaused(AtInstant):
    """A computer that does nothing for `duration` [s], as after SIGSTOP or in sleep mode."""

    kind: Literal["host_paused"]
    duration: Time


@dataclass(frozen=True)
class ClockStep(AtInstant):
    """The clock of the computer steps by `step` [s]; everything else continues."""

    kind: Literal["clock_step"]
    step: Annotated[float, Ge(-1000.0), Le(1000.0)]


@dataclass(frozen=True)
class SlowCompute(AtInstant):
    """A slow computer: each of the next `count` periods takes `extra` [s] longer."""

    kind: Literal["slow_compute"]
    extra: Time
    count: Count = 1


@dataclass(frozen=True)
class HandRelease(AtInstant):
    """The hand releases the handle."""

    kind: Literal["hand_release"]


@dataclass(frozen=True)
class HandHit(AtInstant):
    """A blow of the hand: an additional signed `force` [N] for `duration` [s]."""

    kind: Literal["hand_hit"]
    force: Annotated[float, Ge(-1000.0), Le(1000.0)] = 100.0
    duration: Time = 0.02


HostFault = HostLate | HostPaused | ClockStep | SlowCompute
HandFault = HandRelease | HandHit


# Faults of a drive and its node, from an instant on, or from power-on.


@dataclass(frozen=True)
class Emergency(AtInstant):
    """An emergency message, without any effect on the drive."""

    kind: Literal["emergency"]
    code: ErrorCode


@dataclass(frozen=True)
class DriveFault(AtInstant):
    """A fault that the drive detects: emergency message, fault reaction, *fault*. Its cause lasts for `duration` [s];
    until then the fault cannot be reset. 0: for an instant.
    """

    kind: Literal["drive_fault"]
    # 2310h: continuous over current.
    code: ErrorCode = 0x2310
    duration: NonNegativeTime | None = 0.0


@dataclass(frozen=True)
class SafeTorqueOff(OpenEndAtInstant):
    """Safe torque off opens, and closes after `duration` [s]; torque ends at once."""

    kind: Literal["safe_torque_off"]


@dataclass(frozen=True)
class NodeReset(AtInstant):
    """A restart of the node by its watchdog; the boot-up message comes `duration` [s] later."""

    kind: Literal["node_reset"]
    duration: Time = 0.001


@dataclass(frozen=True)
class Silence(OpenEndAtInstant):
    """A disconnected cable of the node: it neither sends nor receives."""

    kind: Literal["silence"]


@dataclass(frozen=True)
class MissingTpdos(CountAtInstant):
    """The loss of the next `count` TPDOs inside the node."""

    kind: Literal["missing_tpdos"]


@dataclass(frozen=True)
class MissingRpdos(OpenCountAtInstant):
    """The loss of the next `count` RPDOs inside the node; the drive keeps its last set-point."""

    kind: Literal["missing_rpdos"]


@dataclass(frozen=True)
class SyncIgnored(OpenCountAtInstant):
    """The loss of the next `count` SYNC messages inside the node."""

    kind: Literal["sync_ignored"]


@dataclass(frozen=True)
class HeartbeatLost(AtInstant):
    """The end of the node's own heartbeat; everything else continues."""

    kind: Literal["heartbeat_lost"]


@dataclass(frozen=True)
class DuplicateNode(AtInstant):
    """A second node with the same node-ID joins: each frame of the node is sent twice."""

    kind: Literal["duplicate_node"]


@dataclass(frozen=True)
class EncoderJump(AtInstant):
    """A sudden offset of `counts` encoder counts."""

    kind: Literal["encoder_jump"]
    counts: Counts


@dataclass(frozen=True)
class PositionStuck(OpenEndAtInstant):
    """An encoder that repeats its last counts while the shaft moves."""

    kind: Literal["position_stuck"]


@dataclass(frozen=True)
class EncoderScaling(AtInstant):
    """An encoder that counts `factor` times as much for the same motion from here on; negative: backwards."""

    kind: Literal["encoder_scaling"]
    factor: Annotated[float, Ge(-1000.0), Le(1000.0)]


@dataclass(frozen=True)
class EncoderReversed(AtInstant):
    """An encoder that counts backwards from here on."""

    kind: Literal["encoder_reversed"]


@dataclass(frozen=True)
class TorqueDead(AtInstant):
    """A current loop without torque; the drive reports no fault, only a torque actual value of 0."""

    kind: Literal["torque_dead"]


@dataclass(frozen=True)
class TorqueSaturated(AtInstant):
    """A current loop that reaches no more than `share` of rated torque."""

    kind: Literal["torque_saturated"]
    share: Share = 0.1


@dataclass(frozen=True)
class TorqueReversed(AtInstant):
    """A motor with reversed direction: current and torque actual value are as commanded."""

    kind: Literal["torque_reversed"]


@dataclass(frozen=True)
class MissingNode(FaultTargets):
    """A node that is absent from the bus."""

    kind: Literal["missing_node"]


@dataclass(frozen=True)
class WrongIdentity(FaultTargets):
    """Another vendor-ID or product code in 1018h."""

    kind: Literal["wrong_identity"]
    vendor_id: UInt32 | None = None
    product_code: UInt32 | None = None


@dataclass(frozen=True)
class SdoRefusal(FaultTargets):
    """An abort of every SDO access to one entry, with this code."""

    kind: Literal["sdo_abort"]
    object: Annotated[int, Ge(0), Le(0xFFFF)]
    subindex: Annotated[int, Ge(0), Le(255)] = 0
    code: UInt32 = 0x0601_0002


@dataclass(frozen=True)
class DeadGuard(FaultTargets):
    """A drive watchdog that fires after `factor` times its set time. None: never."""

    kind: Literal["dead_guard"]
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

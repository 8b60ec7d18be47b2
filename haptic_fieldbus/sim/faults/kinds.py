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


# Faults of the bus: frames that do not arrive as they were sent, other frames, and the controller of the master.
#
# A disturbed frame is on the wire as its sender sent it; what its receivers get is something else, or nothing.

FrameGroup = Literal["tpdo", "rpdo", "sync", "heartbeat", "emergency", "sdo", "nmt"]
"""Frames by their service; SYNC and NMT commands belong to every node, a heartbeat to the one that sends it."""


@dataclass(frozen=True)
class FrameDropped(FaultTargets):
    """The loss of the next `count` frames of a service between sender and receivers."""

    kind: Literal["frame_dropped"]
    at: NonNegativeTime
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameDelayed(FaultTargets):
    """The late arrival of the next `count` frames of a service, by `delay` [s]."""

    kind: Literal["frame_delayed"]
    at: NonNegativeTime
    delay: Time
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameDuplicated(FaultTargets):
    """The next `count` frames of a service arrive twice."""

    kind: Literal["frame_duplicated"]
    at: NonNegativeTime
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameWrongLength(FaultTargets):
    """The next `count` frames of a service arrive with another length: cut off, or filled up with zeros."""

    kind: Literal["frame_wrong_length"]
    at: NonNegativeTime
    length: Annotated[int, Ge(0), Le(8)]
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameWrongNode(FaultTargets):
    """The next `count` frames of a service arrive under the identifier of the node `to`."""

    kind: Literal["frame_wrong_node"]
    at: NonNegativeTime
    to: Node
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class ForeignFrame(FaultTargets):
    """A frame of another program, `count` times, one every `interval` [s]."""

    kind: Literal["foreign_frame"]
    at: NonNegativeTime
    can_id: CanId
    data: Annotated[tuple[Octet, ...], Len(0, 8)] = ()
    count: Count = 1
    interval: Time = 0.001


@dataclass(frozen=True)
class BusOff(FaultTargets):
    """Bus-off of the master's controller: an error frame, then it neither sends nor receives."""

    kind: Literal["bus_off"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class InterfaceDown(FaultTargets):
    """The interface of the master is down: to send and to receive fails with "Network is down"."""

    kind: Literal["interface_down"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class ErrorFrame(FaultTargets):
    """A disturbed frame that the master's controller reports; no frame is lost."""

    kind: Literal["error_frame"]
    at: NonNegativeTime


Disturbance = FrameDropped | FrameDelayed | FrameDuplicated | FrameWrongLength | FrameWrongNode
"""Kinds that act on the way from a sender to its receivers."""
LineFault = Disturbance | ForeignFrame | BusOff | InterfaceDown | ErrorFrame
"""Kinds of the bus, which concern all of its drives at once."""


# Faults of requests and answers on Modbus: an answer that does not come as it was sent, or another master.
#
# Those of answers concern the next `count` answers of a drive on a line; the drive has carried out the requests.


@dataclass(frozen=True)
class AnswerLost(FaultTargets):
    """No answer comes."""

    kind: Literal["answer_lost"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerDelayed(FaultTargets):
    """Answers come later by `delay` [s]."""

    kind: Literal["answer_delayed"]
    at: NonNegativeTime
    delay: Time
    count: Count = 1


@dataclass(frozen=True)
class AnswerSwapped(FaultTargets):
    """Each answer comes when the next request was sent: the master gets the answer to an earlier one."""

    kind: Literal["answer_swapped"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerGarbage(FaultTargets):
    """Random octets come in the place of answers."""

    kind: Literal["answer_garbage"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerCorrupted(FaultTargets):
    """One bit of each answer is another: on RTU the checksum shows it; on TCP it is in the header."""

    kind: Literal["answer_corrupted"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerTruncated(FaultTargets):
    """Answers end after `length` octets."""

    kind: Literal["answer_truncated"]
    at: NonNegativeTime
    length: Annotated[int, Ge(0), Le(260)] = 4
    count: Count = 1


@dataclass(frozen=True)
class AnswerWrongUnit(FaultTargets):
    """Answers come under the unit id `to`."""

    kind: Literal["answer_wrong_unit"]
    at: NonNegativeTime
    to: Annotated[int, Ge(1), Le(247)]
    count: Count = 1


@dataclass(frozen=True)
class AnswerException(FaultTargets):
    """The drive answers with an exception, and carries nothing out."""

    kind: Literal["answer_exception"]
    at: NonNegativeTime
    code: Annotated[int, Ge(1), Le(255)] = 4
    count: Count = 1


@dataclass(frozen=True)
class ConnectionReset(FaultTargets):
    """The connection is reset, or the serial adapter unplugged; for `duration` [s] there is none."""

    kind: Literal["connection_reset"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class ForeignSetPoints(FaultTargets):
    """Set-points of another master, which nobody on the line hears: a target torque of `share` of rated torque, `count`
    times, once every `interval` [s]. Each acts until the next one of either master."""

    kind: Literal["foreign_set_points"]
    at: NonNegativeTime
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
"""Kinds that disturb a line or what comes on it."""
AnswerFault = LineDisturbance | ForeignSetPoints
"""Kinds of a Modbus line, its masters and its drives' answers."""


# Faults of the computer that the loop runs on, and of the hand on the handle.


@dataclass(frozen=True)
class HostLate(FaultTargets):
    """A busy computer: the next `count` times that the loop waits, it wakes up `delay` [s] too late."""

    kind: Literal["host_late"]
    at: NonNegativeTime
    delay: Time
    count: Count = 1


@dataclass(frozen=True)
class HostPaused(FaultTargets):
    """A computer that does nothing at all for `duration` [s], as with SIGSTOP or a lid that is closed."""

    kind: Literal["host_paused"]
    at: NonNegativeTime
    duration: Time


@dataclass(frozen=True)
class ClockStep(FaultTargets):
    """A clock of the computer that steps by `step` [s]: everything but that clock goes on as before."""

    kind: Literal["clock_step"]
    at: NonNegativeTime
    step: Annotated[float, Ge(-1000.0), Le(1000.0)]


@dataclass(frozen=True)
class SlowCompute(FaultTargets):
    """A computer that needs `extra` [s] more for each of the next `count` periods."""

    kind: Literal["slow_compute"]
    at: NonNegativeTime
    extra: Time
    count: Count = 1


@dataclass(frozen=True)
class HandRelease(FaultTargets):
    """The hand lets go of the handle."""

    kind: Literal["hand_release"]
    at: NonNegativeTime


@dataclass(frozen=True)
class HandHit(FaultTargets):
    """A blow of the hand: `force` [N], signed, more than it exerts otherwise, for `duration` [s]."""

    kind: Literal["hand_hit"]
    at: NonNegativeTime
    force: Annotated[float, Ge(-1000.0), Le(1000.0)] = 100.0
    duration: Time = 0.02


HostFault = HostLate | HostPaused | ClockStep | SlowCompute
HandFault = HandRelease | HandHit


# Faults of a drive and its node, from an instant on, or from power-on.


@dataclass(frozen=True)
class Emergency(FaultTargets):
    """An emergency message, without any effect on the drive."""

    kind: Literal["emergency"]
    at: NonNegativeTime
    code: ErrorCode


@dataclass(frozen=True)
class DriveFault(FaultTargets):
    """A fault that the drive detects: emergency message, fault reaction, *fault*.

    Its cause lasts for `duration` [s], for which the fault cannot be reset; 0: for an instant.
    """

    kind: Literal["drive_fault"]
    at: NonNegativeTime
    # 2310h: continuous over current.
    code: ErrorCode = 0x2310
    duration: NonNegativeTime | None = 0.0


@dataclass(frozen=True)
class SafeTorqueOff(FaultTargets):
    """Safe torque off opens, and closes after `duration` [s]; torque ends at once."""

    kind: Literal["safe_torque_off"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class NodeReset(FaultTargets):
    """A restart of the node by its watchdog; the boot-up message comes `duration` [s] later."""

    kind: Literal["node_reset"]
    at: NonNegativeTime
    duration: Time = 0.001


@dataclass(frozen=True)
class Silence(FaultTargets):
    """A disconnected cable of the node: it neither sends nor receives."""

    kind: Literal["silence"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class MissingTpdos(FaultTargets):
    """The loss of the next `count` TPDOs inside the node."""

    kind: Literal["missing_tpdos"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class MissingRpdos(FaultTargets):
    """The loss of the next `count` RPDOs inside the node; the drive keeps its last set-point."""

    kind: Literal["missing_rpdos"]
    at: NonNegativeTime
    count: Count | None = None


@dataclass(frozen=True)
class SyncIgnored(FaultTargets):
    """The loss of the next `count` SYNC messages inside the node."""

    kind: Literal["sync_ignored"]
    at: NonNegativeTime
    count: Count | None = None


@dataclass(frozen=True)
class HeartbeatLost(FaultTargets):
    """The end of the node's own heartbeat; everything else continues."""

    kind: Literal["heartbeat_lost"]
    at: NonNegativeTime


@dataclass(frozen=True)
class DuplicateNode(FaultTargets):
    """A second node with the same node-ID joins: whatever this one sends is sent twice."""

    kind: Literal["duplicate_node"]
    at: NonNegativeTime


@dataclass(frozen=True)
class EncoderJump(FaultTargets):
    """A loss or gain of encoder counts."""

    kind: Literal["encoder_jump"]
    at: NonNegativeTime
    counts: Counts


@dataclass(frozen=True)
class PositionStuck(FaultTargets):
    """An encoder that keeps its last counts while the shaft moves."""

    kind: Literal["position_stuck"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class EncoderScaling(FaultTargets):
    """An encoder that counts `factor` times as much for the same motion from here on; negative: backwards."""

    kind: Literal["encoder_scaling"]
    at: NonNegativeTime
    factor: Annotated[float, Ge(-1000.0), Le(1000.0)]


@dataclass(frozen=True)
class EncoderReversed(FaultTargets):
    """An encoder that counts backwards from here on."""

    kind: Literal["encoder_reversed"]
    at: NonNegativeTime


@dataclass(frozen=True)
class TorqueDead(FaultTargets):
    """A current loop that makes no torque any more; the drive reports nothing but the torque actual value 0."""

    kind: Literal["torque_dead"]
    at: NonNegativeTime


@dataclass(frozen=True)
class TorqueSaturated(FaultTargets):
    """A current loop that reaches no more than `share` of rated torque."""

    kind: Literal["torque_saturated"]
    at: NonNegativeTime
    share: Share = 0.1


@dataclass(frozen=True)
class TorqueReversed(FaultTargets):
    """A motor that turns the other way: the current, and the torque actual value, are as commanded."""

    kind: Literal["torque_reversed"]
    at: NonNegativeTime


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
    """A watch on the master that acts `factor` times as late as it was set, None: never."""

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

"""Faults of a drive and its node, from an instant on, or from power-on."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le

from haptic_fieldbus.drive.fields import Counts, NonNegativeTime, Time, UInt32
from haptic_fieldbus.sim.faults.concern import Concern, Count, ErrorCode, Share


@dataclass(frozen=True)
class Emergency(Concern):
    """An emergency message, without any effect on the drive."""

    kind: Literal["emergency"]
    at: NonNegativeTime
    code: ErrorCode


@dataclass(frozen=True)
class DriveFault(Concern):
    """A fault that the drive detects: emergency message, fault reaction, *fault*.

    Its cause lasts for `duration` [s], for which the fault cannot be reset; 0: for an instant.
    """

    kind: Literal["drive_fault"]
    at: NonNegativeTime
    # 2310h: continuous over current.
    code: ErrorCode = 0x2310
    duration: NonNegativeTime | None = 0.0


@dataclass(frozen=True)
class SafeTorqueOff(Concern):
    """Safe torque off opens, and closes after `duration` [s]; torque ends at once."""

    kind: Literal["safe_torque_off"]
    at: NonNegativeTime
    duration: Time | None = None


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
    count: Count = 1


@dataclass(frozen=True)
class MissingRpdos(Concern):
    """The loss of the next `count` RPDOs inside the node; the drive keeps its last set-point."""

    kind: Literal["missing_rpdos"]
    at: NonNegativeTime
    count: Count | None = None


@dataclass(frozen=True)
class SyncIgnored(Concern):
    """The loss of the next `count` SYNC messages inside the node."""

    kind: Literal["sync_ignored"]
    at: NonNegativeTime
    count: Count | None = None


@dataclass(frozen=True)
class HeartbeatLost(Concern):
    """The end of the node's own heartbeat; everything else continues."""

    kind: Literal["heartbeat_lost"]
    at: NonNegativeTime


@dataclass(frozen=True)
class DuplicateNode(Concern):
    """A second node with the same node-ID joins: whatever this one sends is sent twice."""

    kind: Literal["duplicate_node"]
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
class EncoderScaling(Concern):
    """An encoder that counts `factor` times as much for the same motion from here on; negative: backwards."""

    kind: Literal["encoder_scaling"]
    at: NonNegativeTime
    factor: Annotated[float, Ge(-1000.0), Le(1000.0)]


@dataclass(frozen=True)
class EncoderReversed(Concern):
    """An encoder that counts backwards from here on."""

    kind: Literal["encoder_reversed"]
    at: NonNegativeTime


@dataclass(frozen=True)
class TorqueDead(Concern):
    """A current loop that makes no torque any more; the drive reports nothing but the torque actual value 0."""

    kind: Literal["torque_dead"]
    at: NonNegativeTime


@dataclass(frozen=True)
class TorqueSaturated(Concern):
    """A current loop that reaches no more than `share` of rated torque."""

    kind: Literal["torque_saturated"]
    at: NonNegativeTime
    share: Share = 0.1


@dataclass(frozen=True)
class TorqueReversed(Concern):
    """A motor that turns the other way: the current, and the torque actual value, are as commanded."""

    kind: Literal["torque_reversed"]
    at: NonNegativeTime


@dataclass(frozen=True)
class MissingNode(Concern):
    """A node that is absent from the bus."""

    kind: Literal["missing_node"]


@dataclass(frozen=True)
class WrongIdentity(Concern):
    """Another vendor-ID or product code in 1018h."""

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

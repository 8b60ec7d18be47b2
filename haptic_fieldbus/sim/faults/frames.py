"""Faults of the bus: frames that do not arrive as they were sent, other frames, and the controller of the master.

A disturbed frame is on the wire as its sender sent it; what its receivers get is something else, or nothing.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le, Len

from haptic_fieldbus.drive.fields import NonNegativeTime, Time
from haptic_fieldbus.sim.faults.concern import CanId, Concern, Count, Node, Octet

FrameGroup = Literal["tpdo", "rpdo", "sync", "heartbeat", "emergency", "sdo", "nmt"]
"""Frames by their service; SYNC and NMT commands belong to every node, a heartbeat to the one that sends it."""


@dataclass(frozen=True)
class FrameDropped(Concern):
    """The loss of the next `count` frames of a service between sender and receivers."""

    kind: Literal["frame_dropped"]
    at: NonNegativeTime
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameDelayed(Concern):
    """The late arrival of the next `count` frames of a service, by `delay` [s]."""

    kind: Literal["frame_delayed"]
    at: NonNegativeTime
    delay: Time
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameDuplicated(Concern):
    """The next `count` frames of a service arrive twice."""

    kind: Literal["frame_duplicated"]
    at: NonNegativeTime
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameWrongLength(Concern):
    """The next `count` frames of a service arrive with another length: cut off, or filled up with zeros."""

    kind: Literal["frame_wrong_length"]
    at: NonNegativeTime
    length: Annotated[int, Ge(0), Le(8)]
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class FrameWrongNode(Concern):
    """The next `count` frames of a service arrive under the identifier of the node `to`."""

    kind: Literal["frame_wrong_node"]
    at: NonNegativeTime
    to: Node
    frames: FrameGroup = "tpdo"
    count: Count = 1


@dataclass(frozen=True)
class ForeignFrame(Concern):
    """A frame of another program, `count` times, one every `interval` [s]."""

    kind: Literal["foreign_frame"]
    at: NonNegativeTime
    can_id: CanId
    data: Annotated[tuple[Octet, ...], Len(0, 8)] = ()
    count: Count = 1
    interval: Time = 0.001


@dataclass(frozen=True)
class BusOff(Concern):
    """Bus-off of the master's controller: an error frame, then it neither sends nor receives."""

    kind: Literal["bus_off"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class InterfaceDown(Concern):
    """The interface of the master is down: to send and to receive fails with "Network is down"."""

    kind: Literal["interface_down"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class ErrorFrame(Concern):
    """A disturbed frame that the master's controller reports; no frame is lost."""

    kind: Literal["error_frame"]
    at: NonNegativeTime


Disturbance = FrameDropped | FrameDelayed | FrameDuplicated | FrameWrongLength | FrameWrongNode
"""Kinds that act on the way from a sender to its receivers."""
LineFault = Disturbance | ForeignFrame | BusOff | InterfaceDown | ErrorFrame
"""Kinds of the bus, which concern all of its drives at once."""

"""Disturbances of frames on the way from their sender to the receivers.

Each disturbance takes the next frames of one service; the first that wants a frame gets it. What arrives is a list of
frames, each with the time by which it comes later.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from haptic_fieldbus.sim.canopen.link.frame import Frame
from haptic_fieldbus.sim.faults import (
    Disturbance,
    FrameDelayed,
    FrameDropped,
    FrameDuplicated,
    FrameGroup,
    FrameWrongLength,
    FrameWrongNode,
)

_NODE, _FUNCTION = 0x07F, 0x780
# CiA 301, 7.3.5: function codes of the predefined connection set.
_FUNCTIONS: dict[FrameGroup, tuple[int, ...]] = {
    "tpdo": (0x180, 0x280, 0x380, 0x480),
    "rpdo": (0x200, 0x300, 0x400, 0x500),
    "sync": (0x080,),
    "emergency": (0x080,),
    "heartbeat": (0x700,),
    "sdo": (0x580, 0x600),
    "nmt": (0x000,),
}
_BROADCAST: tuple[FrameGroup, ...] = ("sync", "nmt")


@dataclass
class _Active:
    fault: Disturbance
    left: int


class Disturbances:
    """The disturbances that are at work; false when there is none."""

    def __init__(self) -> None:
        self._active: list[_Active] = []

    def __bool__(self) -> bool:
        return bool(self._active)

    def add(self, fault: Disturbance) -> None:
        """Disturb the next frames of a service."""
        self._active.append(_Active(fault, fault.count))

    def arriving(self, frame: Frame) -> Sequence[tuple[int, Frame]]:
        """Return what arrives of a frame: (time by which it is later [ns], frame)."""
        for active in self._active:
            if _concerns(active.fault, frame):
                active.left -= 1
                if not active.left:
                    self._active.remove(active)
                return _disturbed(active.fault, frame)
        return ((0, frame),)


def _concerns(fault: Disturbance, frame: Frame) -> bool:
    function, node = frame.can_id & _FUNCTION, frame.can_id & _NODE
    if frame.extended or frame.remote or function not in _FUNCTIONS[fault.frames]:
        return False
    if fault.frames in _BROADCAST:
        return node == 0
    return node != 0 and fault.node in (None, node)


def _disturbed(fault: Disturbance, frame: Frame) -> Sequence[tuple[int, Frame]]:
    match fault:
        case FrameDropped():
            return ()
        case FrameDelayed(delay=delay):
            return ((round(delay * 1e9), frame),)
        case FrameDuplicated():
            return ((0, frame), (0, frame))
        case FrameWrongLength(length=length):
            return ((0, frame._replace(data=frame.data[:length].ljust(length, b"\0"))),)
        case FrameWrongNode(to=to):
            return ((0, frame._replace(can_id=frame.can_id & _FUNCTION | to)),)

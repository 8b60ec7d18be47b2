"""Signals of an axis, workspaces with their units, and the flags of a link."""

from enum import Enum, IntFlag


class Signal(Enum):
    """Signal of one axis; the value is its name in texts for people."""

    STATUSWORD = "statusword"
    POSITION = "position"
    VELOCITY = "velocity"
    TORQUE_ACTUAL = "torque actual"
    TORQUE_DEMAND = "torque demand"
    """Target torque as the drive has taken it over, after its own limits and before its torque loop."""
    TARGET_ASKED = "target torque asked"
    """Target torque read back from the drive by SDO, at intervals, beside the exchange; the loop never waits for it."""
    ASKED_PERIODS = "periods since asked"
    """Age of TARGET_ASKED in periods, at least 1; 0 in a period without an answer."""
    ELAPSED_NS = "elapsed time"
    """Time since *operation enabled* [ns], a whole number, so that the phase of a wave stays exact after any time."""
    CONTROLWORD = "controlword"
    TARGET_TORQUE = "target torque"


class Workspace(Enum):
    """The space in which an axis of a scene moves: metres and newtons, or radians and newton metres."""

    LINEAR = "linear"
    ROTARY = "rotary"

    @property
    def effort_unit(self) -> str:
        return "N" if self is Workspace.LINEAR else "N·m"

    @property
    def length_unit(self) -> str:
        return "m" if self is Workspace.LINEAR else "rad"

    @property
    def stiffness_unit(self) -> str:
        return f"{self.effort_unit}/{self.length_unit}"

    @property
    def effort_name(self) -> str:
        return "force" if self is Workspace.LINEAR else "torque"


class LinkFlag(IntFlag):
    """State of the link to one axis, written by the bus into the header of the image each period."""

    STALE = 0x01
    """No new process data since the period before."""
    EMERGENCY = 0x02
    """An emergency message arrived; its code is in the header."""
    BOOT_UP = 0x04
    """The node restarted."""
    NO_SIGN_OF_LIFE = 0x08
    """The device's sign of life beside its feedback, such as a heartbeat, is missing."""
    NOT_OPERATIONAL = 0x10
    """The device reported a state in which it takes no part in the exchange."""
    BUS_OFF = 0x20
    """The controller has left the bus."""
    EXCEPTION = 0x40
    """The device answered with an exception (Modbus) or the bus refused a frame."""
    FOREIGN = 0x80
    """Another master commands the drives of this bus; the identifier of the frame is in the header."""
    DUPLICATE = 0x100
    """More feedback arrived than was requested; the identifier of the frame is in the header."""

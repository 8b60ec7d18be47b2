"""The quantities between a drive and a scene, and the units of a workspace."""

from enum import Enum, IntFlag


class Signal(Enum):
    """A quantity of one axis; the value is the name shown to people."""

    STATUSWORD = "statusword"
    POSITION = "position"
    VELOCITY = "velocity"
    TORQUE_ACTUAL = "torque actual"
    ELAPSED_NS = "elapsed time"
    """Since *operation enabled*, in whole nanoseconds: a wave has its exact phase after any time."""
    CONTROLWORD = "controlword"
    TARGET_TORQUE = "target torque"


class Workspace(Enum):
    """What an axis of a scene moves in: metres and newtons, or radians and newton metres."""

    LINEAR = "linear"
    ROTARY = "rotary"

    @property
    def effort_unit(self) -> str:
        return "N" if self is Workspace.LINEAR else "N·m"

    @property
    def length_unit(self) -> str:
        return "m" if self is Workspace.LINEAR else "rad"

    @property
    def effort_name(self) -> str:
        return "force" if self is Workspace.LINEAR else "torque"


class LinkFlag(IntFlag):
    """What a bus says about the link to one axis; written into the image's header each period."""

    STALE = 0x01
    """No new process data since the period before."""
    EMERGENCY = 0x02
    """An emergency message arrived; its code is in the header."""
    BOOT_UP = 0x04
    """The node restarted."""
    NO_SIGN_OF_LIFE = 0x08
    """What the device says of itself between its feedback stayed away."""
    NOT_OPERATIONAL = 0x10
    """The device says that it does not take part in the exchange."""
    BUS_OFF = 0x20
    """The controller has left the bus."""
    EXCEPTION = 0x40
    """The device answered with an exception (Modbus) or the bus refused a frame."""

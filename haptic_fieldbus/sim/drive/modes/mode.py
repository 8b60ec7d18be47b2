"""What a mode of operation is to the drive, and the bits of the statusword that are a mode's own.

Theory (CiA 402-2, controlword and statusword). A mode works while the drive is in *operation enabled*: `start` is
called on entering, `act` whenever something was received, `tick` at the control ticks as long as `ticking` is true. Its
bits stand in `status`. Bit 8 of the controlword, halt, exists in the profile modes and in homing; the cyclic
synchronous modes use no bit of the controlword of their own, so they do not halt.
"""

from haptic_fieldbus.sim.drive.stage import Stage

TARGET_REACHED, INTERNAL_LIMIT, BIT_12, FOLLOWING_ERROR = 0x0400, 0x0800, 0x1000, 0x2000
"""Bits 10, 11, 12 and 13. Bit 12: *drive follows the command value*, *set-point acknowledge*, *speed*, *homing
attained*; bit 13 is *homing error* in homing mode."""
FOLLOWS_COMMAND = BIT_12
NEW_SET_POINT = 0x0010
"""Bit 4 of the controlword, also *homing operation start*."""
_MS = 1_000_000


class Mode:
    """No mode assigned (6061h is 0): no torque."""

    halts = False
    """Whether bit 8 of the controlword stops it."""
    standing = TARGET_REACHED
    """Bits that tell standstill while it is halted."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.status = 0
        self.ticking = False

    def start(self, t_ns: int) -> None:
        """Begin, or go on after a halt: from the motion as it is."""
        self.act(t_ns)

    def act(self, t_ns: int) -> None:
        """Something was received."""
        self.stage.torque(0.0, t_ns)

    def tick(self, t_ns: int) -> None:
        """A control tick."""

    def leave(self) -> None:
        """Another mode follows, or *operation enabled* is left."""

    def act_disabled(self, t_ns: int) -> None:
        """Something was received outside *operation enabled*."""


class Lasting:
    """Whether a condition has held without interruption for a time, as windows and time-outs ask (6066h, 6068h …)."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def restart(self) -> None:
        """As if the condition had just failed."""
        self._since_ns = None

    def __call__(self, condition: bool, t_ns: int, time_ms: int) -> bool:
        """Look at the condition now; whether it has held for `time_ms`."""
        if not condition:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = t_ns
        return t_ns - self._since_ns >= time_ms * _MS

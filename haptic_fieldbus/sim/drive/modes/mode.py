"""The interface of a mode of operation, and the bits of the statusword that belong to the mode.

Theory (CiA 402-2, controlword and statusword). A mode works while the drive is in *operation enabled*: `start` is
called on entering, `act` whenever objects were received, `tick` at the control ticks while `ticking` is True. Its bits
are in `status`. Bit 8 of the controlword, halt, exists in the profile modes and in homing. The cyclic synchronous modes
use no bit of the controlword of their own, so they do not halt.
"""

from haptic_fieldbus.sim.drive.stage import Stage

TARGET_REACHED, INTERNAL_LIMIT, BIT_12, FOLLOWING_ERROR = 0x0400, 0x0800, 0x1000, 0x2000
"""Bits 10, 11, 12 and 13 of the statusword.

Bit 12 is *drive follows the command value*, *set-point acknowledge*, *speed* or *homing attained*, by the mode. Bit 13
is *homing error* in homing mode.
"""
FOLLOWS_COMMAND = BIT_12
NEW_SET_POINT = 0x0010
"""Bit 4 of the controlword, also *homing operation start*."""
_MS = 1_000_000


class Mode:
    """A mode of operation; this base class is mode 0, no mode assigned, without torque."""

    halts = False
    """Whether bit 8 of the controlword halts the mode."""
    standing = TARGET_REACHED
    """Bits that show standstill while the mode is halted."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.status = 0
        self.ticking = False

    def start(self, t_ns: int) -> None:
        """Begin, or continue after a halt, from the present motion."""
        self.act(t_ns)

    def act(self, t_ns: int) -> None:
        """Act on received objects."""
        self.stage.torque(0.0, t_ns)

    def tick(self, t_ns: int) -> None:
        """Run one control tick."""

    def leave(self) -> None:
        """End, because another mode follows or *operation enabled* is left."""

    def act_disabled(self, t_ns: int) -> None:
        """Act on objects received outside *operation enabled*."""


class ConditionTimer:
    """Duration of a condition, for the windows and time-outs of the standard (6066h, 6068h, …)."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def restart(self) -> None:
        """Start anew, as if the condition had just failed."""
        self._since_ns = None

    def __call__(self, condition: bool, t_ns: int, time_ms: int) -> bool:
        """Note the condition at `t_ns`; return whether it has held for `time_ms` without interruption."""
        if not condition:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = t_ns
        return t_ns - self._since_ns >= time_ms * _MS

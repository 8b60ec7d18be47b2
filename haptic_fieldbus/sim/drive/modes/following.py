"""The following error, in the modes that follow a position demand.

Theory (CiA 402-2, 6065h, 6066h, 60F4h): a following error occurs when the difference of position demand and actual
value has been outside the window for the time-out. Bit 13 of the statusword shows it until the difference is inside the
window again. A window of FFFF FFFFh switches the control off. The standard leaves further reactions to the
manufacturer: here a fault, if the settings ask for it.
"""

import math
from collections.abc import Callable

from haptic_fieldbus.sim.drive.modes.mode import FOLLOWING_ERROR, Lasting
from haptic_fieldbus.sim.drive.object_table import NO_LIMIT
from haptic_fieldbus.sim.drive.objects import Objects
from haptic_fieldbus.sim.drive.stage import Stage
from haptic_fieldbus.sim.drive.units import HALF, WRAP, fit


class Following:
    """Monitoring and display of the following error; `failed` is called with the time when one occurs."""

    def __init__(self, stage: Stage, objects: Objects, failed: Callable[[int], None]) -> None:
        self._stage, self._failed = stage, failed
        self._demand, self._error = objects.row(0x6062), objects.row(0x60F4)
        self._window, self._time_out = objects.row(0x6065), objects.row(0x6066)
        self._outside = Lasting()
        self._occurred = False

    def restart(self) -> None:
        """Start with no error, as when the demand is the actual value."""
        self._outside.restart()
        self._occurred = False

    def check(self, angle: float, t_ns: int) -> int:
        """Show demand [rad] and error at a tick; return the bit of the statusword, 0 without a following error."""
        unit = self._stage.units.angle
        error = fit((angle - self._stage.angle()) / unit)
        self._demand.value = wrap(angle / unit)
        self._error.value = error
        window = self._window.value
        outside = window != NO_LIMIT and abs(error) > window
        occurred = self._outside(outside, t_ns, self._time_out.value)
        # Reported once for each occurrence, at its start.
        if occurred and not self._occurred:
            self._failed(t_ns)
        self._occurred = occurred
        return FOLLOWING_ERROR if occurred else 0


def wrap(position: float) -> int:
    """Return a position rounded and wrapped to 32 bits."""
    return (math.floor(position + 0.5) + HALF) % WRAP - HALF


def nearest_turn(target: float, position: float) -> float:
    """Return the position that equals `target` modulo 2³² and is nearest to `position`, which has no end."""
    return position + (target - position + HALF) % WRAP - HALF

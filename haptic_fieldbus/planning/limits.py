"""Limits of an axis, set by the plan and enforced by the cycle, and their defaults."""

import math
from dataclasses import dataclass

FADE_IN = 0.5
"""Time from *operation enabled* to full force [s]."""
SLEW_TIME = 0.005
"""Shortest time in which the command goes from 0 to the effort limit [s]."""
SPEED_LIMIT = {"linear": 2.0, "rotary": 60.0}
"""Limit when the rig states none, by workspace [m/s or rad/s]."""
DRIFT_TURNS = 0.1
"""Limit on the error of an integrated position when the rig states none [revolutions of the motor].

Readings in steps of 1 r/min, each wrong by half a step, reach it after 12 s.
"""


@dataclass(frozen=True)
class EffortLimits:
    """Limits of one axis in its workspace."""

    effort: float
    """[N or N·m]"""
    speed: float
    """[m/s or rad/s]"""
    slew: float
    """Largest change of the effort [N/s or N·m/s]."""
    position: tuple[float, float] | None = None
    """Lower and upper limit [m or rad]; None: not limited."""
    fade_in: float = FADE_IN
    """Time from operation enabled to full force [s]."""
    drift: float = math.inf
    """Largest permitted error of a position that is integrated from velocity [m or rad]."""

"""How far an axis may go: what the plan grants, before any guard of the running cycle."""

import math
from dataclasses import dataclass

FADE_IN = 0.5
"""[s]; from *operation enabled* to full force."""
SLEW_TIME = 0.005
"""[s]; the command needs at least this long from zero to the effort limit."""
SPEED_LIMIT = {"linear": 2.0, "rotary": 60.0}
"""[m/s or rad/s]; where a rig states none."""
DRIFT_TURNS = 0.1
"""Revolutions of the motor that an integrated position may be uncertain by, where a rig states no limit: 12 s of
readings in whole revolutions a minute, each wrong by half of one."""


@dataclass(frozen=True)
class EffortLimits:
    """Limits of one axis in its workspace; `slew` in N/s or N·m/s."""

    effort: float
    speed: float
    slew: float
    position: tuple[float, float] | None = None
    fade_in: float = FADE_IN
    drift: float = math.inf
    """How far a position that is integrated from velocity may be uncertain."""

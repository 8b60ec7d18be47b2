"""An active force: never more power than its largest force times the speed."""

import numpy as np

from haptic_fieldbus.scenes.ramp import Ramp
from tests.scenes.sheet import Motion, Sheet, resting


def largest(ramp: Ramp) -> float:
    return max(abs(ramp.start), abs(ramp.end)) * ramp.envelope.peak


def per_second(ramp: Ramp) -> float:
    """Of the line at the largest level, and of attack and fade at the largest force."""
    steps = ((ramp.attack_level, ramp.attack_time), (ramp.fade_level, ramp.fade_time))
    levels = max(abs(1.0 - level) / time if time else 0.0 for level, time in steps)
    line = abs(ramp.end - ramp.start) / ramp.duration * ramp.envelope.peak
    return line + max(abs(ramp.start), abs(ramp.end)) * levels


def most(ramp: Ramp, motion: Motion) -> float:
    return largest(ramp) * float(np.sum(np.abs(motion.moves)))


SHEET = Sheet(
    examples=(
        Ramp("handle", start=-1.0, end=3.0, duration=0.03),
        Ramp("handle", start=-3.0, end=1.0, duration=0.02, start_delay=0.005),
        Ramp("handle", start=1.0, end=3.0, duration=0.03, attack_level=0.2, attack_time=0.004, fade_time=0.01),
    ),
    steepness=lambda ramp: (0.0, 0.0, per_second(ramp)),
    jump=lambda ramp, speed: largest(ramp),
    continuous=most,
    sampled=most,
    silent=lambda ramp: [resting(0.0, 0.01, period=1e-3)] if ramp.start_delay else [],
    signs=lambda ramp: [(resting(*[0.0] * 7, period=1e-3), 1 if ramp.start + 0.2 * ramp.end > 0.0 else -1)],
)

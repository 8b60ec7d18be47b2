"""An active force: never more power than its largest force times the speed."""

import numpy as np

from haptic_fieldbus.scenes.constant import Constant
from tests.scenes.sheet import Motion, Sheet, resting


def most(constant: Constant, motion: Motion) -> float:
    return constant.envelope.peak * float(np.sum(np.abs(motion.moves)))


def per_second(constant: Constant) -> float:
    """The steeper of attack and fade."""
    steps = (
        (constant.attack_level, constant.attack_time),
        (constant.fade_level, constant.fade_time),
    )
    return max(abs(abs(constant.magnitude) - level) / time if time else 0.0 for level, time in steps)


SHEET = Sheet(
    examples=(
        Constant("handle", magnitude=2.0),
        Constant("handle", magnitude=-2.0, start_delay=0.01, duration=0.02),
        Constant("handle", magnitude=-2.0, start_delay=0.004, duration=0.03, attack_time=0.01, fade_time=0.005),
        Constant("handle", magnitude=2.0, duration=0.03, attack_level=3.0, attack_time=0.01),
    ),
    steepness=lambda constant: (0.0, 0.0, per_second(constant)),
    jump=lambda constant, speed: constant.envelope.peak if constant.needs else 0.0,
    continuous=most,
    sampled=most,
    silent=lambda constant: [resting(0.0, 0.01, period=1e-3)] if constant.start_delay else [],
    signs=lambda constant: [(resting(*[0.0] * 8, period=2e-3), 1 if constant.magnitude > 0.0 else -1)],
)

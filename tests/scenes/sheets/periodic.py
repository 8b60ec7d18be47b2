"""An active force: never more power than its largest force times the speed.

Per second it changes by A·f times the steepest turn of the form, and by the slope of the envelope; square and saws jump
by twice the amplitude, every effect by its whole force where it begins and ends.
"""

from math import pi

import numpy as np

from haptic_fieldbus.scenes.periodic import Periodic
from tests.scenes.sheet import Motion, Sheet, resting

PER_TURN = {"sine": 2.0 * pi, "square": 0.0, "triangle": 4.0, "saw_up": 2.0, "saw_down": 2.0}
JUMPS = {"sine": 0.0, "square": 2.0, "triangle": 0.0, "saw_up": 2.0, "saw_down": 2.0}


def most(wave: Periodic, motion: Motion) -> float:
    return (abs(wave.offset) + wave.envelope.peak) * float(np.sum(np.abs(motion.moves)))


def per_second(wave: Periodic) -> float:
    ends = ((wave.attack_level, wave.attack_time), (wave.fade_level, wave.fade_time))
    slope = max(abs(wave.magnitude - level) / time if time else 0.0 for level, time in ends)
    return wave.envelope.peak * wave.frequency * PER_TURN[wave.waveform] + slope


def jump(wave: Periodic, speed: float) -> float:
    whole = abs(wave.offset) + wave.envelope.peak if wave.start_delay or wave.duration else 0.0
    return max(whole, JUMPS[wave.waveform] * wave.envelope.peak)


def silent(wave: Periodic) -> list[Motion]:
    at_zero = wave.waveform == "sine" and not wave.phase and not wave.offset
    return [resting(0.0, 0.01, period=1e-3)] if wave.start_delay else [resting(0.01)] * at_zero


SHEET = Sheet(
    examples=(
        Periodic("handle", magnitude=2.0, frequency=60.0),
        Periodic("handle", magnitude=2.0, frequency=60.0, waveform="square", offset=0.5),
        Periodic("handle", magnitude=2.0, frequency=60.0, waveform="triangle", phase=0.25, start_delay=0.005),
        Periodic("handle", magnitude=2.0, frequency=60.0, waveform="saw_up", duration=0.03, attack_time=0.01),
        Periodic(
            "handle",
            magnitude=2.0,
            frequency=60.0,
            waveform="saw_down",
            offset=-0.5,
            start_delay=0.002,
            duration=0.03,
            attack_level=3.0,
            attack_time=0.01,
            fade_level=1.0,
            fade_time=0.01,
        ),
    ),
    steepness=lambda wave: (0.0, 0.0, per_second(wave)),
    jump=jump,
    continuous=most,
    sampled=most,
    silent=silent,
)

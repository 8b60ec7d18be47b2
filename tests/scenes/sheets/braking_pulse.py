"""A damper that is on for a while: it takes energy at every instant, and jumps where it begins and ends."""

from math import inf

from haptic_fieldbus.scenes.braking_pulse import BrakingPulse
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, no_energy, passing, resting


def silent(pulse: BrakingPulse) -> list[Motion]:
    """On one side; and crossing from too near."""
    place, near = pulse.position, 0.9 * pulse.rearm
    return [
        resting(place, place),
        passing(place + 0.05, place + 1e-4, 0.5),
        passing(place - 0.05, place - 1e-4, 0.5),
        passing(place - near, place + 0.02, 0.5),
    ]


def signs(pulse: BrakingPulse) -> list[tuple[Motion, int]]:
    place = pulse.position
    return [(passing(place - 0.02, place + 1e-3, 0.5), -1), (passing(place + 0.02, place - 1e-3, 0.5), 1)]


SHEET = Sheet(
    examples=(
        BrakingPulse("handle", damping=10.0, duration=0.02, rearm=0.002),
        BrakingPulse("handle", damping=100.0, duration=0.015, rearm=0.005, position=0.004, saturation=3.0),
    ),
    steepness=lambda pulse: (0.0, pulse.damping, 0.0),
    jump=lambda pulse, speed: min(pulse.damping * speed, pulse.saturation or inf),
    stiffest=lambda pulse: (
        at_once(pulse.position - 2.0 * pulse.rearm, pulse.position + 1e-4, speed=0.01),
        1.0,
    ),
    continuous=no_energy,
    sampled=lambda pulse, motion: damper_leak(pulse.damping, motion),
    silent=silent,
    signs=signs,
)

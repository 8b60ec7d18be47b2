"""A conservative torque: it stores m·g·l·(1 − cos θ); sampled it leaks as a spring of its largest slope does."""

from math import cos, pi

from haptic_fieldbus.scenes.pendulum import Pendulum
from tests.scenes.sheet import Motion, Sheet, at_once, resting, spring_leak


def given(pendulum: Pendulum, motion: Motion) -> float:
    """The potential that it had less the one it has."""
    first, last = motion.position[0] - pendulum.position, motion.position[-1] - pendulum.position
    return float(pendulum.torque * (cos(last) - cos(first)))


SHEET = Sheet(
    examples=(Pendulum("handle", torque=0.2), Pendulum("handle", torque=0.2, position=1.0)),
    steepness=lambda pendulum: (pendulum.torque, 0.0, 0.0),
    stiffest=lambda pendulum: (at_once(pendulum.position), 1.0),
    continuous=given,
    sampled=lambda pendulum, motion: given(pendulum, motion) + spring_leak(pendulum.torque, motion),
    silent=lambda pendulum: [resting(pendulum.position)],
    signs=lambda pendulum: [
        (resting(pendulum.position + turn), -sign)
        for turn, sign in ((0.1, 1), (0.5 * pi, 1), (3.0, 1), (-0.1, -1), (4.0, -1))
    ],
    reach=(0.5, 6.0),
)

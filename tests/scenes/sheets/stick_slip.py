"""A spring on a point that jumps: it takes all that it is given, and its force jumps by one breakaway force."""

from haptic_fieldbus.scenes.stick_slip import StickSlip
from tests.scenes.sheet import Sheet, resting, spring_leak

SHEET = Sheet(
    examples=(
        StickSlip("handle", stiffness=800.0, breakaway=2.0),
        StickSlip("handle", stiffness=2e4, breakaway=0.3),
    ),
    steepness=lambda element: (element.stiffness, 0.0, 0.0),
    jump=lambda element, speed: element.breakaway,
    continuous=lambda element, motion: 0.0,
    sampled=lambda element, motion: spring_leak(element.stiffness, motion),
    silent=lambda element: [resting(0.02, 0.02, 0.02)],
    signs=lambda element: [(resting(0.0, 1e-6), -1), (resting(0.0, -1e-6), 1)],
)

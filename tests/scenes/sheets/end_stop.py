"""A spring and damper beyond either end, nothing between, and never a pull."""

from haptic_fieldbus.scenes.end_stop import EndStop
from tests.scenes.sheet import Sheet, at_once, damper_leak, passing, resting, spring_leak


def stored(stop: EndStop, position: float) -> float:
    """½·K·d² of the penetration."""
    depth = max(0.0, stop.lower - position, position - stop.upper)
    return 0.5 * stop.stiffness * depth**2


SHEET = Sheet(
    examples=(
        EndStop("handle", stiffness=600.0, lower=-0.01, upper=0.02),
        EndStop("handle", stiffness=600.0, lower=-0.01, upper=0.01, damping=3.0),
    ),
    steepness=lambda stop: (stop.stiffness, stop.damping, 0.0),
    jump=lambda stop, speed: stop.damping * speed,
    stiffest=lambda stop: (at_once(stop.upper + 0.01), 1.0),
    continuous=lambda stop, motion: stored(stop, motion.position[0]),
    sampled=lambda stop, motion: (
        stored(stop, motion.position[0]) + spring_leak(stop.stiffness, motion) + damper_leak(stop.damping, motion)
    ),
    silent=lambda stop: [resting(stop.lower, 0.0, stop.upper), passing(stop.lower, stop.upper, 0.7)],
    signs=lambda stop: [(resting(stop.upper + 1e-3), -1), (resting(stop.lower - 1e-3), 1)],
)

"""A spring on a point that is dragged: it takes all that it is given, and leaks sampled as a spring does.

Neither unequal sides nor a dead band add to that: what is stored beyond the dead band, U(s), has a slope of its force
of at most K, so a held force gives at most U before the move − U after it + ½·K·Δx²; dragging, to whichever end of an
interval about s = 0, then only lowers U. U is 0 at the start. The one jump is the fall from breakaway to sliding where
the speed leaves the window, on the stronger side.
"""

from haptic_fieldbus.scenes.friction import Friction
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, passing, resting, spring_leak


def stronger(friction: Friction) -> float:
    """The side of the coefficient 1."""
    return 1.0 if friction.positive_coefficient == 1.0 else -1.0


def silent(friction: Friction) -> list[Motion]:
    """At rest, and in the play of a friction without damping."""
    play, still = 0.99 * friction.dead_band, [resting(0.02, 0.02, 0.02)]
    return [*still, resting(0.0, play, -play, play), passing(0.0, play, 1e-3)] if play else still


def signs(friction: Friction) -> list[tuple[Motion, int]]:
    """While it is moved one way; and once it has left the play towards the stronger side."""
    side = stronger(friction)
    towards_positive = bool(friction.positive_coefficient or friction.damping)
    towards_negative = bool(friction.negative_coefficient or friction.damping)
    return [
        (passing(0.0, 0.05, 0.2), -towards_positive),
        (passing(0.0, -0.05, 0.2), int(towards_negative)),
        (resting(0.0, side * (friction.dead_band + 1e-6)), -int(side)),
    ]


def stiffest(friction: Friction) -> tuple[Motion, float]:
    """Where the play ends, towards the stronger side."""
    side = stronger(friction)
    return at_once(0.0, side * friction.dead_band), side


SHEET = Sheet(
    examples=(
        Friction("handle", coulomb=1.5, stiffness=800.0),
        Friction("handle", coulomb=0.05, stiffness=2e4),
        Friction("handle", coulomb=1.0, stiffness=800.0, damping=2.0),
        Friction("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, window=0.02),
        Friction("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, window=0.02, damping=2.0),
        Friction("handle", coulomb=1.5, stiffness=800.0, negative_coefficient=0.4),
        Friction("handle", coulomb=1.5, stiffness=800.0, dead_band=0.004),
        Friction("handle", 1.0, 800.0, breakaway=2.0, window=0.02, positive_coefficient=0.0, dead_band=0.001),
        Friction("handle", 1.0, 800.0, 2.0, 0.02, damping=2.0, positive_coefficient=0.3),
    ),
    steepness=lambda friction: (friction.stiffness, friction.damping, 0.0),
    stiffest=stiffest,
    jump=lambda friction, speed: max(0.0, friction.breakaway - friction.coulomb),
    continuous=lambda friction, motion: 0.0,
    sampled=lambda friction, motion: spring_leak(friction.stiffness, motion) + damper_leak(friction.damping, motion),
    silent=silent,
    signs=signs,
)

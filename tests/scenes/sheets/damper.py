"""A damper takes energy at every instant; held for a period it gives some where the handle turns."""

from haptic_fieldbus.scenes.damper import Damper
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, no_energy, passing, resting


def stronger(damper: Damper) -> float:
    """The side of the coefficient 1."""
    return 1.0 if damper.positive_coefficient == 1.0 else -1.0


def silent(damper: Damper) -> list[Motion]:
    still = [resting(0.0, 0.02, -0.02)]
    return [*still, passing(-0.01, 0.01, 0.99 * damper.dead_band)] if damper.dead_band else still


def signs(damper: Damper) -> list[tuple[Motion, int]]:
    speed = damper.dead_band + 0.1
    return [
        (passing(0.0, 0.01, speed), -bool(damper.positive_coefficient)),
        (passing(0.0, -0.01, speed), int(bool(damper.negative_coefficient))),
    ]


SHEET = Sheet(
    examples=(
        Damper("handle", damping=4.0),
        Damper("handle", damping=4.0, dead_band=0.1),
        Damper("handle", damping=4.0, positive_saturation=2.0, negative_coefficient=0.5, negative_saturation=1.0),
        Damper("handle", damping=4.0, dead_band=0.05, positive_coefficient=0.0),
    ),
    steepness=lambda damper: (0.0, damper.damping, 0.0),
    stiffest=lambda damper: (at_once(0.0, speed=stronger(damper) * (damper.dead_band + 0.1)), stronger(damper)),
    continuous=no_energy,
    sampled=lambda damper, motion: damper_leak(damper.damping, motion),
    silent=silent,
    signs=signs,
)

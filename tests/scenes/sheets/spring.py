"""A spring stores what it takes and its damping dissipates; saturation only ever lowers what it gives."""

from math import inf

from haptic_fieldbus.scenes.spring import Spring
from tests.scenes.sheet import Motion, Sheet, at_once, damper_leak, passing, resting, spring_leak


def stored(spring: Spring, position: float) -> float:
    """½·K·d² until the saturation s, and s·(d − s/2K) beyond."""
    away = position - spring.position
    share = spring.positive_coefficient if away > 0.0 else spring.negative_coefficient
    limit = (spring.positive_saturation if away > 0.0 else spring.negative_saturation) or inf
    depth, stiffness = max(0.0, abs(away) - spring.dead_band), share * spring.stiffness
    if stiffness * depth <= limit:
        return 0.5 * stiffness * depth**2
    return limit * (depth - 0.5 * limit / stiffness)


def stronger(spring: Spring) -> float:
    """The side of the coefficient 1."""
    return 1.0 if spring.positive_coefficient == 1.0 else -1.0


def silent(spring: Spring) -> list[Motion]:
    edge = spring.dead_band * (1.0 - 1e-9)
    inside = [resting(spring.position + place) for place in (-edge, 0.0, edge)]
    return [*inside, passing(spring.position - edge, spring.position + edge, 0.5)] if edge else inside


def signs(spring: Spring) -> list[tuple[Motion, int]]:
    above = resting(spring.position + spring.dead_band + 1e-3)
    below = resting(spring.position - spring.dead_band - 1e-3)
    return [(above, -bool(spring.positive_coefficient)), (below, int(bool(spring.negative_coefficient)))]


def jump(spring: Spring, speed: float) -> float:
    """At the edges of a dead band, and where sides differ, by the damper's force."""
    uneven = (
        spring.positive_coefficient != spring.negative_coefficient
        or spring.positive_saturation != spring.negative_saturation
    )
    return spring.damping * speed if spring.dead_band or uneven else 0.0


def sampled(spring: Spring, motion: Motion) -> float:
    return (
        stored(spring, motion.position[0]) + spring_leak(spring.stiffness, motion) + damper_leak(spring.damping, motion)
    )


SHEET = Sheet(
    examples=(
        Spring("handle", stiffness=300.0),
        Spring("handle", stiffness=300.0, position=0.005, damping=2.0),
        Spring("handle", stiffness=300.0, dead_band=0.004, positive_saturation=3.0, negative_saturation=1.5),
        Spring("handle", stiffness=300.0, damping=2.0, negative_coefficient=0.4, positive_saturation=3.0),
        Spring("handle", stiffness=300.0, position=-0.01, damping=2.0, dead_band=0.003, positive_coefficient=0.0),
    ),
    steepness=lambda spring: (spring.stiffness, spring.damping, 0.0),
    jump=jump,
    stiffest=lambda spring: (at_once(spring.position + stronger(spring) * (spring.dead_band + 1e-3)), stronger(spring)),
    continuous=lambda spring, motion: stored(spring, motion.position[0]),
    sampled=sampled,
    silent=silent,
    signs=signs,
)

"""A shaft stores what both hands give it, in its twist, and its damping dissipates."""

from math import inf

import numpy as np

from haptic_fieldbus.scenes.coupling import Coupling
from tests.scenes.sheet import Motion, Sheet, damper_leak, spring_leak

AXES = ("left", "right")


def twist(coupling: Coupling, motion: Motion) -> Motion:
    """u = x₁ − n·x₂ along a motion of both."""
    along = np.array([1.0, -coupling.transmission])
    return Motion(motion.period, motion.position @ along, motion.velocity @ along)


def stored(coupling: Coupling, away: float) -> float:
    """½·K·d² beyond the play until the saturation s, and s·(d − s/2K) beyond."""
    limit, depth = coupling.saturation or inf, max(0.0, abs(away) - coupling.dead_band)
    if coupling.stiffness * depth <= limit:
        return 0.5 * coupling.stiffness * depth**2
    return limit * (depth - 0.5 * limit / coupling.stiffness)


def standing(first: float, second: float) -> Motion:
    return Motion(1e-3, np.array([[first, second]]), np.zeros((1, 2)))


def turned_alike(coupling: Coupling) -> Motion:
    """Both axes move as a stiff shaft would let them, the first by what the ratio makes of the second."""
    second = np.linspace(0.0, 0.25, 9)  # of a ratio that is a power of two, the products are exact
    position = np.stack([coupling.transmission * second, second], axis=-1)
    return Motion(1e-3, position, np.zeros_like(position))


def silent(coupling: Coupling) -> list[Motion]:
    """At no twist, and within the play."""
    play = coupling.dead_band * (1.0 - 1e-9)
    return [turned_alike(coupling), standing(0.0, 0.0), standing(play, 0.0), standing(-play, 0.0)]


def largest(coupling: Coupling) -> float:
    return max(1.0, abs(coupling.transmission))


def steepness(coupling: Coupling) -> tuple[float, float, float]:
    """A move of either axis twists by up to max(1, |n|) of it, and both forces are F₁ times 1 and n."""
    return coupling.stiffness * largest(coupling) ** 2, coupling.damping * largest(coupling) ** 2, 0.0


def jump(coupling: Coupling, speed: float) -> float:
    """At the edges of the play, by the damper's force."""
    rate = (1.0 + abs(coupling.transmission)) * speed
    return coupling.damping * rate * largest(coupling) if coupling.dead_band else 0.0


def continuous(coupling: Coupling, motion: Motion) -> float:
    return stored(coupling, twist(coupling, motion).position[0])


def sampled(coupling: Coupling, motion: Motion) -> float:
    along = twist(coupling, motion)
    return (
        stored(coupling, along.position[0])
        + spring_leak(coupling.stiffness, along)
        + damper_leak(coupling.damping, along)
    )


SHEET = Sheet(
    examples=(
        Coupling(AXES, stiffness=300.0),
        Coupling(AXES, stiffness=300.0, damping=2.0, ratio=-2.0),
        Coupling(AXES, stiffness=300.0, damping=2.0, ratio=0.5, dead_band=0.004),
        Coupling(AXES, stiffness=300.0, saturation=3.0, dead_band=0.002),
        Coupling(AXES, stiffness=300.0, damping=2.0, saturation=3.0),
    ),
    steepness=steepness,
    jump=jump,
    stiffest=lambda coupling: (standing(coupling.dead_band + 1e-3, 0.0), 1.0),
    continuous=continuous,
    sampled=sampled,
    silent=silent,
)

"""A device that is more than one mass: a load behind a compliant transmission, a hand that holds the handle.

Motor and encoder are on the first body, the plant; each further one hangs on the one before by a spring and a damper.
A hand adds mass and damping, and hides an instability that appears when it lets go: the limit to quote is that of the
released handle, and the limit of the pair is the smaller of both.

Passivity has no bodies in it. It is asked for *any* passive hand, and seen from the motor, where encoder and torque
are, all that hangs there is one: a passive load on a passive transmission, whatever holds it. So the motor is passive
with all of it up to `passivity.passive_limit_of(plant, …)`, the plant being the motor alone with its own damping. Where
transmission and load lose nothing that is also the most: their motion follows from the motor's and takes no energy. A
loss in them helps only where they move: a load rigidly on the motor may be counted in with mass and damping, and a soft
one may not, although slow motions would bear it.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins.linear import EnvironmentOf, limit_of
from haptic_fieldbus.margins.plant import Plant, check_times, through_torque_loop
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.numerics.sampled import SampledPlant


@dataclass(frozen=True)
class HungBody:
    """A mass [kg] on a spring [N/m] and damper [N·s/m], or their rotary counterparts."""

    mass: float
    stiffness: float
    damping: float = 0.0
    drag: float = 0.0
    """Damping to the ground."""
    anchor: float = 0.0
    """Stiffness to the ground."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0.0 <= value < float("inf"):
                raise UsageError(f"{name} {exactly(value)} of a body: expected a number from 0 up")
        if not self.mass:
            raise UsageError("mass 0 of a body: expected a number above 0")


HAND = HungBody(mass=0.1, stiffness=300.0, damping=4.0)
"""What the simulation's hand holds a linear handle with."""


def dynamics(plant: Plant, bodies: Sequence[HungBody]) -> tuple[Matrix, Matrix]:
    """(A, B) of ξ̇ = A ξ + B F, ξ = (position, velocity) of each, the plant's first."""
    if not plant.mass:
        raise UsageError("mass 0: bodies hang on a mass above 0")
    a = np.zeros((2 * len(bodies) + 2,) * 2)
    masses = [plant.mass, *(body.mass for body in bodies)]
    for place, mass in enumerate(masses):
        a[2 * place, 2 * place + 1] = 1.0
        a[2 * place + 1, 2 * place : 2 * place + 2] -= _to_ground(plant, bodies, place) / mass
    for place, body in enumerate(bodies):
        for mass, here, there in ((masses[place], place, place + 1), (body.mass, place + 1, place)):
            link = np.array([body.stiffness, body.damping]) / mass
            a[2 * here + 1, 2 * here : 2 * here + 2] -= link
            a[2 * here + 1, 2 * there : 2 * there + 2] += link
    b = np.zeros((len(a), 1))
    b[1, 0] = 1.0 / plant.mass
    return a, b


def _to_ground(plant: Plant, bodies: Sequence[HungBody], place: int) -> Matrix:
    """Stiffness and damping to the ground."""
    if place == 0:
        return np.array([0.0, plant.damping])
    return np.array([bodies[place - 1].anchor, bodies[place - 1].drag])


def sample_with(plant: Plant, bodies: Sequence[HungBody], period: float, delay: float) -> SampledPlant:
    """Plant and bodies under the delayed hold, torque loop included; UsageError for a plant with a tachometer."""
    check_times(period, delay)
    if plant.tachometer:
        raise UsageError("a tachometer does not tell where the bodies are: expected a plant whose position is sampled")
    return sampled.sample(*through_torque_loop(*dynamics(plant, bodies), plant.torque_lag), period, delay)


def limit_with(
    plant: Plant, bodies: Sequence[HungBody], period: float, delay: float, environment_of: EnvironmentOf
) -> float:
    """The stiffness [N/m or N·m/rad] up to which the loop with these bodies is stable; 0 or ∞ as ever."""
    device = sample_with(plant, bodies, period, delay)
    return limit_of(
        lambda stiffness: sampled.growth(device, environment_of(stiffness)),
        plant.mass / period**2 + plant.damping / period,
    )

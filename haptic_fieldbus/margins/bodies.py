"""A device of more than one mass: a load behind a compliant transmission, a hand that holds the handle.

Motor and encoder are on the first body, the plant. Each further body is connected to the body before it by a spring and
a damper. A hand adds mass and damping, and hides an instability that appears on release. Quote therefore the limit of
the released handle. A handle that is both held and released has the smaller of both limits.

Passivity does not depend on the bodies. It is required for *any* passive hand. Encoder and torque are at the motor. At
the motor, a passive load on a passive transmission acts as a passive hand, whatever holds the load. The motor is
therefore passive with all bodies up to `passivity.passive_limit_of(plant, …)`, where the plant is the motor alone with
its own damping. When transmission and load have no losses this limit is also the largest possible, because their motion
follows from that of the motor and takes no energy. Their losses help only when they move. A load that is rigidly
connected to the motor may be added to the plant with its mass and damping. A softly connected load may not, although it
helps in slow motions.
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
    """A mass [kg] on a spring [N/m] and damper [N·s/m], or their rotary counterparts.

    Raises UsageError for a value that is not a finite number from 0 up, and for a mass of 0.
    """

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
"""Hand of the simulation on a linear handle."""


def dynamics(plant: Plant, bodies: Sequence[HungBody]) -> tuple[Matrix, Matrix]:
    """Return (A, B) of ξ̇ = A ξ + B F with ξ = (position, velocity) of each body, the plant's first.

    With n bodies beside the plant the shapes are (2n + 2, 2n + 2) and (2n + 2, 1). Raises UsageError for a plant
    without mass.
    """
    if not plant.mass:
        raise UsageError("mass 0: expected a mass above 0 to attach bodies to")
    a = np.zeros((2 * len(bodies) + 2,) * 2)
    masses = [plant.mass, *(body.mass for body in bodies)]
    to_ground = [(0.0, plant.damping), *((body.anchor, body.drag) for body in bodies)]
    for place, mass in enumerate(masses):
        a[2 * place, 2 * place + 1] = 1.0
        a[2 * place + 1, 2 * place : 2 * place + 2] -= np.array(to_ground[place]) / mass
    # A link acts on both its ends, with opposite signs.
    for place, body in enumerate(bodies):
        for mass, here, there in ((masses[place], place, place + 1), (body.mass, place + 1, place)):
            link = np.array([body.stiffness, body.damping]) / mass
            a[2 * here + 1, 2 * here : 2 * here + 2] -= link
            a[2 * here + 1, 2 * there : 2 * there + 2] += link
    b = np.zeros((len(a), 1))
    b[1, 0] = 1.0 / plant.mass
    return a, b


def sample_with(plant: Plant, bodies: Sequence[HungBody], period: float, delay: float) -> SampledPlant:
    """Discretise plant, bodies and torque loop under the delayed hold, `period` and `delay` in s.

    Raises UsageError for impossible times, a plant without mass, and a plant with a tachometer.
    """
    check_times(period, delay)
    if plant.tachometer:
        raise UsageError("a tachometer does not measure the position of bodies: expected a plant with sampled position")
    return sampled.sample(*through_torque_loop(*dynamics(plant, bodies), plant.torque_lag), period, delay)


def limit_with(
    plant: Plant, bodies: Sequence[HungBody], period: float, delay: float, environment_of: EnvironmentOf
) -> float:
    """Return the stiffness [N/m or N·m/rad] up to which the loop with these bodies is stable.

    0 and ∞ have the meaning of `linear.limit_of`. Raises the errors of `sample_with`.
    """
    device, scale = sample_with(plant, bodies, period, delay), plant.mass / period**2 + plant.damping / period
    return limit_of(lambda stiffness: sampled.growth(device, environment_of(stiffness)), scale)

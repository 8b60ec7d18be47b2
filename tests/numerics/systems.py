"""Systems of virtual states that the tests of numerics share."""

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.scenes.sprung_mass import SprungMass

Array = NDArray[np.float64]


def sprung_mass(h: float, period: float = 1e-3, mass: float = 0.5) -> StateSpace:
    """One whose period is h in units of 1/ω."""
    return SprungMass("handle", stiffness=mass * (h / period) ** 2, mass=mass).dynamics


DAMPED = StateSpace(
    a=np.array([[0.0, 1.0], [-900.0, -20.0]]),
    b=np.array([[0.0, 0.0], [900.0, 20.0]]),
    c=np.array([[450.0, 10.0]]),
    d=np.array([[-450.0, -10.0]]),
)
"""Mass 0.5, spring 450 and damper 10 to the puck: needs its velocity."""
GROUNDED = StateSpace(np.array([[-30.0]]), np.array([[30.0, 0.0]]), np.array([[-40.0]]), np.array([[-60.0, 0.0]]))
"""A spring to the ground of which a part gives way: one state, and a force at rest."""
DRIVEN = StateSpace(np.array([[0.0, 1.0], [0.0, -4.0]]), np.array([[0, 0], [0, 4.0]]), np.array([[0, 2.0]]),
                    np.array([[0.0, -2.0]]))  # fmt: skip
"""A free mass dragged along by a damper: where it is does not matter."""
SPACES = {
    "sprung mass": sprung_mass(0.05),
    "damped": DAMPED,
    "grounded": GROUNDED,
    "driven": DRIVEN,
    "two at once": parallel([sprung_mass(0.05), GROUNDED]),
    "memoryless": gain([[-300.0, -2.0]]),
}


def run(space: StateSpace, method: str, period: float, position: Array) -> list[float]:
    """Forces for a sampled position, its velocity by central differences where it matters."""
    step = bind(space, period, method)
    if not space.uses_velocity:
        return [step(x) for x in position.tolist()]
    velocity = np.gradient(position, period)
    return [step(x, v) for x, v in zip(position.tolist(), velocity.tolist(), strict=True)]

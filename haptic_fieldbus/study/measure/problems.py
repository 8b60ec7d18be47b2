"""Environments with a prescribed input, and their exact forces: what a work-precision set is measured on.

Every reference is the exponential of the system (z, w) of environment and input together: exact but for rounding.
"""

from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.exact import expm
from haptic_fieldbus.numerics.integrators.method import Integrator
from haptic_fieldbus.numerics.integrators.staggered import positions
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.loops import Array
from haptic_fieldbus.numerics.response import recursion
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.study.measure.motions import KnownMotion, minimum_jerk, sine, step_by

STIFFNESS, MASS, WAY = 200.0, 0.5, 0.01
"""[N/m], [kg], [m]: the sprung mass of the scene library, ω = 20 rad/s, moved by 10 mm."""
DAMPING = 4.0
"""[N·s/m]: a fifth of critical."""
SOFT, BRANCHES = 300.0, ((400.0, 0.002), (200.0, 0.1))
"""Tissue: the lasting stiffness [N/m]; stiffness and relaxation time [s] of the branches that give way."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A linear environment that starts at rest, and a motion; the force on the handle is what is compared [N]."""

    name: str
    title: str
    space: StateSpace
    motion: KnownMotion
    horizon: float = 1.0
    """[s]"""

    def exact(self, period: float, steps: int) -> Array:
        """Force at 0, T, … steps·T [N], shape (steps + 1,)."""
        order, extra = self.space.order, len(self.motion.start)
        system = np.zeros((order + extra,) * 2)
        system[:order, :order] = self.space.a
        system[:order, order:] = self.space.b @ self.motion.output
        system[order:, order:] = self.motion.system
        start = np.concatenate([np.zeros(order), self.motion.start])
        states = recursion(expm(system * period), np.zeros((steps, order + extra)), start)
        force: Array = states[:, :order] @ self.space.c[0] + states[:, order:] @ (self.space.d @ self.motion.output)[0]
        return force

    def claimed_order(self, method: Integrator) -> float:
        """What the method claims for this input; ∞ where it makes no error at all."""
        order = method.free_order if self.motion.constant else float(method.order)
        if method.name == "semi-implicit" and feels_velocity(self.space):
            return min(order, 1.0)
        return order


def feels_velocity(space: StateSpace) -> bool:
    """Whether accelerations or the force depend on a velocity, where kick-then-drift is late by half a period."""
    velocities = [not position for position in positions(space)]
    return bool(space.a[np.ix_(velocities, velocities)].any() or space.c[:, velocities].any())


def spring(stiffness: float) -> StateSpace:
    """A wall without damping, pressed or pulled."""
    return gain([[-stiffness]])


def sprung_mass(stiffness: float = STIFFNESS, mass: float = MASS) -> StateSpace:
    """The lecture's held puck: a mass behind a spring."""
    return SprungMass("handle", stiffness, mass).dynamics


def damped_mass() -> StateSpace:
    """The same with a damper beside the spring: takes the velocity of the puck too."""
    k, b, m = STIFFNESS, DAMPING, MASS
    return StateSpace(
        np.array([[0.0, 1.0], [-k / m, -b / m]]),
        np.array([[0.0, 0.0], [k / m, b / m]]),
        np.array([[k, b]]),
        np.array([[-k, -b]]),
    )


def free_puck() -> StateSpace:
    """The lecture's free puck: a puck of 0.5 kg pushed by a force, and the sprung mass."""
    return two_masses(MASS, MASS, 0.5 * STIFFNESS)


def two_masses(puck: float, mass: float, stiffness: float) -> StateSpace:
    """A puck pushed by a force, and a mass behind a spring; states (x, v, p, q)."""
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1.0
    a[1, [0, 2]] = -stiffness / puck, stiffness / puck
    a[3, [0, 2]] = stiffness / mass, -stiffness / mass
    b = np.zeros((4, 2))
    b[1, 0] = 1.0 / puck
    return StateSpace(a, b, np.array([[-stiffness, 0.0, stiffness, 0.0]]), np.zeros((1, 2)))


def tissue() -> StateSpace:
    """Generalised Maxwell: F = −K x − Σ k_i (x − d_i), ḋ_i = (x − d_i)/τ_i; one branch is faster than most periods."""
    stiff, tau = np.array(BRANCHES).T
    b = np.column_stack([1.0 / tau, np.zeros(len(tau))])
    return StateSpace(np.diag(-1.0 / tau), b, stiff[None], np.array([[-SOFT - stiff.sum(), 0.0]]))


def problems() -> dict[str, Problem]:
    reach = minimum_jerk(WAY, 1.0)
    every = (
        Problem("sprung-mass-step", "sprung mass, puck moved at once by 10 mm", sprung_mass(), step_by(WAY)),
        Problem("sprung-mass-sine", "sprung mass, puck moved by a sine of 1.5 Hz", sprung_mass(), sine(WAY, 1.5)),
        Problem("sprung-mass-minimum-jerk", "sprung mass, puck moved as a hand reaches", sprung_mass(), reach),
        Problem("damped-mass", "mass on spring and damper, puck moved as a hand reaches", damped_mass(), reach),
        Problem("free-puck", "free puck (four states), pushed with 1 N", free_puck(), step_by(1.0)),
        Problem("tissue", "tissue (Maxwell branches of 2 and 100 ms), pressed as a hand reaches", tissue(), reach),
    )
    return {problem.name: problem for problem in every}


def step_counts(quick: bool) -> tuple[int, ...]:
    """Steps to the horizon: 5 to 5120, the last three a factor of two apart, where orders are read off."""
    return (5, 20, 80, 320, 1280, 2560, 5120) if quick else tuple(5 * 2**power for power in range(11))


def peak(problem: Problem) -> float:
    """The largest exact force [N]."""
    return float(np.abs(problem.exact(problem.horizon / 2000, 2000)).max())

"""Problems of the work-precision sets: environments with a prescribed input, and their exact forces.

Every reference is the free motion of the system (z, w) of environment and input together, which is exact but for
rounding. It is computed by numpy alone, with an exponential that the methods do not share.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from haptic_fieldbus.numerics.batch import Array
from haptic_fieldbus.numerics.integrators import Integrator
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, gain, system_of
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.study.oracles.events import states_of

# Prescribed inputs as autonomous linear systems, so that a reference needs one matrix exponential and no quadrature.
#
# An input is u(t) = W w(t) with ẇ = S w. A constant needs one state, a sine two (sin and cos), and a polynomial of
# degree n needs n + 1, its derivatives.


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """Input (position [m], velocity [m/s]) over time; for a puck or handle that is pushed, (force [N], unused)."""

    system: Matrix
    """S, `(n, n)`."""
    output: Matrix
    """W, `(2, n)`."""
    start: Matrix
    """w(0), `(n,)`."""
    constant: bool = False
    """True if the input is constant from time 0 on."""

    def inputs(self, period: float, steps: int) -> Matrix:
        """Return the input at 0, T, … steps·T, `(steps + 1, 2)`."""
        return states_of(self.system, self.start, period, steps) @ self.output.T


def step_by(height: float) -> KnownMotion:
    """Return a step to `height` at time 0."""
    return KnownMotion(np.zeros((1, 1)), np.array([[height], [0.0]]), np.ones(1), constant=True)


def sine(amplitude: float, frequency: float) -> KnownMotion:
    """Return amplitude·sin(2π·frequency·t), frequency in Hz."""
    turn = 2.0 * math.pi * frequency
    return KnownMotion(
        np.array([[0.0, turn], [-turn, 0.0]]),
        np.array([[amplitude, 0.0], [0.0, amplitude * turn]]),
        np.array([0.0, 1.0]),
    )


def minimum_jerk(travel: float, duration: float) -> KnownMotion:
    """Return the motion of a reaching hand, travel·(10 τ³ − 15 τ⁴ + 6 τ⁵) with τ = t/duration, valid for 0 ≤ τ ≤ 1.

    Source: Flash & Hogan 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985.
    """
    # States are the derivatives by τ; those of order 3 to 5 at τ = 0 are 3!·10, −4!·15 and 5!·6.
    chain = np.diag(np.ones(5), 1) / duration
    derivatives = travel * np.array([0.0, 0.0, 0.0, 60.0, -360.0, 720.0])
    output = np.zeros((2, 6))
    output[0, 0], output[1, 1] = 1.0, 1.0 / duration
    return KnownMotion(chain, output, derivatives)


STIFFNESS, MASS, WAY = 200.0, 0.5, 0.01
"""Stiffness [N/m] and mass [kg] of the library's sprung mass, ω = 20 rad/s, and a motion of 10 mm [m]."""
DAMPING = 4.0
"""[N·s/m]; a fifth of the critical damping."""
SOFT, BRANCHES = 300.0, ((400.0, 0.002), (200.0, 0.1))
"""Lasting stiffness of the tissue [N/m]; stiffness [N/m] and relaxation time [s] of its Maxwell branches."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Linear environment that starts at rest, and a motion; methods are compared by the force on the handle [N]."""

    name: str
    title: str
    space: StateSpace
    motion: KnownMotion
    horizon: float = 1.0
    """Length of a run [s]."""

    def exact(self, period: float, steps: int) -> Array:
        """Return the exact force at 0, T, … steps·T [N], `(steps + 1,)`."""
        order, extra = self.space.order, len(self.motion.start)
        system = np.zeros((order + extra,) * 2)
        system[:order, :order] = self.space.a
        system[:order, order:] = self.space.b @ self.motion.output
        system[order:, order:] = self.motion.system
        states = states_of(system, np.concatenate([np.zeros(order), self.motion.start]), period, steps)
        force: Array = states[:, :order] @ self.space.c[0] + states[:, order:] @ (self.space.d @ self.motion.output)[0]
        return force

    def claimed_order(self, method: Integrator) -> float:
        """Return the order that the method claims for this input; ∞ when it makes no error at all."""
        # A constant input is known between samples too, so only the error of the free motion remains.
        order = method.free_order if self.motion.constant else float(method.order)
        if method.name == "semi-implicit" and feels_velocity(self.space):
            return min(order, 1.0)
        return order


def feels_velocity(space: StateSpace) -> bool:
    """Return whether accelerations or the force depend on a velocity, which kick-then-drift has half a period late."""
    # A position is a state whose rate is another state, and nothing else.
    alone = (np.count_nonzero(space.a, axis=1) == 1) & (space.a == 1.0).any(axis=1) & ~space.b.any(axis=1)
    velocities = np.flatnonzero(~alone)
    return bool(space.a[np.ix_(velocities, velocities)].any() or space.c[:, velocities].any())


def spring(stiffness: float) -> StateSpace:
    """Return a wall without damping, which also pulls."""
    return gain([[-stiffness]])


def sprung_mass(stiffness: float = STIFFNESS, mass: float = MASS) -> StateSpace:
    """Return the held puck of the lecture: a mass behind a spring."""
    return SprungMass("handle", stiffness, mass).dynamics


def damped_mass() -> StateSpace:
    """Return the held puck with a damper beside the spring, which needs the velocity of the puck too."""
    k, b, m = STIFFNESS, DAMPING, MASS
    return system_of([[0.0, 1.0], [-k / m, -b / m]], [[0.0, 0.0], [k / m, b / m]], [[k, b]], [[-k, -b]])


def free_puck() -> StateSpace:
    """Return the free puck of the lecture: a puck of 0.5 kg pushed by a force, and a mass behind a spring."""
    return two_masses(MASS, MASS, 0.5 * STIFFNESS)


def two_masses(puck: float, mass: float, stiffness: float) -> StateSpace:
    """Return a puck pushed by a force, and a mass behind a spring; states (x, v) of the puck, (p, q) of the mass."""
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1.0
    a[1, [0, 2]] = -stiffness / puck, stiffness / puck
    a[3, [0, 2]] = stiffness / mass, -stiffness / mass
    b = np.zeros((4, 2))
    b[1, 0] = 1.0 / puck
    return StateSpace(a, b, np.array([[-stiffness, 0.0, stiffness, 0.0]]), np.zeros((1, 2)))


def tissue() -> StateSpace:
    """Return a generalised Maxwell model: F = −K x − Σ k_i (x − d_i), ḋ_i = (x − d_i)/τ_i.

    One branch is faster than most of the periods tried, which makes the problem stiff.
    """
    stiff, tau = np.array(BRANCHES).T
    b = np.column_stack([1.0 / tau, np.zeros(len(tau))])
    return StateSpace(np.diag(-1.0 / tau), b, stiff[None], np.array([[-SOFT - stiff.sum(), 0.0]]))


def problems() -> dict[str, Problem]:
    """Return all problems by name."""
    reach = minimum_jerk(WAY, 1.0)
    every = (
        Problem("sprung-mass-step", "sprung mass, step of the puck by 10 mm", sprung_mass(), step_by(WAY)),
        Problem("sprung-mass-sine", "sprung mass, sine of the puck at 1.5 Hz", sprung_mass(), sine(WAY, 1.5)),
        Problem("sprung-mass-minimum-jerk", "sprung mass, reaching motion of the puck", sprung_mass(), reach),
        Problem("damped-mass", "mass on spring and damper, reaching motion of the puck", damped_mass(), reach),
        Problem("free-puck", "free puck (four states), pushed with 1 N", free_puck(), step_by(1.0)),
        Problem("tissue", "tissue (Maxwell branches of 2 and 100 ms), pressed as a hand reaches", tissue(), reach),
    )
    return {problem.name: problem for problem in every}


def step_counts(quick: bool) -> tuple[int, ...]:
    """Return the numbers of steps to the horizon, 5 to 5120; the last three differ by 2 each, to show the order."""
    return (5, 20, 80, 320, 1280, 2560, 5120) if quick else tuple(5 * 2**power for power in range(11))


@lru_cache(maxsize=16)
def peak(problem: Problem) -> float:
    """Return the largest exact force of a run [N]."""
    return float(np.abs(problem.exact(problem.horizon / 2000, 2000)).max())

"""Prescribed inputs as autonomous linear systems, so that a reference needs one matrix exponential and no quadrature.

An input is u(t) = W w(t) with ẇ = S w. A constant needs one state, a sine two (sin and cos), and a polynomial of degree
n needs n + 1, its derivatives.
"""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.study.oracles.trajectories import states_of


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
    """True when the input stays as it is from time 0 on."""

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

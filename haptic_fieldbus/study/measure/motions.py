"""Prescribed inputs as autonomous linear systems, so that a reference needs one matrix exponential and no quadrature.

u(t) = W w(t) with ẇ = S w. A constant needs one state, a sine two (sin, cos), a polynomial of degree n its n + 1
derivatives.
"""

import math
from dataclasses import dataclass

import numpy as np

from haptic_fieldbus.numerics.exact import expm
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.numerics.response import recursion


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """An input (position [m], velocity [m/s]) of time; or (force [N], nothing) where a problem says so."""

    system: Matrix
    output: Matrix
    """W, shape (2, n)."""
    start: Matrix
    """w(0), shape (n,)."""
    constant: bool = False

    def inputs(self, period: float, steps: int) -> Matrix:
        """At 0, T, … steps·T: shape (steps + 1, 2)."""
        drive = np.zeros((steps, len(self.start)))
        return recursion(expm(self.system * period), drive, self.start) @ self.output.T


def step_by(height: float) -> KnownMotion:
    """`height` from time 0 on."""
    return KnownMotion(np.zeros((1, 1)), np.array([[height], [0.0]]), np.ones(1), constant=True)


def sine(amplitude: float, frequency: float) -> KnownMotion:
    """amplitude·sin(2π·frequency·t), frequency in Hz."""
    turn = 2.0 * math.pi * frequency
    return KnownMotion(
        np.array([[0.0, turn], [-turn, 0.0]]),
        np.array([[amplitude, 0.0], [0.0, amplitude * turn]]),
        np.array([0.0, 1.0]),
    )


def minimum_jerk(travel: float, duration: float) -> KnownMotion:
    """travel·(10 τ³ − 15 τ⁴ + 6 τ⁵), τ = t/duration, for 0 ≤ τ ≤ 1: how hands reach (Flash & Hogan 1985,
    doi:10.1523/JNEUROSCI.05-07-01688.1985)."""
    chain = np.diag(np.ones(5), 1) / duration
    derivatives = travel * np.array([0.0, 0.0, 0.0, 60.0, -360.0, 720.0])
    output = np.zeros((2, 6))
    output[0, 0], output[1, 1] = 1.0, 1.0 / duration
    return KnownMotion(chain, output, derivatives)

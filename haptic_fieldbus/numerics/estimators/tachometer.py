"""Position from velocity, for a drive that offers velocity only: the trapezoid, x_n = x_{n−1} + T/2·(v_{n−1} + v_n).

H(z) = T·(z + 1)/(2·(z − 1)). Its pole at 1 forgets nothing, which brings two issues:

- Quantisation accumulates. With steps D_v in velocity, rounding to the nearest loses every motion slower than D_v/2
  entirely; rounding down (as an integer division does) is short by D_v/2 on average, so the position drifts by
  −D_v/2·t while the handle moves slowly, and a motion slower than D_v in the positive direction is lost.
- Long steps miss fast motions. A sine of angular frequency ω comes out with (ωT/2)/tan(ωT/2) of its amplitude: nothing
  is left at half the sampling rate, and at the sampling rate itself the tachometer always reads the same phase, so that
  a motion to and fro looks like a steady one and drifts without bound.
"""

import math
from collections.abc import Callable

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.linear import StateSpace


def bind_position(period: float, start: float = 0.0) -> Callable[[float], float]:
    """A fresh step: velocity of this period [m/s or rad/s] → position [m or rad], `start` at the first call."""
    if not 0.0 < period < math.inf:
        raise UsageError(f"period {period:g} s: expected a finite number above 0")
    before: float | None = None
    position, half = start, 0.5 * period

    def step(velocity: float) -> float:
        nonlocal before, position
        if before is not None:
            position += half * (before + velocity)
        before = velocity
        return position

    return step


def position_system(period: float) -> StateSpace:
    """The same as a linear system v_k → x_k, from v = 0 before the first sample."""
    return StateSpace(np.eye(1), np.full((1, 1), period), np.eye(1), np.full((1, 1), 0.5 * period))


def share_of_amplitude(frequency: float, period: float) -> float:
    """Amplitude that is left of a sine of that angular frequency [rad/s], up to half the sampling rate."""
    half = 0.5 * frequency * period
    return half / math.tan(half)


def drift_rate(velocity_step: float) -> float:
    """Mean drift [m/s or rad/s] of a tachometer that rounds its reading down to whole steps [m/s or rad/s]."""
    return -0.5 * velocity_step

"""Position from velocity, for a drive that offers velocity only: the trapezoid, x_n = x_{n−1} + T/2·(v_{n−1} + v_n).

H(z) = T·(z + 1)/(2·(z − 1)). Its pole at 1 forgets nothing, which brings two issues:

- Quantisation accumulates. With steps D_v in velocity, rounding to the nearest loses every motion slower than D_v/2
  entirely; rounding down (as an integer division does) is short by D_v/2 on average, so the position drifts by
  −D_v/2·t while the handle moves slowly, and a motion slower than D_v in the positive direction is lost.
- Long steps miss fast motions. A sine of angular frequency ω comes out with (ωT/2)/tan(ωT/2) of its amplitude: nothing
  is left at half the sampling rate, and at the sampling rate itself the tachometer always reads the same phase, so that
  a motion to and fro looks like a steady one and drifts without bound.

`Integrator` is the trapezoid for a loop that may miss readings, and says how far its position may be off:

- A reading rounded to the nearest step is wrong by at most D_v/2, so a time t by at most D_v/2·t.
- Over a gap of several periods h the trapezoid takes h·(v_0 + v_1)/2. A velocity that goes one way from v_0 to v_1, as
  under the force that is held meanwhile, has its mean between the two, so that the error is at most h·|v_1 − v_0|/2.

What one period misses is not counted. It does not add up under forces that are held from td after each reading: the
velocity has its kinks there, each period is wrong by td·(T − td)/2·(a_k − a_{k−1}), and the sum over any time is
td·(T − td)/2·(a_n − a_0) ≤ T²/8·|a_n − a_0|, 10 µm for a change of 80 m/s² at 1 kHz. Of a motion that is faster than
the sampling the readings tell nothing, and so does the bound.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly


def bind_position(period: float, start: float = 0.0) -> Callable[[float], float]:
    """A fresh step: velocity of this period [m/s or rad/s] → position [m or rad], `start` at the first call."""
    if not 0.0 < period < math.inf:
        raise UsageError(f"period {exactly(period)} s: expected a finite number above 0")
    before: float | None = None
    position, half = start, 0.5 * period

    def step(velocity: float) -> float:
        nonlocal before, position
        if before is not None:
            position += half * (before + velocity)
        before = velocity
        return position

    return step


@dataclass(slots=True)
class VelocityIntegrator:
    """Position [m or rad] from readings [m/s or rad/s] in steps of `velocity_step`; times are [s] since the first."""

    period: float
    velocity_step: float
    position: float = 0.0
    drift: float = 0.0
    """How far the position may be off [m or rad]."""
    _time: float = 0.0
    _velocity: float = 0.0
    _sum: float = 0.0
    """The position at the last reading."""

    def start(self, velocity: float) -> None:
        """The first reading: here is zero."""
        self._velocity = velocity

    def step(self, velocity: float, time: float) -> None:
        """A reading: the trapezoid from the last one on, however long ago that was."""
        passed = time - self._time
        drift = 0.5 * self.velocity_step * passed
        if passed > 1.5 * self.period:
            drift += 0.5 * passed * abs(velocity - self._velocity)
        self._sum = self.position = self._sum + 0.5 * passed * (self._velocity + velocity)
        self.drift += drift
        self._time, self._velocity = time, velocity

    def hold(self, time: float) -> None:
        """No reading came: the last one goes on, until the next replaces what it gave."""
        self.position = self._sum + self._velocity * (time - self._time)

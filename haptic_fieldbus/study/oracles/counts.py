"""A mass with viscous and Coulomb friction at a spring that sees counts of an encoder, in plain numbers.

A hand presses with a constant force. Between two samples the force is constant, so the mass slides in one direction
until it stops, and then rests or slides back: both instants are known in closed form.
"""

import math
from dataclasses import dataclass

from haptic_fieldbus.study.oracles.held import moved_by_force


@dataclass(frozen=True)
class Pressed:
    """Mass [kg], damping [N·s/m], Coulomb friction [N]; spring [N/m], count [m], hand [N]; period [s]."""

    mass: float
    damping: float
    coulomb: float
    stiffness: float
    step: float
    push: float
    period: float
    one_sided: bool = False
    """Whether the spring pushes at positions above 0 only."""
    most: float = math.inf
    """Largest force of the spring [N]."""

    def force(self, x: float) -> float:
        """Return the force on the mass for the count at a position [N]."""
        counted = math.floor(x / self.step + 0.5) * self.step
        spring = self.stiffness * (max(counted, 0.0) if self.one_sided else counted)
        return self.push - min(max(spring, -self.most), self.most)

    def moved(self, x: float, v: float) -> tuple[float, float]:
        """Return position and velocity a period later."""
        force, span = self.force(x), self.period
        while span > 0.0:
            if v == 0.0 and abs(force) <= self.coulomb:
                return x, 0.0
            left = force - math.copysign(self.coulomb, v or force)
            turn = self._turn(v, left)
            x, v = moved_by_force(self, x, v, left, min(turn, span))
            v = 0.0 if turn <= span else v
            span -= turn
        return x, v

    def _turn(self, v: float, left: float) -> float:
        """Return the time until the velocity passes 0 [s]; infinite when it never does."""
        if v * left >= 0.0:
            return math.inf
        return self.mass / self.damping * math.log1p(-v * self.damping / left)

    def rests(self, x: float, v: float, settle: int) -> bool:
        """Return whether the mass has come to rest within so many periods."""
        for _ in range(settle):
            x, v = self.moved(x, v)
            if v == 0.0 and abs(self.force(x)) <= self.coulomb:
                return True
        return False

    def dies(self, start: float) -> bool:
        """Return whether a swing from rest at a place dies; one that grows by half, or falls by half, goes on so."""
        x, v, peak, side = start, 0.0, 0.0, 1.0
        while True:
            x, v = self.moved(x, v)
            if v == 0.0 and abs(self.force(x)) <= self.coulomb:
                return True
            if x * side >= 0.0:
                peak = max(peak, abs(x))
            elif not 0.5 * start < peak < 1.5 * start:
                return peak < start
            else:
                side, peak = -side, abs(x)


def relay_speed(device: Pressed, samples: float) -> float:
    """Return the largest speed of a symmetric cycle over the edge of a count, of so many samples a half [m/s].

    The force is ±K·D/2. The speed goes from −v to +v within a half: v·(1 + e) = K·D/(2·b)·(1 − e), e = e^(−b·n·T/m).
    """
    turn = device.damping * samples * device.period / device.mass
    return 0.5 * device.stiffness * device.step / device.damping * math.tanh(0.5 * turn)

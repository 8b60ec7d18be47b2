"""Two coupled axes for tests: the shaft as the loop runs it, and the same loop written out by hand."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.linalg
import scipy.optimize

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.closed_loop import Axis
from haptic_fieldbus.numerics.coupled import environment, spring_damper
from haptic_fieldbus.numerics.linear import StateSpace
from tests.loops import PERIOD, Array, wall

ESTIMATORS = ("backward-difference", "backward-difference")


def shaft(damping: float = 0.0, ratio: float = 1.0) -> Callable[[float], StateSpace]:
    return lambda stiffness: environment(
        spring_damper(stiffness, damping, ratio), period=PERIOD, method=None, estimators=ESTIMATORS
    )


@dataclass(frozen=True)
class PairByHand:
    """Both axes and the shaft as a simulation, one event after the other; the first axis may have a wall as well."""

    plants: tuple[Plant, Plant]
    delays: tuple[float, float]
    """In periods."""
    damping: float = 0.0
    ratio: float = 1.0
    wall: float = 0.0

    def axes(self) -> list[Axis]:
        own = (wall(self.wall) if self.wall else None, None)
        return [
            Axis(plant, delay * PERIOD, held) for plant, delay, held in zip(self.plants, self.delays, own, strict=True)
        ]

    def period_map(self, stiffness: float) -> Array:
        """State: [x, v, motor force] of each axis, both positions before, both axes' forces, newest first."""
        size = 8 + sum(math.ceil(delay) + 1 for delay in self.delays)
        return np.array([self._one_period(unit, stiffness) for unit in np.eye(size)]).T

    def growth(self, stiffness: float) -> float:
        """Largest modulus, leaving out that both handles may be moved together where no wall holds them."""
        modes = np.linalg.eigvals(self.period_map(stiffness))
        if not self.wall:
            modes = np.delete(modes, np.argmin(np.abs(modes - 1.0)))
        return float(np.abs(modes).max())

    def limit_near(self, stiffness: float) -> float:
        """Where it begins to grow, looked for around a stiffness."""
        found: float = scipy.optimize.brentq(
            lambda value: self.growth(value) - 1.0, 0.8 * stiffness, 1.2 * stiffness, rtol=1e-10
        )
        return found

    def _one_period(self, state: Array, stiffness: float) -> Array:
        positions, before = state[[0, 3]], state[6:8]
        twist = positions[0] - self.ratio * positions[1]
        twist_before = before[0] - self.ratio * before[1]
        torque = -stiffness * twist - self.damping * (twist - twist_before) / PERIOD
        forces = [torque - self.wall * positions[0], -self.ratio * torque]
        first = math.ceil(self.delays[0]) + 1
        queues = [[forces[0], *state[8 : 8 + first]], [forces[1], *state[8 + first :]]]
        moved, now = state[:6], 0.0
        for instant in sorted({*(math.fmod(delay, 1.0) for delay in self.delays), 1.0}):
            acting = [
                queue[math.floor(delay) + (1 if now < math.fmod(delay, 1.0) - 1e-12 else 0)]
                for queue, delay in zip(queues, self.delays, strict=True)
            ]
            moved = motion_over(self.plants, instant - now) @ [*moved, *acting]
            now = instant
        return np.array([*moved, *positions, *queues[0][:-1], *queues[1][:-1]])


@cache
def motion_over(plants: tuple[Plant, Plant], periods: float) -> Array:
    """(x1, v1, f1, x2, v2, f2, targets) → (x1 … f2) after so many periods."""
    system = np.zeros((8, 8))
    for at, target, plant in ((0, 6, plants[0]), (3, 7, plants[1])):
        system[at, at + 1], system[at + 1, at + 1] = 1.0, -plant.damping / plant.mass
        system[at + 1, at + 2 if plant.torque_lag else target] = 1.0 / plant.mass
        if plant.torque_lag:
            system[at + 2, [at + 2, target]] = -1.0 / plant.torque_lag, 1.0 / plant.torque_lag
    moved: Array = scipy.linalg.expm(system * periods * PERIOD)[:6]
    moved[2] *= bool(plants[0].torque_lag)
    moved[5] *= bool(plants[1].torque_lag)
    return moved

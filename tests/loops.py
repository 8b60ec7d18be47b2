"""Haptic loops for tests: environments, the shipped bench, and the same loop written out by hand."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.linalg
import scipy.signal
from numpy.typing import NDArray

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.numerics.sampled import environment
from haptic_fieldbus.scenes.sprung_mass import SprungMass

Array = NDArray[np.float64]
PERIOD = 1e-3
BENCH = Plant(mass=0.6316546816697189, damping=1.5791367041742974, coulomb=0.2513, resolution=0.05 / 4096)
LAG = 1 / (2 * math.pi * 1000)
DELAYS = (0.0, 0.33, 0.5, 1.0, 1.7, 2.0)
"""In periods."""


def wall(stiffness: float, damping: float = 0.0) -> StateSpace:
    return environment(gain([[-stiffness, -damping]]), period=PERIOD, method=None, estimator="backward-difference")


def with_damping(damping: float) -> Callable[[float], StateSpace]:
    return lambda stiffness: wall(stiffness, damping)


def sprung_mass(mass: float, method: str) -> Callable[[float], StateSpace]:
    return lambda stiffness: environment(
        SprungMass("handle", stiffness, mass).dynamics, period=PERIOD, method=method, estimator=None
    )


@dataclass
class ByHand:
    """The same loop as a simulation, one event after the other; its map of unit states gives the eigenvalues."""

    plant: Plant
    delay: float
    stiffness: float
    damping: float = 0.0
    mass: float | None = None
    method: str = ""

    def period_map(self) -> Array:
        """State: [x, v, f, x before, p, q, forces already computed, newest first]."""
        size = 6 + math.ceil(self.delay / PERIOD) + 1
        return np.array([self._one_period(unit) for unit in np.eye(size)]).T

    def growth(self) -> float:
        """Largest modulus, leaving out the shift of everything at once when the environment allows one."""
        modes = np.linalg.eigvals(self.period_map())
        if self.mass is not None:
            modes = np.delete(modes, np.argmin(np.abs(modes - 1.0)))
        return float(np.abs(modes).max())

    def _one_period(self, state: Array) -> Array:
        x, before, p, q = state[0], state[3], state[4], state[5]
        if self.mass is None:
            p, q, force = 0.0, 0.0, -self.stiffness * x - self.damping * (x - before) / PERIOD
        else:
            p, q, force = self._virtual(p, q, before, x)
        forces = [force, *state[6:]]
        whole = math.floor(self.delay / PERIOD + 1e-9)
        switch = self.delay - whole * PERIOD
        moved = self._move(state[:3], forces[whole + 1], switch)
        moved = self._move(moved, forces[whole], PERIOD - switch)
        return np.array([*moved, x, p, q, *forces[:-1]])

    def _virtual(self, p: float, q: float, before: float, x: float) -> tuple[float, float, float]:
        """p and q are stored as of the sample before; the method brings them to this one."""
        assert self.mass is not None
        square = self.stiffness / self.mass
        if self.method == "forward-euler":
            p, q = p + PERIOD * q, q + PERIOD * square * (before - p)
        else:
            system = (np.array([[0.0, 1.0], [-square, 0.0]]), np.array([[0.0], [square]]), np.eye(2), np.zeros((2, 1)))
            a, _, _, after, _ = scipy.signal.cont2discrete(system, PERIOD, method="foh")
            held = scipy.signal.cont2discrete(system, PERIOD, method="zoh")[1]
            p, q = a @ [p, q] + held[:, 0] * before + after[:, 0] * (x - before)
        return p, q, self.stiffness * (p - x)

    def _move(self, motion: Array, force: float, span: float) -> Array:
        end: Array = motion_over(self.plant, span) @ [*motion, force]
        return end


@cache
def motion_over(plant: Plant, span: float) -> Array:
    """(x, v, f, target) → (x, v, f) after the span."""
    lag = plant.torque_lag
    system = np.zeros((4, 4))
    system[0, 1], system[1, 1] = 1.0, -plant.damping / plant.mass
    system[1, 2 if lag else 3] = 1.0 / plant.mass
    if lag:
        system[2, 2:] = -1.0 / lag, 1.0 / lag
    moved: Array = scipy.linalg.expm(system * span)[:3]
    moved[2] *= bool(lag)
    return moved

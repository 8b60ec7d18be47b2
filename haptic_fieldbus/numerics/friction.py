"""A mass with viscous damping and Coulomb friction under a constant force, exactly, many at once.

Slipping in direction s with the force F, m·v′ = G − b·v, G = F − fc·s. With u = −b·v/G the handle stands after
t = −m·v/G·ln(1 + u)/u, having gone m·v²/G·(ln(1 + u) − u)/u². It then sticks when |F| ≤ fc, else it slips to where F
pushes, and does not stop again. From rest over t, with w = b·t/m, it gains G·t/m·(1 − e⁻ʷ)/w and goes
G·t²/m·(w − 1 + e⁻ʷ)/w². The quotients are written as series where u and w are small.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SMALL = 0.02
"""Below, nine terms of a series have all digits."""
TERMS = 9


@dataclass(frozen=True, eq=False)
class SampledMass:
    """Mass [kg], damping [N·s/m] and Coulomb friction [N], or their rotary counterparts; shape (n,) each."""

    mass: Array
    damping: Array
    coulomb: Array

    def part(self, rows: NDArray[np.bool_]) -> "SampledMass":
        return SampledMass(self.mass[rows], self.damping[rows], self.coulomb[rows])


def slide(device: SampledMass, position: Array, velocity: Array, force: Array, span: Array) -> tuple[Array, Array]:
    """Position and velocity after `span` [s] under a constant force; all shapes (n,)."""
    pushes = np.sign(force) * (np.abs(force) > device.coulomb)
    direction = np.where(velocity != 0.0, np.sign(velocity), pushes)
    net = np.where(direction != 0.0, force - direction * device.coulomb, 0.0)
    x, v = _slip(device, position, velocity, net, span)
    reverses = (velocity != 0.0) & (v * direction < 0.0)
    if reverses.any():
        x[reverses], v[reverses] = _through_rest(
            device.part(reverses), position[reverses], velocity[reverses], force[reverses], span[reverses]
        )
    return x, v


def _through_rest(device: SampledMass, x: Array, v: Array, force: Array, span: Array) -> tuple[Array, Array]:
    """To a standstill within the span, and on from there."""
    net = force - np.sign(v) * device.coulomb
    u = -device.damping * v / net
    duration = -device.mass * v / net * _logarithm(u)
    stop = x + device.mass * v**2 / net * _logarithm_rest(u)
    pushes = np.sign(force) * (np.abs(force) > device.coulomb)
    onwards = np.where(pushes != 0.0, force - pushes * device.coulomb, 0.0)
    return _slip(device, stop, np.zeros_like(v), onwards, np.maximum(span - duration, 0.0))


def _slip(device: SampledMass, x: Array, v: Array, net: Array, span: Array) -> tuple[Array, Array]:
    w = device.damping * span / device.mass
    first, second = _mean_decay(w), _mean_decay_rest(w)
    rate = net * span / device.mass
    return x + span * (first * v + second * rate), v + first * (rate - w * v)


def _series(x: Array, factors: Array) -> Array:
    total = np.full_like(x, factors[-1])
    for factor in factors[-2::-1]:
        total = total * x + factor
    return total


_N = np.arange(TERMS)
_SIGNS = np.where(_N % 2, -1.0, 1.0)
_FACTORIALS = np.cumprod(np.concatenate([[1.0], np.arange(1.0, TERMS + 2)]))


def _choose(x: Array, small: Array, large: Array) -> Array:
    return np.where(np.abs(x) < SMALL, small, large)


def _logarithm(u: Array) -> Array:
    """ln(1 + u)/u"""
    safe = np.where(np.abs(u) < SMALL, 1.0, u)
    return _choose(u, _series(u, _SIGNS / (_N + 1)), np.log1p(safe) / safe)


def _logarithm_rest(u: Array) -> Array:
    """(ln(1 + u) − u)/u²"""
    safe = np.where(np.abs(u) < SMALL, 1.0, u)
    return _choose(u, _series(u, -_SIGNS / (_N + 2)), (np.log1p(safe) - safe) / safe**2)


def _mean_decay(w: Array) -> Array:
    """(1 − e⁻ʷ)/w"""
    safe = np.where(w < SMALL, 1.0, w)
    return _choose(w, _series(w, _SIGNS / _FACTORIALS[1 : TERMS + 1]), -np.expm1(-safe) / safe)


def _mean_decay_rest(w: Array) -> Array:
    """(w − 1 + e⁻ʷ)/w²"""
    safe = np.where(w < SMALL, 1.0, w)
    return _choose(w, _series(w, _SIGNS / _FACTORIALS[2 : TERMS + 2]), (safe + np.expm1(-safe)) / safe**2)

"""Exact motion of a mass with viscous damping and Coulomb friction under a constant force, for many masses at once.

A mass that slips in the direction s under the force F follows m·v′ = G − b·v with G = F − fc·s. With u = −b·v/G it
comes to rest after the time t = −m·v/G·ln(1 + u)/u, at the distance m·v²/G·(ln(1 + u) − u)/u². It then sticks when |F|
≤ fc. Otherwise it slips in the direction of F and does not stop again. From rest, with w = b·t/m, it gains the velocity
G·t/m·(1 − e⁻ʷ)/w and moves by G·t²/m·(w − 1 + e⁻ʷ)/w². For small u and w the quotients are computed as series.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SMALL = 0.02
"""Largest argument of the series; below it nine terms give all digits."""
TERMS = 9


@dataclass(frozen=True, eq=False)
class SampledMass:
    """Many masses: mass [kg], damping [N·s/m] and Coulomb friction [N], or the rotary counterparts; shape (n,) each."""

    mass: Array
    damping: Array
    coulomb: Array

    def part(self, rows: NDArray[np.bool_]) -> "SampledMass":
        """Return the masses for which `rows`, shape (n,), is true."""
        return SampledMass(self.mass[rows], self.damping[rows], self.coulomb[rows])


def slide(device: SampledMass, position: Array, velocity: Array, force: Array, span: Array) -> tuple[Array, Array]:
    """Return position and velocity after `span` [s] under a constant force; all arrays (n,)."""
    pushes = np.sign(force) * (np.abs(force) > device.coulomb)
    # A mass at rest moves only when the force exceeds friction; direction 0 means that it sticks.
    direction = np.where(velocity != 0.0, np.sign(velocity), pushes)
    net = np.where(direction != 0.0, force - direction * device.coulomb, 0.0)
    x, v = _slip(device, position, velocity, net, span)
    # A mass whose velocity has reversed came to rest within the span, and friction changed its sign there.
    reverses = (velocity != 0.0) & (v * direction < 0.0)
    if reverses.any():
        x[reverses], v[reverses] = _through_rest(
            device.part(reverses), position[reverses], velocity[reverses], force[reverses], span[reverses]
        )
    return x, v


def _through_rest(device: SampledMass, x: Array, v: Array, force: Array, span: Array) -> tuple[Array, Array]:
    """Return position and velocity of masses that come to rest within the span."""
    net = force - np.sign(v) * device.coulomb
    u = -device.damping * v / net
    duration = -device.mass * v / net * _logarithm(u)
    stop = x + device.mass * v**2 / net * _logarithm_rest(u)
    pushes = np.sign(force) * (np.abs(force) > device.coulomb)
    onwards = np.where(pushes != 0.0, force - pushes * device.coulomb, 0.0)
    return _slip(device, stop, np.zeros_like(v), onwards, np.maximum(span - duration, 0.0))


def _slip(device: SampledMass, x: Array, v: Array, net: Array, span: Array) -> tuple[Array, Array]:
    """Return position and velocity under the force `net`, friction included, without a change of direction."""
    w = device.damping * span / device.mass
    first, second = _mean_decay(w), _mean_decay_rest(w)
    rate = net * span / device.mass
    return x + span * (first * v + second * rate), v + first * (rate - w * v)


def _series(x: Array, factors: Array) -> Array:
    """Return the polynomial with these factors, the constant first."""
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
    """Return ln(1 + u)/u."""
    # Here and below, small arguments are replaced before the division, as `np.where` evaluates both branches.
    safe = np.where(np.abs(u) < SMALL, 1.0, u)
    return _choose(u, _series(u, _SIGNS / (_N + 1)), np.log1p(safe) / safe)


def _logarithm_rest(u: Array) -> Array:
    """Return (ln(1 + u) − u)/u²."""
    safe = np.where(np.abs(u) < SMALL, 1.0, u)
    return _choose(u, _series(u, -_SIGNS / (_N + 2)), (np.log1p(safe) - safe) / safe**2)


def _mean_decay(w: Array) -> Array:
    """Return (1 − e⁻ʷ)/w."""
    safe = np.where(w < SMALL, 1.0, w)
    return _choose(w, _series(w, _SIGNS / _FACTORIALS[1 : TERMS + 1]), -np.expm1(-safe) / safe)


def _mean_decay_rest(w: Array) -> Array:
    """Return (w − 1 + e⁻ʷ)/w²."""
    safe = np.where(w < SMALL, 1.0, w)
    return _choose(w, _series(w, _SIGNS / _FACTORIALS[2 : TERMS + 2]), (safe + np.expm1(-safe)) / safe**2)

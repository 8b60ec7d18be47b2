"""Haptic loops simulated from event to event, many at once; numpy alone, and nothing of the package.

Between two events, a sample, a new force or the end of a slip, device and hand are linear under a constant force. The
forces are in `laws`. All arrays are (n,), a value for each loop. What a period costs is mostly calls, so that ten times
the loops take some twice the time.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.margins.laws import Array, Law

Moved = tuple[Array, Array, Array]
"""Position, velocity and force of the motor."""


def exponential(matrix: Array) -> Array:
    """e^M of a stack of matrices (n, m, m), by scaling and squaring of its series."""
    norm = max(float(np.abs(matrix).sum(axis=2).max()), 1e-300)
    halvings = max(0, math.ceil(math.log2(norm)) + 3)
    small = matrix / 2.0**halvings
    term = total = np.broadcast_to(np.eye(matrix.shape[1]), matrix.shape).copy()
    for order in range(1, 14):
        term = term @ small / order
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


class Hold:
    """Delayed forces: from a sample on the older of two acts, from the fraction of the delay on the newer one."""

    def __init__(self, delay: Array, period: float, first: Array) -> None:
        whole = np.floor(delay / period + 1e-9).astype(int)
        self.rest = np.maximum(delay - whole * period, 0.0)
        self._kept = np.tile(first, (int(whole.max()) + 2, 1))  # the handle rested here before
        columns, count = np.arange(len(first)), len(self._kept)
        ages = [[(now - whole - older) % count * len(first) + columns for older in (1, 0)] for now in range(count)]
        self._ages, self._now = ages, 0

    def take(self, force: Array) -> tuple[Array, Array]:
        """Take the force of a new sample and return the two forces that act until the next one."""
        self._now = (self._now + 1) % len(self._kept)
        self._kept[self._now] = force
        older, newer = self._ages[self._now]
        return self._kept.take(older), self._kept.take(newer)


@dataclass
class Bench:
    """Devices under a delayed hold, and hands: a mass and a spring that hold on to the handle, and a constant push."""

    mass: Array
    damping: Array
    period: float
    delay: Array
    lag: Array
    """0 where the torque is ideal."""
    effort: Array
    coulomb: Array
    """With Coulomb friction anywhere there is no lag and no spring of a hand."""
    resolution: Array
    hand_mass: Array
    hand_stiffness: Array
    push: Array

    def run(self, law: Law, x: Array, v: Array, periods: int, windows: int) -> tuple[Array, Array]:
        """Return the largest distance from the start in each window, (windows, n), and the energy in the last, (n,)."""
        start, before = x, self._read(x)
        law.relax(x)
        motor = np.clip(law.force(before, np.zeros(len(x))), -self.effort, self.effort)
        hold = Hold(self.delay, self.period, motor)
        advance = (self._slipping if self.coulomb.any() else self._linear)(start, hold.rest)
        reach, energy = np.zeros((windows, len(x))), np.zeros(len(x))
        each = periods // windows
        for count in range(each * windows):
            seen = self._read(x)
            force = np.clip(law.force(seen, (seen - before) / self.period), -self.effort, self.effort)
            before = seen
            x, v, motor = advance((x, v, motor), *hold.take(force))
            at = count // each
            np.maximum(reach[at], np.abs(x - start), out=reach[at])
            if at == windows - 1:
                held = 0.5 * self._total * v**2 + 0.5 * self.hand_stiffness * (x - start) ** 2 - self.push * (x - start)
                energy = np.maximum(energy, held)
        return reach, energy

    def speeds(self, law: Law, x: Array, v: Array, periods: int, last: int, parts: int = 8) -> tuple[Array, Array]:
        """Return ∫v² and ∫|v| over the `last` of the periods, from `parts` readings of v in each span, (n,) each."""
        before, n = self._read(x), len(x)
        law.relax(x)
        motor = np.clip(law.force(before, np.zeros(n)), -self.effort, self.effort)
        hold = Hold(self.delay, self.period, motor)
        spans = (hold.rest, self.period - hold.rest)
        squares, ways = np.zeros(n), np.zeros(n)
        for count in range(periods):
            seen = self._read(x)
            force = np.clip(law.force(seen, (seen - before) / self.period), -self.effort, self.effort)
            before, is_watched = seen, count >= periods - last
            share = parts if is_watched else 1
            for span, command in zip(spans, hold.take(force), strict=True):
                for _ in range(share):
                    fast = np.abs(v)
                    x, v = self._slip(span / share, x, v, command)
                    squares += is_watched * 0.5 * span / share * (fast**2 + v**2)
                    ways += is_watched * 0.5 * span / share * (fast + np.abs(v))
        return squares, ways

    @property
    def _total(self) -> Array:
        return self.mass + self.hand_mass

    def _read(self, x: Array) -> Array:
        if not self.resolution.any():
            return x
        step = np.where(self.resolution > 0.0, self.resolution, 1.0)
        return np.where(self.resolution > 0.0, step * np.round(x / step), x)

    def _linear(self, start: Array, rest: Array) -> Callable[[Moved, Array, Array], Moved]:
        """Return a step of a whole period without Coulomb friction."""
        first, second = self._transition(rest), self._transition(self.period - rest)
        both = second[:, :3, :3] @ first[:, :3]
        both[:, :, 4] += second[:, :3, 4]
        pushed = (both[:, :, 4] * self.push[:, None]).T
        # (x − start, v, f, older, newer) → (x − start, v, f), the loops last
        whole = np.concatenate([both[:, :, :4], second[:, :3, 3:4]], axis=2).transpose(1, 2, 0).copy()
        state = np.zeros((5, len(start)))

        def advance(moved: Moved, older: Array, newer: Array) -> Moved:
            state[0], state[1], state[2], state[3], state[4] = moved[0] - start, moved[1], moved[2], older, newer
            end = np.einsum("ijn,jn->in", whole, state) + pushed
            return end[0] + start, end[1], end[2]

        return advance

    def _slipping(self, start: Array, rest: Array) -> Callable[[Moved, Array, Array], Moved]:
        """Return a step of a whole period with Coulomb friction."""

        def advance(moved: Moved, older: Array, newer: Array) -> Moved:
            x, v = self._slip(rest, moved[0], moved[1], older)
            return *self._slip(self.period - rest, x, v, newer), newer

        return advance

    def _transition(self, span: Array) -> Array:
        """(x − start, v, f, command, push) over a span, (n, 5, 5); without lag f is not used."""
        system = np.zeros((len(self.mass), 5, 5))
        system[:, 0, 1] = 1.0
        system[:, 1, 0] = -self.hand_stiffness / self._total
        system[:, 1, 1] = -self.damping / self._total
        system[:, 1, 4] = 1.0 / self._total
        lagging = self.lag > 0.0
        system[:, 1, 2] = np.where(lagging, 1.0 / self._total, 0.0)
        system[:, 1, 3] = np.where(lagging, 0.0, 1.0 / self._total)
        rate = np.where(lagging, 1.0 / np.where(lagging, self.lag, 1.0), 0.0)
        system[:, 2, 2], system[:, 2, 3] = -rate, rate
        return exponential(system * span[:, None, None])

    def _slip(self, span: Array, x: Array, v: Array, command: Array) -> tuple[Array, Array]:
        """Return position and velocity after a span: slip up to a stop, then stick or turn."""
        drive, rate = command + self.push, self.damping / self._total
        x, v, left = _slid(x, v, drive, self.coulomb, self.damping, rate, span)
        # Where a slip ended the handle sticks, or turns and slips on to the end.
        (turned,) = np.nonzero((left > 0.0) & (np.abs(drive) > self.coulomb))
        if len(turned):
            of = [each[turned] for each in (x, v, drive, self.coulomb, self.damping, rate, left)]
            x[turned], v[turned], _ = _slid(*of)
        return x, v


def _slid(x: Array, v: Array, drive: Array, coulomb: Array, damping: Array, rate: Array, left: Array) -> Moved:
    """Return position, velocity and the time that is left after the first stop."""
    moving = v != 0.0
    held = ~moving & (np.abs(drive) <= coulomb)
    sign = np.where(moving, np.sign(v), np.sign(drive))
    net = drive - sign * coulomb
    final = net / damping
    # v(t) = final + (v − final)·e^(−rate·t); it stops where that is 0, if net is against the motion.
    with np.errstate(divide="ignore", invalid="ignore"):
        stop = np.log((final - v) / final) / rate
    stop = np.where(moving & (sign * net < 0.0) & np.isfinite(stop), stop, np.inf)
    time = np.where(held, 0.0, np.minimum(left, stop))
    decay: NDArray[np.float64] = -np.expm1(-rate * time)
    x = x + final * time + (v - final) * decay / rate
    v = np.where(held | (stop <= left), 0.0, final + (v - final) * (1.0 - decay))
    return x, v, np.where(held, 0.0, left - time)

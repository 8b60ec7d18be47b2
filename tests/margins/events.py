"""Haptic loops simulated from event to event, many at once; numpy alone, and nothing of the package.

Between two events, a sample, a new force or the end of a slip, device and hand are linear under a constant force. The
laws are written out again here from their formulas. All arrays are (n,), a value for each loop.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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


@dataclass
class Law:
    """A sum of forces, each with parameters (n,); one whose size is 0 gives none."""

    n: int
    hinges: list[tuple[Array, Array, Array, Array]] = field(default_factory=list)
    """(edge, side, stiffness, damping): pushes out of the material, never pulls."""
    crossleys: list[tuple[Array, Array, Array, Array, Array]] = field(default_factory=list)
    """(edge, side, k, exponent, loss)"""
    waves: list[tuple[Array, Array, Array]] = field(default_factory=list)
    """(middle, amplitude, pitch) of −A·sin(2π·(x − middle)/p)"""
    magnets: list[tuple[Array, Array, Array]] = field(default_factory=list)
    """(middle, stiffness, radius)"""
    springs: list[tuple[Array, Array, Array, Array, Array]] = field(default_factory=list)
    """(middle, stiffness, damping, dead band, saturation)"""
    frictions: list[tuple[Array, Array, Array]] = field(default_factory=list)
    """(stiffness, Coulomb force, damping)"""

    def __post_init__(self) -> None:
        self.anchors: list[Array] = []

    def relax(self, position: Array) -> None:
        """Put the stick points of all frictions to where the handle is."""
        self.anchors = [position.copy() for _ in self.frictions]

    def force(self, x: Array, v: Array) -> Array:
        total = np.zeros(self.n)
        for edge, side, stiffness, damping in self.hinges:
            depth = side * (x - edge)
            total -= side * np.where(depth > 0.0, np.maximum(stiffness * depth + damping * side * v, 0.0), 0.0)
        for edge, side, k, exponent, loss in self.crossleys:
            depth = np.maximum(side * (x - edge), 0.0)
            total -= side * k * depth**exponent * np.maximum(1.0 + loss * side * v, 0.0)
        for middle, amplitude, pitch in self.waves:
            total -= amplitude * np.sin(2.0 * np.pi * (x - middle) / pitch)
        for middle, stiffness, radius in self.magnets:
            u = (x - middle) / radius
            total -= np.where(np.abs(u) < 1.0, stiffness * radius * u * (1.0 - u * u) ** 2, 0.0)
        for middle, stiffness, damping, band, saturation in self.springs:
            away = x - middle
            beyond = np.sign(away) * np.maximum(np.abs(away) - band, 0.0)
            push = stiffness * beyond + np.where(np.abs(away) > band, damping * v, 0.0)
            total -= np.clip(push, -saturation, saturation)
        for place, (stiffness, coulomb, damping) in enumerate(self.frictions):
            longest = coulomb / np.maximum(stiffness, 1e-300)
            stretch = np.clip(x - self.anchors[place], -longest, longest)
            self.anchors[place] = x - stretch
            total -= stiffness * stretch + damping * v
        return total

    def at_rest(self, x: Array) -> Array:
        """The force on a handle at rest with all frictions relaxed."""
        kept = self.anchors
        self.relax(x)
        force = self.force(x, np.zeros(self.n))
        self.anchors = kept
        return force


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
    resolution: Array
    hand_mass: Array
    hand_stiffness: Array
    push: Array
    velocity_by: Any = None

    def run(self, law: Law, x: Array, v: Array, periods: int, windows: int) -> tuple[Array, Array]:
        """Return the largest distance from the start and the largest energy in each window, (windows, n) each."""
        start, n, period = x.copy(), len(x), self.period
        whole = np.floor(self.delay / period + 1e-9).astype(int)
        rest = np.maximum(self.delay - whole * period, 0.0)
        queue = [np.zeros(n) for _ in range(int(whole.max()) + 2)]
        law.relax(x)
        seen = self._read(x)
        first = np.clip(law.force(seen, np.zeros(n)), -self.effort, self.effort)
        queue = [first.copy() for _ in queue]  # the handle rested here before
        before, motor = seen, first.copy()
        steps = [self._transition(rest), self._transition(period - rest)]
        reach, energy = np.zeros((windows, n)), np.zeros((windows, n))
        total = self.mass + self.hand_mass
        each = periods // windows
        rows = np.arange(n)
        for count in range(each * windows):
            seen = self._read(x)
            force = np.clip(law.force(seen, (seen - before) / period), -self.effort, self.effort)
            before = seen
            queue = [force, *queue[:-1]]
            stack = np.array(queue)
            for step, span, age in ((steps[0], rest, whole + 1), (steps[1], period - rest, whole)):
                x, v, motor = self._move(step, span, x, v, motor, stack[age, rows], start)
            at = count // each
            reach[at] = np.maximum(reach[at], np.abs(x - start))
            held = 0.5 * total * v**2 + 0.5 * self.hand_stiffness * (x - start) ** 2 - self.push * (x - start)
            energy[at] = np.maximum(energy[at], held)
        return reach, energy

    def speeds(self, law: Law, x: Array, v: Array, periods: int, last: int, parts: int = 8) -> tuple[Array, Array]:
        """Return ∫v² and ∫|v| over the `last` of the periods, from `parts` readings of v in each period, (n,) each."""
        start, n = x.copy(), len(x)
        whole = np.floor(self.delay / self.period + 1e-9).astype(int)
        rest = np.maximum(self.delay - whole * self.period, 0.0)
        law.relax(x)
        first = np.clip(law.force(self._read(x), np.zeros(n)), -self.effort, self.effort)
        queue, before, motor = [first.copy() for _ in range(int(whole.max()) + 2)], self._read(x), first.copy()
        whole_spans = (rest, self.period - rest)
        watched = [(span / parts, self._transition(span / parts)) for span in whole_spans]
        unwatched = [(span, self._transition(span)) for span in whole_spans]
        squares, ways = np.zeros(n), np.zeros(n)
        for count in range(periods):
            seen = self._read(x)
            force = np.clip(law.force(seen, (seen - before) / self.period), -self.effort, self.effort)
            before, queue = seen, [force, *queue[:-1]]
            stack = np.array(queue)
            is_watched = count >= periods - last
            moves = watched if is_watched else unwatched
            for (span, step), age in zip(moves, (whole + 1, whole), strict=True):
                for _ in range(parts if is_watched else 1):
                    fast = np.abs(v)
                    x, v, motor = self._move(step, span, x, v, motor, stack[age, np.arange(n)], start)
                    squares += is_watched * 0.5 * span * (fast**2 + v**2)
                    ways += is_watched * 0.5 * span * (fast + np.abs(v))
        return squares, ways

    def _read(self, x: Array) -> Array:
        step = np.where(self.resolution > 0.0, self.resolution, 1.0)
        return np.where(self.resolution > 0.0, step * np.round(x / step), x)

    def _transition(self, span: Array) -> Array:
        """(x − start, v, f, command, push) over a span, (n, 5, 5); without lag f is not used."""
        n = len(self.mass)
        total = self.mass + self.hand_mass
        system = np.zeros((n, 5, 5))
        system[:, 0, 1] = 1.0
        system[:, 1, 0] = -self.hand_stiffness / total
        system[:, 1, 1] = -self.damping / total
        system[:, 1, 4] = 1.0 / total
        lagging = self.lag > 0.0
        system[:, 1, 2] = np.where(lagging, 1.0 / total, 0.0)
        system[:, 1, 3] = np.where(lagging, 0.0, 1.0 / total)
        rate = np.where(lagging, 1.0 / np.where(lagging, self.lag, 1.0), 0.0)
        system[:, 2, 2], system[:, 2, 3] = -rate, rate
        return exponential(system * span[:, None, None])

    def _move(self, step: Array, span: Array, x: Array, v: Array, motor: Array, command: Array, start: Array) -> Any:
        state = np.stack([x - start, v, motor, command, self.push], axis=1)
        end = np.einsum("nij,nj->ni", step, state)
        if self.coulomb.any():
            return self._rubbed(span, x, v, motor, command, end, start)
        return end[:, 0] + start, end[:, 1], end[:, 2]

    def _rubbed(self, span: Array, x: Array, v: Array, motor: Array, command: Array, end: Array, start: Array) -> Any:
        """With Coulomb friction, without lag and without a hand's spring: slip up to a stop, then stick or turn."""
        drive, left = command + self.push, span.copy()
        for _ in range(2):
            moving = v != 0.0
            held = ~moving & (np.abs(drive) <= self.coulomb)
            sign = np.where(moving, np.sign(v), np.sign(drive))
            net = drive - sign * self.coulomb
            rate = self.damping / (self.mass + self.hand_mass)
            final = net / self.damping
            # v(t) = final + (v − final)·e^(−rate·t); it stops where that is 0, if net is against the motion.
            with np.errstate(divide="ignore", invalid="ignore"):
                stop = np.log((final - v) / final) / rate
            stop = np.where(moving & (sign * net < 0.0) & np.isfinite(stop), stop, np.inf)
            time = np.where(held, 0.0, np.minimum(left, stop))
            decay = -np.expm1(-rate * time)
            x = x + final * time + (v - final) * decay / rate
            stopped = stop <= left
            v = np.where(held | stopped, 0.0, final + (v - final) * (1.0 - decay))
            left = np.where(held, 0.0, left - time)
        return x, v, motor

"""The forces of the scenes' elements, written out again from their formulas for many loops at once; numpy alone.

Each part acts on some of the loops, its `rows`. All its other arrays hold a value for each of these.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass
class Part(ABC):
    """A force on some of the loops."""

    rows: Rows

    def __post_init__(self) -> None:
        self.memory: tuple[Array, ...] = ()

    def relax(self, x: Array) -> None:
        """Remember a handle that has been at rest at x for ever."""
        return

    @abstractmethod
    def force(self, x: Array, v: Array) -> Array:
        """Return the force on the handle, one period after the last."""


@dataclass
class Hinge(Part):
    """A spring-damper that begins at an edge; it pushes out of the material and never pulls."""

    edge: Array
    side: Array
    stiffness: Array
    damping: Array

    def force(self, x: Array, v: Array) -> Array:
        depth = self.side * (x - self.edge)
        push = np.maximum(self.stiffness * depth + self.damping * self.side * v, 0.0)
        return np.where(depth > 0.0, -self.side * push, 0.0)


@dataclass
class Crossley(Part):
    """A body of Hunt and Crossley on the positive side."""

    edge: Array
    k: Array
    exponent: Array
    loss: Array

    def force(self, x: Array, v: Array) -> Array:
        depth = np.maximum(x - self.edge, 0.0)
        return -self.k * depth**self.exponent * np.maximum(1.0 + self.loss * v, 0.0)


@dataclass
class Wave(Part):
    """−A·sin(2π·(x − middle)/p)"""

    middle: Array
    amplitude: Array
    pitch: Array

    def force(self, x: Array, v: Array) -> Array:
        return -self.amplitude * np.sin(2.0 * np.pi * (x - self.middle) / self.pitch)


@dataclass
class Zigzag(Part):
    """Straight flanks between rounded valleys and crests."""

    amplitude: Array
    pitch: Array
    rounding: Array

    def force(self, x: Array, v: Array) -> Array:
        triangle = 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * x / self.pitch))
        return -self.amplitude * np.clip(triangle / self.rounding, -1.0, 1.0)


@dataclass
class Well(Part):
    """A magnet."""

    middle: Array
    stiffness: Array
    radius: Array

    def force(self, x: Array, v: Array) -> Array:
        u = (x - self.middle) / self.radius
        return np.where(np.abs(u) < 1.0, -self.stiffness * self.radius * u * (1.0 - u * u) ** 2, 0.0)


@dataclass
class Condition(Part):
    """A spring-damper with a dead band and a largest force."""

    middle: Array
    stiffness: Array
    damping: Array
    band: Array
    most: Array

    def force(self, x: Array, v: Array) -> Array:
        away = x - self.middle
        beyond = np.sign(away) * np.maximum(np.abs(away) - self.band, 0.0)
        push = self.stiffness * beyond + np.where(np.abs(away) > self.band, self.damping * v, 0.0)
        return np.asarray(-np.clip(push, -self.most, self.most))


@dataclass
class Stick(Part):
    """A spring to a point that is dragged along, and a damper."""

    stiffness: Array
    coulomb: Array
    damping: Array

    def relax(self, x: Array) -> None:
        self.memory = (x,)

    def force(self, x: Array, v: Array) -> Array:
        (anchor,) = self.memory
        longest = self.coulomb / self.stiffness
        stretch = np.clip(x - anchor, -longest, longest)
        self.memory = (x - stretch,)
        return -self.stiffness * stretch - self.damping * v


@dataclass
class Puncture(Part):
    """A capsule that gives way at a depth; then friction that breaks away, an edge that cuts, and drag."""

    edge: Array
    most: Array
    depth: Array
    curvature: Array
    grip: Array
    friction: Array
    breakaway: Array
    cutting: Array
    drag: Array
    slow: Array

    def relax(self, x: Array) -> None:
        """Behind the capsule the friction is at ease, and the edge pushes with half of what cuts."""
        deep = x - self.edge
        none = np.zeros_like(x)
        tip = deep - 0.5 * self.cutting / self.grip
        self.memory = (np.where(deep >= self.depth, 1.0, 0.0), deep, none, tip, deep)

    def force(self, x: Array, v: Array) -> Array:
        opened, anchor, way, tip, before = self.memory
        deep = x - self.edge
        inside = deep > 0.0
        closed = (opened == 0.0) & (deep < self.depth)
        u = deep / self.depth
        capsule = self.most * ((1.0 - self.curvature) * u + self.curvature * u * u)
        fresh = inside & ~closed & (opened == 0.0)
        afresh = fresh | (before <= 0.0)
        anchor, way, tip = np.where(afresh, deep, anchor), np.where(afresh, 0.0, way), np.where(fresh, deep, tip)
        # It slips on while it moves the way it slipped, fast enough.
        way = np.where(way * v >= self.slow, way, 0.0)
        held = self.grip * (deep - anchor)
        breaks = np.abs(held) > np.where(way != 0.0, self.friction, np.maximum(self.breakaway, self.friction))
        way = np.where(breaks, np.sign(held), way)
        held = np.where(breaks, way * self.friction, held)
        cut = np.minimum(self.grip * (deep - tip), self.cutting)
        tip = np.maximum(tip, deep - self.cutting / self.grip)
        push = held + np.maximum(cut, 0.0) + self.drag * v
        opened = np.where(inside, np.where(closed, opened, 1.0), 0.0)
        self.memory = (opened, np.where(breaks, deep - held / self.grip, anchor), way, tip, deep)
        return np.where(inside, -np.where(closed, capsule, push), 0.0)


@dataclass
class Voigt(Part):
    """A spring and a damper side by side, whose dent recovers; it never pulls."""

    edge: Array
    stiffness: Array
    damping: Array
    period: float

    def relax(self, x: Array) -> None:
        self.memory = (np.maximum(x - self.edge, 0.0),)

    def force(self, x: Array, v: Array) -> Array:
        dent = self.memory[0] * np.exp(-self.stiffness / self.damping * self.period)
        deep = x - self.edge
        self.memory = (np.maximum(deep, dent),)
        return np.where(deep > dent, -np.maximum(self.stiffness * deep + self.damping * v, 0.0), 0.0)


@dataclass
class Zener(Part):
    """A spring beside branches q̇ = (s − q)/τ under a surface s that moves on straight lines; it never pulls."""

    edge: Array
    rest: Array
    branches: tuple[tuple[Array, Array], ...]
    """(k, τ) each."""
    period: float

    def relax(self, x: Array) -> None:
        self.memory = (np.maximum(x - self.edge, 0.0),) * (len(self.branches) + 1)

    def force(self, x: Array, v: Array) -> Array:
        deep = x - self.edge
        at_zero = self._pressure(np.zeros_like(x))
        slope = self._pressure(np.ones_like(x)) - at_zero
        surface = np.maximum(deep, -at_zero / slope)
        push = self._pressure(surface)
        self.memory = (surface, *self._inner(surface))
        return np.where(surface > deep, 0.0, -push)

    def _inner(self, surface: Array) -> list[Array]:
        """q at the end of a period in which the surface moves to here: s − w·τ is one solution, at the speed w."""
        start, *inner = self.memory
        speed = (surface - start) / self.period
        return [
            surface - speed * tau + (q - start + speed * tau) * np.exp(-self.period / tau)
            for q, (_, tau) in zip(inner, self.branches, strict=True)
        ]

    def _pressure(self, surface: Array) -> Array:
        branches = zip(self._inner(surface), self.branches, strict=True)
        return np.asarray(self.rest * surface + sum(k * (surface - q) for q, (k, _) in branches))


@dataclass
class Law:
    """A sum of forces on n loops."""

    n: int
    parts: list[Part] = field(default_factory=list)

    def relax(self, x: Array) -> None:
        for part in self.parts:
            part.relax(x[part.rows])

    def force(self, x: Array, v: Array) -> Array:
        total = np.zeros(self.n)
        for part in self.parts:
            total[part.rows] += part.force(x[part.rows], v[part.rows])
        return total

    def at_rest(self, x: Array) -> Array:
        """Return the force on a handle that has been at rest at x for ever."""
        return self.after(x, x)

    def after(self, rested: Array, x: Array) -> Array:
        """Return the force at x on a handle that was at rest elsewhere a period ago."""
        kept = [part.memory for part in self.parts]
        self.relax(rested)
        force = self.force(x, np.zeros(self.n))
        for part, memory in zip(self.parts, kept, strict=True):
            part.memory = memory
        return force

"""Elements as somebody else writes them, drawn: polynomial, periodic, one-sided; with bounds of their own, and without.

What `linearised` states is drawn too, and may be softer than the force: nothing keeps somebody's promise.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import Local
from haptic_fieldbus.signals import Signal
from tests.margins import laws
from tests.margins.drawn import TRAVEL, Drawn, drawn
from tests.margins.laws import Array, Law, Part
from tests.margins.test_claims import Trial

KINDS = ("polynomial", "periodic", "one_sided")


@dataclass(frozen=True)
class Stated:
    """Any force, with what `linearised` states of it."""

    law: Callable[..., float]
    stated: float = 0.05
    needs: tuple[Signal, ...] = (Signal.POSITION,)
    damping: float = 0.0
    axis: str = "a"
    name: str = "own"

    def force(self, *values: float) -> float:
        return self.law(*values)

    def linearised(self) -> StateSpace:
        return gain([[-self.stated, -self.damping]])


@dataclass(frozen=True)
class Remembering:
    """A spring that is its own at every period."""

    stiffness: float = 0.05
    axis: str = "a"
    name: str = "remembering"

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION, Signal.ELAPSED_NS)

    def begin(self, period: float) -> Callable[[float, int], float]:
        return lambda position, elapsed: -self.stiffness * position

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


@dataclass(frozen=True)
class Own:
    """A force of the position; `stiffness` scales it and `stated` is the slope that `linearised` gives."""

    axis: str
    stiffness: float
    position: float
    stated: float
    name: str = "own"

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def force(self, position: float) -> float:
        return -self.stiffness * self.push(position - self.position)

    def linearised(self) -> StateSpace:
        return gain([[-self.stated, 0.0]])

    def push(self, away: float) -> float:
        """The force against the motion per stiffness."""
        raise NotImplementedError

    def slope(self, away: float) -> float:
        raise NotImplementedError

    def turns(self, lower: float, upper: float) -> list[float]:
        """Places at which the slope is the largest or smallest, or turns."""
        raise NotImplementedError


@dataclass(frozen=True)
class Polynomial(Own):
    """x + q·x² + h·x³, of which h may be below 0."""

    square: float = 0.0
    cube: float = 0.0

    def push(self, away: float) -> float:
        return away + self.square * away**2 + self.cube * away**3

    def slope(self, away: float) -> float:
        return 1.0 + 2.0 * self.square * away + 3.0 * self.cube * away**2

    def turns(self, lower: float, upper: float) -> list[float]:
        return [-self.square / (3.0 * self.cube)]


@dataclass(frozen=True)
class Waves(Own):
    """sin(κ·x)/κ, and a part of its second harmonic."""

    pitch: float = 0.01
    second: float = 0.0

    @property
    def _turn(self) -> float:
        return 2.0 * math.pi / self.pitch

    def push(self, away: float) -> float:
        return (math.sin(self._turn * away) + 0.5 * self.second * math.sin(2.0 * self._turn * away)) / self._turn

    def slope(self, away: float) -> float:
        return math.cos(self._turn * away) + self.second * math.cos(2.0 * self._turn * away)

    def turns(self, lower: float, upper: float) -> list[float]:
        """Where sin(κ·x)·(1 + 4·s·cos(κ·x)) is 0."""
        found = [0.0, 0.5 * self.pitch]
        if abs(4.0 * self.second) > 1.0:
            found += [sign * math.acos(-0.25 / self.second) / self._turn for sign in (-1.0, 1.0)]
        first, last = math.floor(lower / self.pitch) - 1, math.ceil(upper / self.pitch) + 1
        return [each + number * self.pitch for number in range(first, last + 1) for each in found]


@dataclass(frozen=True)
class OneSided(Own):
    """reach·(x/reach)^n on the positive side."""

    reach: float = 0.01
    exponent: float = 1.0

    def push(self, away: float) -> float:
        return float(self.reach * (max(away, 0.0) / self.reach) ** self.exponent)

    def slope(self, away: float) -> float:
        if away < 0.0:
            return 0.0
        return float(self.exponent * (away / self.reach) ** (self.exponent - 1.0))

    def turns(self, lower: float, upper: float) -> list[float]:
        return [0.0]


@dataclass(frozen=True)
class Bounded:
    """The methods by which an element states bounds of its own, for those that can tell where their slope turns."""

    def local(self: Any, lower: float, upper: float) -> Local:
        low, high = lower - self.position, upper - self.position
        ends = [low, *(each for each in self.turns(low, high) if low <= each <= high), high]
        slopes = [self.slope(each) for each in ends] + ([0.0] if isinstance(self, OneSided) and low <= 0.0 else [])
        forces = [self.force(self.position + each) for each in self._flat(low, high, ends)]
        return Local((min(forces), max(forces)), (self.stiffness * min(slopes), self.stiffness * max(slopes)))

    def _flat(self: Any, low: float, high: float, ends: list[float]) -> list[float]:
        """The ends, and where the force is the largest or smallest between them, by halving between turns."""
        found = list(ends)
        for before, after in pairwise(ends):
            if self.slope(before) * self.slope(after) < 0.0:
                for _ in range(60):
                    middle = 0.5 * (before + after)
                    at_before = self.slope(before) * self.slope(middle) > 0.0
                    before, after = (middle, after) if at_before else (before, middle)
                found += [before, after]
        return found

    def places(self: Any, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        grid = np.linspace(max(lower, -5.0), min(upper, 5.0), 200).tolist()
        turns = [self.position + each for each in self.turns(lower - self.position, upper - self.position)]
        return tuple(each for each in [*grid, *turns] if lower <= each <= upper)


@dataclass(frozen=True)
class BoundedPolynomial(Bounded, Polynomial):
    """With bounds."""


@dataclass(frozen=True)
class BoundedWaves(Bounded, Waves):
    """With bounds."""


@dataclass(frozen=True)
class BoundedOneSided(Bounded, OneSided):
    """With bounds."""


def own(kind: str, is_bounded: bool, limit: float, random: np.random.Generator) -> Own:
    """Draw an element whose steepest place is about at `limit` [N/m], in a few of ten above it."""
    stiffness = limit * 10.0 ** random.uniform(-1.2, 0.2)
    place, size = random.uniform(-0.02, 0.02), 10.0 ** random.uniform(-2.5, -1.2)
    stated = stiffness * random.uniform(0.05, 1.0)
    if kind == "polynomial":
        cube = random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-1.0, 1.0) / size**2
        of = BoundedPolynomial if is_bounded else Polynomial
        return of("a", stiffness, place, stated, square=random.uniform(-0.5, 0.5) / size, cube=cube)
    if kind == "periodic":
        return (BoundedWaves if is_bounded else Waves)(
            "a", stiffness, place, stated, pitch=size, second=random.uniform(-0.6, 0.6)
        )
    exponent = float(random.choice([1.0, random.uniform(1.0, 3.0)]))
    return (BoundedOneSided if is_bounded else OneSided)("a", stiffness, place, stated, reach=size, exponent=exponent)


def own_loop(random: np.random.Generator) -> Drawn:
    """Draw a loop with one own element, half of them without bounds."""
    loop = drawn(random)
    limit = loop.plant.damping / (0.5e-3 + loop.delay + loop.plant.torque_lag)
    element = own(str(random.choice(KINDS)), bool(random.random() < 0.3), limit, random)
    return replace(loop, elements=(element,))


@dataclass
class Formula(Part):
    """The forces again: of the stiffness times a polynomial, waves or one side."""

    values: dict[str, Array] = field(default_factory=dict)

    def force(self, x: Array, v: Array) -> Array:
        get = self.values
        away = x - get["position"]
        polynomial = away + get["square"] * away**2 + get["cube"] * away**3
        turn = 2.0 * np.pi / get["pitch"]
        waves = (np.sin(turn * away) + get["second"] * np.sin(2.0 * turn * away) / 2.0) / turn
        side = get["reach"] * (np.maximum(away, 0.0) / get["reach"]) ** get["exponent"]
        return np.asarray(
            -get["stiffness"] * np.select([get["cube"] != 0.0, get["pitch"] > 0.0], [polynomial, waves], side)
        )


def law_of(loops: list[Drawn]) -> Law:
    law = laws.Law(len(loops))
    rows = np.arange(len(loops), dtype=np.intp)
    plain = {"stiffness": 0.0, "position": 0.0, "square": 0.0, "cube": 0.0, "second": 0.0, "exponent": 1.0}
    values = {
        name: np.array([float(getattr(loop.elements[0], name, other)) for loop in loops])
        for name, other in {**plain, "pitch": -1.0, "reach": 1.0}.items()
    }
    law.parts.append(Formula(rows, values))
    return law


@dataclass(frozen=True)
class OwnTrial(Trial):
    """Drawn loops with own elements, each at places of its travel that the motor can hold."""

    @cached_property
    def law(self) -> Law:
        return law_of(self.columns)

    def drawn_places(self, random: np.random.Generator) -> Array:
        """Of some places of the travel the one where the law is steepest, as far as the motor holds it."""
        tried = random.uniform(-TRAVEL, TRAVEL, (12, len(self.columns)))
        effort = np.array([loop.effort for loop in self.columns])
        slopes = np.array([self.slope(x) for x in tried])
        held = np.array([np.abs(self.law.at_rest(x)) for x in tried]) <= 0.99 * effort
        best = np.where(held, slopes, -np.inf).argmax(axis=0)
        return np.asarray(np.take_along_axis(tried, best[None], axis=0)[0])

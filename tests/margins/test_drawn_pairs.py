"""Teleoperation with play and limits, and virtual masses on springs: verdicts against the event-exact simulation.

A pair is two devices with delays of their own, a coupling between them, and own springs or walls. The simulation has a
column for each axis: those of all first axes, then those of all second ones.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.verdict import AT_LIMIT
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from tests.margins.drawn import PERIOD, Drawn
from tests.margins.events import Bench
from tests.margins.laws import Array, Condition, Hinge, Law, Part
from tests.margins.test_claims import GROWN, grown
from tests.telling import TOLD

WINDOWS = 7
BATCHES = [pytest.param(0, 10, 1400, id="few"), *(pytest.param(n, 300, 7000, id=f"batch-{n}") for n in (1, 2))]


@dataclass(frozen=True)
class Pair:
    """Two devices with their delays [s] and largest forces [N], the coupling, and the elements of the first device."""

    plants: tuple[Plant, Plant]
    delays: tuple[float, float]
    efforts: tuple[float, float]
    coupling: Coupling
    spring: Spring
    wall: Wall
    place: tuple[float, float]
    """Where both rest [m]: within the wall, and the coupling stretched beyond its play."""

    @cached_property
    def group(self) -> Group:
        own = ((self.spring, self.wall), ())
        members = [
            Member(name, plant, delay, elements, None, "backward-difference", effort=effort)
            for name, plant, delay, effort, elements in zip(
                "ab", self.plants, self.delays, self.efforts, own, strict=True
            )
        ]
        return Group(tuple(members), (self.coupling,), PERIOD)

    @cached_property
    def is_stable(self) -> bool:
        return self.group.loop.growth(self.group.environment()) <= 1.0 + AT_LIMIT

    @cached_property
    def is_passive(self) -> bool:
        return self.is_stable and self.group.loop.damping_share(self.group.environment()) <= 1.0


def pair(random: np.random.Generator) -> Pair:
    plants = tuple(Plant(10.0 ** random.uniform(-1.3, 0.3), 10.0 ** random.uniform(-0.7, 0.7)) for _ in range(2))
    delays = tuple(float(each) for each in random.choice([0.0, 0.4e-3, 1e-3, 1.6e-3], 2))
    ratio = float(random.choice([1.0, -1.0, 0.5, 2.0]))
    limit = min(
        plant.damping / (0.5 * PERIOD + delay) / share
        for plant, delay, share in zip(plants, delays, (1.0, ratio**2), strict=True)
    )
    stiffness = limit * 10.0 ** random.uniform(-1.0, 0.3)
    most = 10.0 ** random.uniform(-0.5, 1.0)
    is_limited, has_play = random.random() < 0.5, random.random() < 0.5
    play = 10.0 ** random.uniform(-4.0, -2.5) * has_play
    damping = 5e-4 * stiffness * random.random() * (random.random() < 0.4)
    coupling = Coupling(("a", "b"), stiffness, damping, ratio, play, most if is_limited else None)
    stretch = play + 0.5 * most / stiffness * random.uniform(0.1, 0.9)
    x = random.uniform(1e-3, 5e-3)
    own = limit * 10.0 ** random.uniform(-1.5, 0.0)
    efforts = (50.0 + most, 50.0 + 3.0 * most) if random.random() < 0.5 else (math.inf, math.inf)
    return Pair(plants, delays, efforts, coupling, Spring("a", 0.2 * own), Wall("a", own), (x, (x - stretch) / ratio))  # type: ignore[arg-type]


@dataclass
class Shaft(Part):
    """Play, a spring-damper beyond it, and a largest force, between the columns of first and second axes."""

    stiffness: Array
    damping: Array
    ratio: Array
    band: Array
    most: Array

    def force(self, x: Array, v: Array) -> Array:
        first, second = np.split(x, 2)
        slow, other = np.split(v, 2)
        twist = first - self.ratio * second
        beyond = np.sign(twist) * np.maximum(np.abs(twist) - self.band, 0.0)
        speed = np.where(np.abs(twist) > self.band, slow - self.ratio * other, 0.0)
        push = np.clip(self.stiffness * beyond + self.damping * speed, -self.most, self.most)
        return np.concatenate([-push, self.ratio * push])


def law_of_pairs(pairs: list[Pair]) -> Law:
    def each(name: str, of: str = "coupling") -> Array:
        found = [getattr(getattr(one, of), name) for one in pairs]
        return np.array([math.inf if value is None else value for value in found], dtype=float)

    n = len(pairs)
    first, none = np.arange(n, dtype=np.intp), np.zeros(n)
    shaft = Shaft(
        np.arange(2 * n, dtype=np.intp), each("stiffness"), each("damping"), each("ratio"), each("dead_band"),
        each("saturation"),
    )  # fmt: skip
    spring = Condition(first, none, each("stiffness", "spring"), none, none, none + math.inf)
    return Law(2 * n, [shaft, spring, Hinge(first, none, none + 1.0, each("stiffness", "wall"), none)])


def bench_of(pairs: list[Pair], push: Array, hands: bool, random: np.random.Generator) -> Bench:
    plants = [one.plants[side] for side in (0, 1) for one in pairs]
    mass, damping = np.array([(plant.mass, plant.damping) for plant in plants]).T
    none = np.zeros(len(plants))
    delay = np.array([one.delays[side] for side in (0, 1) for one in pairs])
    effort = np.array([one.efforts[side] for side in (0, 1) for one in pairs])
    stiff = np.array([one.coupling.stiffness for _ in (0, 1) for one in pairs])
    hand_mass = mass * 10.0 ** random.uniform(-1.0, 0.5, len(plants)) * hands
    hand_stiffness = stiff * 10.0 ** random.uniform(-2.0, 1.0, len(plants)) * hands
    return Bench(mass, damping, PERIOD, delay, none, effort, none, none, hand_mass, hand_stiffness, push)


@pytest.mark.thorough("simulates 600 drawn pairs", quick=("few",))
@pytest.mark.parametrize(("batch", "size", "periods"), BATCHES)
def test_no_pair_is_called_better_than_it_is(batch: int, size: int, periods: int, record_property: Any) -> None:
    """Free handles of pairs that are called stable, and passive hands on those that are called passive, do not grow."""
    random = np.random.default_rng(5300 + batch)
    pairs = [pair(random) for _ in range(size)]
    law = law_of_pairs(pairs)
    x = np.array([one.place[side] for side in (0, 1) for one in pairs])
    push = -law.at_rest(x)
    told = []
    for hands in (False, True):
        bench = bench_of(pairs, push, hands, random)
        knock = np.where(np.arange(2 * size) < size, 1e-6, 0.0)
        reach, _ = bench.run(law, x.copy(), knock, periods, WINDOWS)
        grows = (grown(reach) > GROWN).reshape(2, size).any(axis=0)
        claims = np.array([one.is_passive if hands else one.is_stable for one in pairs])
        false = [one for one, wrong in zip(pairs, grows & claims, strict=True) if wrong]
        assert not false, f"{'passive' if hands else 'stable'}: {false[:2]}"
        told.append(f"{int(claims.sum())} {'passive' if hands else 'stable'}, {int(grows.sum())} grow")
    record_property(TOLD, f"pairs {batch} of {size}: {'; '.join(told)}")


@dataclass
class Hung(Part):
    """A mass on a spring whose other end moves on straight lines: the mass swings about the line, ë = −ω²·e."""

    stiffness: Array
    mass: Array

    def relax(self, x: Array) -> None:
        self.memory = (np.zeros_like(x), np.zeros_like(x), x)

    def force(self, x: Array, v: Array) -> Array:
        away, speed, before = self.memory
        turn = np.sqrt(self.stiffness / self.mass)
        line = (x - before) / PERIOD
        swing, cosine, sine = speed - line, np.cos(turn * PERIOD), np.sin(turn * PERIOD)
        after = away * cosine + swing / turn * sine
        self.memory = (after, swing * cosine - away * turn * sine + line, x)
        return self.stiffness * after


def hung_loop(random: np.random.Generator) -> Drawn:
    """Draw a device with a virtual mass on a spring, and a spring to the ground beside it."""
    plant = Plant(10.0 ** random.uniform(-1.3, 0.3), 10.0 ** random.uniform(-0.7, 0.7))
    delay = float(random.choice([0.0, 0.4e-3, 1e-3]))
    limit = plant.damping / (0.5 * PERIOD + delay)
    ground, link = (limit * 10.0 ** random.uniform(-1.5, 0.3) for _ in range(2))
    return Drawn(
        plant, delay, math.inf, (Spring("a", ground), SprungMass("a", link, 10.0 ** random.uniform(-1.5, 0.5)))
    )


@pytest.mark.thorough("simulates 600 drawn virtual masses", quick=("few",))
@pytest.mark.parametrize(("batch", "size", "periods"), BATCHES)
def test_no_virtual_mass_is_called_better_than_it_is(batch: int, size: int, periods: int, record_property: Any) -> None:
    """A knock on a handle with a virtual mass dies, as long as that is called stable."""
    random = np.random.default_rng(6300 + batch)
    loops = [hung_loop(random) for _ in range(size)]
    groups = [
        Group((Member("a", each.plant, each.delay, each.elements, "exact-foh", "backward-difference"),), (), PERIOD)
        for each in loops
    ]
    stable = np.array([each.loop.growth(each.environment()) <= 1.0 + AT_LIMIT for each in groups])
    rows, none = np.arange(size, dtype=np.intp), np.zeros(size)
    ground, link = (np.array([each.elements[n].stiffness for each in loops]) for n in (0, 1))
    hung = np.array([each.elements[1].mass for each in loops])
    law = Law(size, [Condition(rows, none, ground, none, none, none + math.inf), Hung(rows, link, hung)])
    mass, damping, delay = np.array([(each.plant.mass, each.plant.damping, each.delay) for each in loops]).T
    bench = Bench(mass, damping, PERIOD, delay, none, none + math.inf, none, none, none, none, 1e-3 * ground)
    reach, _ = bench.run(law, none + 1e-3, none + 1e-6, periods, WINDOWS)
    # Two masses hand their energy to and fro within some seconds; at the knock the handle has all of it.
    grows = reach[-3:].max(axis=0) > GROWN * reach[:4].max(axis=0)
    false = [each for each, wrong in zip(loops, grows & stable, strict=True) if wrong]
    assert not false, false[:2]
    record_property(TOLD, f"virtual masses {batch} of {size}: {stable.sum()} stable, {grows.sum()} grow")


def test_the_pairs_are_of_all_kinds() -> None:
    random = np.random.default_rng(5301)
    pairs = [pair(random) for _ in range(60)]
    assert {bool(each.coupling.dead_band) for each in pairs} == {True, False}
    assert {each.coupling.saturation is None for each in pairs} == {True, False}

"""Gaps in the feedback, counted, against the sums written out and against eigenvalues that numpy and scipy compute."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.gaps import Gaps
from haptic_fieldbus.margins.group import Group, Member, groups_of
from haptic_fieldbus.margins.plant import Plant
from haptic_fieldbus.planning.limits import GAP_SHARE
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import plan_of, scene_of

Array = NDArray[np.float64]
PERIOD, PERIOD_NS = 0.001, 1_000_000
AGE = 0.5
"""Of the force without delay, in periods."""


def fed(lengths: Sequence[int], largest: float = math.inf, age: float = AGE) -> tuple[Gaps, int]:
    """Counts of a loop whose samples come so many periods apart, and when the last one came."""
    counted, t_ns = Gaps(PERIOD, age, largest), 0
    for steps in lengths:
        t_ns += steps * PERIOD_NS
        if steps > 1:
            counted.note(t_ns, steps)
    return counted, t_ns


@given(st.lists(st.sampled_from([1, 1, 1, 1, 2, 3, 5]), min_size=50, max_size=200))
def test_share_and_stretch_are_the_sums_over_a_second(lengths: list[int]) -> None:
    """The second that the gaps are in is filled up with samples that came in time."""
    counted, _ = fed(lengths)
    second = lengths + [1] * (1000 - sum(lengths))
    assert counted.share == pytest.approx(sum(steps - 1 for steps in second) / 1000)
    assert counted.stretch == pytest.approx(1.0 + sum(steps**2 - steps for steps in second) / sum(second) / AGE)


def test_gaps_are_forgotten_after_a_second() -> None:
    counted, t_ns = fed([5] * 10)
    counted.note(t_ns + 2_000_000_000, 2)
    assert counted.share == pytest.approx(0.001)


def test_a_loop_is_given_up_when_its_margin_is_used_up() -> None:
    lengths = [1] * 45 + [5]  # 20 periods of surplus in 50; stretch 1.8
    for largest, given_up in ((1.7, True), (1.9, False)):
        assert fed(lengths * 20, largest)[0].too_many is given_up


def test_an_older_force_bears_more_gaps() -> None:
    lengths = [1] * 45 + [5]
    assert fed(lengths * 20, age=2.0)[0].stretch == pytest.approx(1.2, rel=0.01)
    assert not fed(lengths * 20, largest=1.3, age=2.0)[0].too_many


def test_two_gaps_are_no_pattern_however_long() -> None:
    assert not fed([20, 20], largest=1.1)[0].too_many
    assert fed([20, 20, 20], largest=1.1)[0].too_many


def test_two_gaps_in_each_second_are_a_pattern() -> None:
    """A gap of 20 periods in each 510 has a surplus of 380/510, whose double is 1.49."""
    lengths = ([1] * 490 + [20]) * 8
    assert fed(lengths)[0].stretch == pytest.approx(1.0 + 2.0 * 380 / 510)
    for largest, given_up in ((2.45, True), (2.55, False)):
        assert fed(lengths, largest)[0].too_many is given_up


def test_rare_gaps_count_by_the_time_between_them() -> None:
    lengths = ([1] * 9980 + [20]) * 3
    assert fed(lengths)[0].stretch == pytest.approx(1.0 + 2.0 * 380 / 10_000)
    assert not fed(lengths, largest=1.08)[0].too_many
    assert fed(lengths, largest=1.07)[0].too_many


def test_with_a_fifth_missing_no_margin_helps() -> None:
    assert not fed([1, 1, 1, 1, 1, 2] * 140)[0].too_many
    assert fed([1, 1, 2] * 250)[0].too_many


@dataclass(frozen=True)
class Loop:
    """A spring, and a damper by backward difference, on a mass with damping; `delay` in periods, below 1.

    State: [x, v, force of the motor, x of the sample before].
    """

    mass: float
    friction: float
    stiffness: float
    damping: float = 0.0
    delay: float = 0.0

    def held(self, periods: int) -> Array:
        """The map of one hold: a sample, its force from the delay on, and the next sample after so many periods."""
        x, v, force, _ = np.eye(4)
        fresh = -self.stiffness * x - self.damping * (x - np.eye(4)[3]) / PERIOD
        early = self._moved(self.delay * PERIOD) @ [x, v, force]
        late = self._moved((periods - self.delay) * PERIOD) @ [early[0], early[1], fresh]
        return np.array([late[0], late[1], fresh, x])

    def _moved(self, time: float) -> Array:
        """[x, v] after a time under a constant force."""
        system = np.array([[0.0, 1.0, 0.0], [0.0, -self.friction / self.mass, 1.0 / self.mass], [0.0, 0.0, 0.0]])
        return np.asarray(scipy.linalg.expm(system * time))[:2]

    def radius(self, gaps: Sequence[tuple[int, int]]) -> float:
        """Of the map of a pattern: of each gap its length, and how many periods in time follow it."""
        whole, in_time = np.eye(4), self.held(1)
        for length, follow in gaps:
            whole = np.linalg.matrix_power(in_time, follow) @ self.held(length) @ whole
        return float(np.abs(np.linalg.eigvals(whole)).max())


def limit_of(mass: float, friction: float, damping: float, delay: float) -> float:
    """The stiffness at which the loop without gaps begins to grow, by halving."""
    low, high = 0.0, 2.0 * (friction + damping) / PERIOD / (0.5 + delay)
    for _ in range(40):
        middle = 0.5 * (low + high)
        grows = Loop(mass, friction, middle, damping, delay).radius([(1, 0)]) > 1.0
        low, high = (low, middle) if grows else (middle, high)
    return low


def test_gaps_at_each_half_turn_that_make_a_loop_grow_end_it() -> None:
    """A hold of 10 periods in 70 at 0.4 of the limit: Σs²/Σs is 2.29, below the margin of 2.5, and the loop grows."""
    loop = Loop(mass=0.2, friction=0.5, stiffness=0.4 * 2.0 * 0.5 / PERIOD)
    assert loop.radius([(10, 60)]) ** (1 / 70) == pytest.approx(1.00042, abs=1e-5)
    counted, _ = fed([10, *[1] * 60] * 30, largest=1.0 + GAP_SHARE * 1.5)
    assert counted.too_many
    assert counted.stretch > 2.5


@pytest.mark.thorough("4 cases of one rule", quick=1)
@pytest.mark.parametrize(("length", "every"), [(2, 40), (5, 200), (10, 300), (20, 900)])
def test_the_stretch_is_what_the_worst_timing_costs_in_stiffness(length: int, every: int) -> None:
    """Of masses whose half turn takes about as long as from gap to gap: K₀ over the stretch, to a twentieth."""
    friction = 0.2
    stiffness = 2.0 * friction / PERIOD / (1.0 + 2.0 * length * (length - 1) / every)
    masses = np.linspace(0.8, 1.2, 41) * stiffness * (every * PERIOD / math.pi) ** 2
    below, above = (
        max(Loop(float(mass), friction, part * stiffness).radius([(length, every - length)]) for mass in masses)
        for part in (1.0, 1.05)
    )
    assert below < 1.0 < above


def permitted(random: np.random.Generator, turn: float, largest: float, age: float) -> list[tuple[int, int]]:
    """A pattern of up to three gaps about half turns apart, whose stretch is the largest one."""
    sizes = random.choice([2, 3, 5, 10, 16, 25], size=random.integers(1, 4)).tolist()
    parts = [random.uniform(0.7, 1.1) * random.integers(1, 4) * turn / 2.0 for _ in sizes]
    surplus, missing = sum(s * (s - 1) for s in sizes), sum(s - 1 for s in sizes)
    scale = max(surplus / (age * (largest - 1.0)) / sum(parts), missing / 0.2 / sum(parts), 1.0)
    return [(size, max(math.ceil(scale * part) - size, 1)) for size, part in zip(sizes, parts, strict=True)]


@pytest.mark.thorough("draws 400 loops and 20 patterns of each", quick=("0",))
@pytest.mark.parametrize("seed", range(20))
def test_no_pattern_that_is_permitted_grows(seed: int) -> None:
    random = np.random.default_rng([48, seed])
    for _ in range(1 if seed == 0 else 20):
        mass, friction = 10.0 ** random.uniform(-1.5, 0.7), 10.0 ** random.uniform(-1.3, 0.9)
        damping, delay = friction * float(random.choice([0.0, 0.5, 2.0])), float(random.choice([0.0, 0.33, 0.9]))
        limit, margin = limit_of(mass, friction, damping, delay), 1.0 + 10.0 ** random.uniform(-1.5, 1.0)
        loop = Loop(mass, friction, limit / margin, damping, delay)
        turn = 2.0 * math.pi / (PERIOD * math.sqrt(loop.stiffness / mass))
        for _ in range(20):
            pattern = permitted(random, min(turn, 600.0), 1.0 + GAP_SHARE * (margin - 1.0), 0.5 + delay)
            assert loop.radius(pattern) < 1.0, (loop, margin, pattern)


def test_gaps_of_two_axes_that_end_together_count_once_by_the_longer_one() -> None:
    counted = Gaps(PERIOD, AGE, math.inf)
    for steps in (3, 5, 4):
        counted.note(PERIOD_NS, steps)
    assert counted.share == pytest.approx(4 / 1000)
    assert counted.stretch == pytest.approx(1.0 + 20 / 1000 / AGE)
    assert Gaps(PERIOD, AGE, 3.0).tolerance == pytest.approx(1.0)


def test_the_gaps_of_tied_axes_are_those_of_both() -> None:
    """A third of the samples is missing, now of one axis and now of the other one: each alone would bear its own."""
    cycle = Cycle(plan_of(load_scene("virtual_shaft")))
    left, right = (axis.watch.gaps for axis in cycle.axes.values())
    assert left is right
    for number in range(1, 400):
        (left if number % 2 else right).note(6 * number * PERIOD_NS, 3)
    assert left.too_many


def test_several_springs_bear_the_gaps_that_one_of_their_sum_bears() -> None:
    """The nominal margin of 1.49 is that of one of both beside the other one; both together have 1.24."""
    (one,) = plan_of(scene_of(Wall("handle", 1200.0))).axes
    (two,) = plan_of(scene_of(Wall("handle", 600.0), Wall("handle", 600.0, name="other"))).axes
    assert two.stability is not None
    assert two.stability.nominal_margin == pytest.approx(1.49, abs=0.02)
    assert two.largest_stretch == pytest.approx(one.largest_stretch, abs=0.02)


@dataclass(frozen=True)
class TiedLoop:
    """A shaft between two masses, and a spring on the second; delays in periods, below 1.

    State: [x, v of the first, x, v of the second, both forces of the motors].
    """

    masses: tuple[float, float]
    frictions: tuple[float, float]
    delays: tuple[float, float]
    shaft: float
    wall: float
    ratio: float

    def held(self, periods: int) -> Array:
        """The map of one hold: each fresh force acts from its delay on; the next sample is after so many periods."""
        now = np.eye(6)
        twist = now[0] - self.ratio * now[2]
        fresh = (-self.shaft * twist, self.ratio * self.shaft * twist - self.wall * now[2])
        time, after = 0.0, now
        for axis in np.argsort(self.delays).tolist():
            after = self._moved((self.delays[axis] - time) * PERIOD) @ after
            time = self.delays[axis]
            after[4 + axis] = fresh[axis]
        return self._moved((periods - time) * PERIOD) @ after

    def _moved(self, time: float) -> Array:
        system = np.zeros((6, 6))
        for axis in range(2):
            system[2 * axis, 2 * axis + 1] = 1.0
            system[2 * axis + 1, 2 * axis + 1] = -self.frictions[axis] / self.masses[axis]
            system[2 * axis + 1, 4 + axis] = 1.0 / self.masses[axis]
        return np.asarray(scipy.linalg.expm(system * time))

    def radius(self, gaps: Sequence[tuple[int, int]]) -> float:
        whole, in_time = np.eye(6), self.held(1)
        for length, follow in gaps:
            whole = np.linalg.matrix_power(in_time, follow) @ self.held(length) @ whole
        return float(np.abs(np.linalg.eigvals(whole)).max())

    def turns(self) -> list[float]:
        """Times of a turn of both modes [periods]."""
        n = self.ratio
        stiffness = self.shaft * np.array([[1.0, -n], [-n, n * n]]) + np.diag([0.0, self.wall])
        squares = np.linalg.eigvals(np.diag(1.0 / np.array(self.masses)) @ stiffness).real
        return [2.0 * math.pi / (PERIOD * math.sqrt(each)) for each in squares if each > 1.0]

    def group(self) -> Group:
        """The same axes as the package judges them."""
        walls: list[tuple[Wall, ...]] = [(), (Wall("b", self.wall, sides="bilateral"),) if self.wall else ()]
        members = [
            Member(name, Plant(mass, friction), delay * PERIOD, own, None, "backward-difference")
            for name, mass, friction, delay, own in zip(
                "ab", self.masses, self.frictions, self.delays, walls, strict=True
            )
        ]
        (found,) = groups_of(members, (Coupling(("a", "b"), self.shaft, ratio=self.ratio),), PERIOD)
        return found


def tied_loop(random: np.random.Generator) -> TiedLoop:
    masses = 10.0 ** random.uniform(-1.0, 0.5, 2)
    frictions = masses * 10.0 ** random.uniform(0.0, 0.7)
    delays = random.choice([0.0, 0.33, 0.9], 2)
    ratio = float(random.choice([1.0, -1.0, 0.5]))
    shaft = float(min(frictions)) / PERIOD * 10.0 ** random.uniform(-1.0, -0.3)
    wall = shaft * float(random.choice([0.0, 0.5, 3.0]))
    return TiedLoop(tuple(masses.tolist()), tuple(frictions.tolist()), tuple(delays.tolist()), shaft, wall, ratio)


@pytest.mark.thorough("draws 200 shafts and 20 patterns of each", quick=("0",))
@pytest.mark.parametrize("seed", range(10))
def test_no_pattern_that_is_permitted_grows_on_a_shaft(seed: int) -> None:
    """With and without a spring on the second axis, which the margin of the shaft leaves out."""
    random, judged = np.random.default_rng([58, seed]), 0
    while judged < (2 if seed == 0 else 20):
        loop = tied_loop(random)
        further = loop.group().further_age(20.0 * PERIOD) / PERIOD
        if loop.radius([(1, 0)]) > 1.0 + 1e-9 or not further:
            continue
        judged += 1
        youngest = 0.5 + min(loop.delays)
        for _ in range(20):
            turn = min(float(random.choice(loop.turns())), 600.0)
            pattern = permitted(random, turn, 1.0 + GAP_SHARE * further / youngest, youngest)
            assert loop.radius(pattern) < 1.0 + 1e-9, (loop, further, pattern)


def test_a_damped_wall_bears_the_gaps_that_the_age_of_its_force_permits() -> None:
    """One sample in five is missing: the force of this wall grows, though its margin of stiffness is 4.9."""
    loop, age = Loop(0.37, 0.84, 10_000.0, 690.0), 0.5
    assert loop.radius([(1, 1)]) < 1.0 < loop.radius([(2, 3)])
    member = Member("a", Plant(0.37, 0.84), 0.0, (Wall("a", 10_000.0, damping=690.0),), None, "backward-difference")
    group = Group((member,), (), PERIOD)
    assert group.stability.nominal_margin == pytest.approx(4.9, abs=0.1)
    borne = 1.0 + GAP_SHARE * group.further_age(0.1) / (age * PERIOD)
    assert borne < 1.0 + 2.0 / 5.0 / age, "the stretch of one gap of two periods in five"


@pytest.mark.parametrize("scene", ["damped_wall", "damper"])
def test_a_plan_with_damping_permits_no_more_gaps_than_the_age_of_its_force(scene: str) -> None:
    (axis,) = plan_of(load_scene(scene)).axes
    assert axis.group is not None
    age = axis.delay.total + 0.5 * PERIOD
    further = axis.group.further_age(0.2 * axis.limits.age)
    most = math.inf if further == 0.2 * axis.limits.age else 1.0 + GAP_SHARE * further / age
    assert axis.largest_stretch <= most * 1.02

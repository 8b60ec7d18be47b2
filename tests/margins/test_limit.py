"""The limit: its figure on the shipped bench, and benches from inside of its ranges."""

import math
from dataclasses import replace
from functools import partial
from itertools import product
from random import Random

import pytest

import haptic_fieldbus
from haptic_fieldbus.margins import Basis, Plant, Stability, Verdict, stiffness_limit
from haptic_fieldbus.margins.bodies import HungBody
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.limit import WORST, Values
from haptic_fieldbus.margins.plant import Ranges, exact_bench
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.cases.timing import Ticks, free_ticks, schedule_growth
from tests.loops import BENCH, LAG, PERIOD, wall

CONTROL_PERIODS = (0.2e-3, 0.25e-3, 0.4e-3, 0.5e-3, 1e-3)
PERIODS = 20
"""Of a drawn pattern; a whole number of all these control periods."""


def test_on_the_shipped_bench_it_is_half_of_the_nominal_one() -> None:
    """b over T/2, twice the control period, what the bus takes, and a torque loop of 300 Hz; known as 750 N/m."""
    found = haptic_fieldbus.stability("wall")
    plan = haptic_fieldbus.plan("wall")
    delay = plan.axes[0].delay
    age = PERIOD / 2 + delay.bus + delay.compute + 2 * 0.4e-3 + 1 / (2 * math.pi * 300)
    assert plan.axes[0].group is not None
    assert plan.axes[0].group.limit_over_ranges().value == pytest.approx(BENCH.damping / age, rel=2e-3)
    assert (found.limit.value, found.unit, found.limit.basis) == (750.0, "N/m", Basis.SIMULATED)
    assert found.margin == 1.25
    assert found.stiffness_limit.stable == pytest.approx(1492, rel=1e-3)
    (at,) = found.limit.judged_at
    assert (at.plant.damping, at.delay) == pytest.approx((BENCH.damping, delay.longest))


def test_a_scene_without_a_stiffness_is_inside_where_it_is_stable_for_all_open_values() -> None:
    def damped(by: float) -> Group:
        ranges = Ranges((0.0, 0.0), (0.0, 0.9e-3))
        member = Member("a", BENCH, 0.0, (Damper("a", by),), None, "backward-difference", ranges=ranges)
        return Group((member,), (), PERIOD)

    soft, strong, wild = (damped(share * BENCH.mass / PERIOD).stability for share in (0.1, 0.8, 3.0))
    assert (soft.limit.value, soft.margin, soft.to_json()["limit"]) == (math.inf, None, None)
    assert soft.is_inside
    assert (strong.verdict, strong.is_inside) == (Verdict.STABLE, False)
    assert (wild.verdict, wild.is_inside) == (Verdict.UNSTABLE, False)


def test_what_is_exact_in_all_has_the_nominal_limit() -> None:
    plant = replace(BENCH, torque_lag=LAG)
    for ranges in (exact_bench((LAG, LAG), (0.4e-3, 0.4e-3), Basis.SIMULATED), None):
        member = Member("a", plant, 0.4e-3, (Wall("a", 100.0),), None, "backward-difference", ranges=ranges)
        group = Group((member,), (), PERIOD)
        found, nominal = group.limit_over_ranges(), group.stability.stiffness_limit
        assert found.value == pytest.approx(nominal.stable, rel=2e-6)
        assert found.quantisation == nominal.quantisation


def test_above_the_limit_a_loop_is_not_called_passive() -> None:
    ranges = Ranges((LAG, 2.0 * LAG), (0.2e-3, 0.8e-3))
    plant = Plant(0.1, 2.0, torque_lag=LAG)

    def at(stiffness: float) -> Stability:
        elements = (Wall("a", stiffness),)
        member = Member("a", plant, 0.2e-3, elements, None, "backward-difference", ranges=ranges)
        return Group((member,), (), PERIOD).stability

    limit = at(100.0).limit.value
    inside, above = at(limit), at(1.1 * limit)
    assert (inside.nominal, inside.verdict, inside.is_inside) == (Verdict.PASSIVE, Verdict.PASSIVE, True)
    assert (above.nominal, above.verdict, above.is_inside) == (Verdict.PASSIVE, Verdict.STABLE, False)
    assert inside.margin == 1.0


@pytest.mark.parametrize(
    ("virtual", "mass"), [(0.0, 1.0), (20.0, 0.8)], ids=["any device", "the lightest of the stated range"]
)
def test_it_is_the_limit_at_the_longest_delay_and_lag_with_half_of_the_damping(virtual: float, mass: float) -> None:
    """With much virtual damping a light device is worst; without any, the mass hardly counts."""
    ranges, plant = Ranges((LAG, 2.0 * LAG), (0.2e-3, 0.8e-3)), Plant(0.1, 2.0, torque_lag=LAG)
    elements = (Wall("a", 100.0, damping=virtual),)
    member = Member("a", plant, 0.2e-3, elements, None, "backward-difference", ranges=ranges)
    found = Group((member,), (), PERIOD).limit_over_ranges()
    worst = Plant(0.1 * mass, 1.0, torque_lag=2.0 * LAG)
    limit = stiffness_limit(worst, PERIOD, 0.8e-3, partial(wall, damping=virtual))
    assert found.value == pytest.approx(limit, rel=1e-5 if virtual else 0.01)


def test_the_worst_corner_of_a_spring_is_tried_first() -> None:
    assert WORST == (0, 1, 1)


class Drawn:
    """A bench as its rig states it, and the same bench as it is."""

    def __init__(self, seed: int) -> None:
        random = Random(f"bench {seed}")
        share = partial(self._within, random)
        self.stated = replace(
            BENCH, mass=10 ** random.uniform(-1, 1), damping=10 ** random.uniform(-0.7, 1), torque_lag=0.0
        )
        bandwidth, arrival = 10 ** random.uniform(2.5, 3.5), random.uniform(0.1e-3, 0.5e-3)
        control, most = random.choice(CONTROL_PERIODS), random.choice((0.0, 0.1e-3, 0.3e-3))
        lag = 1 / (2 * math.pi * bandwidth)
        self.virtual_damping = random.choice((0.0, 0.0, 0.2 * self.stated.damping))
        self.ranges = Ranges((lag / 2.0, lag / 0.3), (arrival, arrival + most + 2 * control))
        self.stated = replace(self.stated, torque_lag=lag)
        self.delay = arrival
        self.true = replace(
            self.stated,
            mass=self.stated.mass * share(self.ranges.mass),
            damping=self.stated.damping * share(self.ranges.damping),
            torque_lag=share(self.ranges.torque_lag),
        )
        lateness = [share((0.0, most)) for _ in range(PERIODS)]
        self.pattern = free_ticks(Ticks(control, random.uniform(0, control)), PERIOD, arrival, lateness)

    @staticmethod
    def _within(random: Random, ends: tuple[float, float]) -> float:
        """An end of the range every second time."""
        return random.choice((*ends, random.uniform(*ends), random.uniform(*ends)))

    def stability(self) -> "haptic_fieldbus.Stability":
        elements = (Wall("a", 100.0, damping=self.virtual_damping),)
        member = Member("a", self.stated, self.delay, elements, None, "backward-difference", ranges=self.ranges)
        return Group((member,), (), PERIOD).stability

    def grows(self, stiffness: float) -> bool:
        environment = wall(stiffness, self.virtual_damping)
        return schedule_growth(self.true, PERIOD, self.pattern, environment) > 1.0 + 1e-10


@pytest.mark.thorough("draws 300 benches")
def test_of_300_benches_within_the_ranges_none_grows_at_the_limit_over_ranges() -> None:
    beyond_nominal = 0
    for seed in range(300):
        drawn = Drawn(seed)
        found = drawn.stability()
        assert found.stiffness_limit.stable is not None
        for part in (1.0, 0.7, 0.4, 0.1):
            assert not drawn.grows(part * found.limit.value), (seed, part)
        beyond_nominal += drawn.grows(found.stiffness_limit.stable)
    # The nominal limit is no such promise: many of these benches are worse than what is stated.
    assert beyond_nominal > 60


@pytest.mark.thorough("draws 40 benches with couplings", quick=1)
@pytest.mark.parametrize("seed", range(40))
def test_no_coupling_within_its_range_has_a_smaller_limit(seed: int) -> None:
    """Between the ends of the range too, where the load may swing at another frequency than at both ends."""
    random = Random(f"coupling {seed}")
    mass, share = 10 ** random.uniform(-0.5, 0.5), random.uniform(0.1, 0.8)
    stiffness = 10 ** random.uniform(2.5, 5.5)
    losses = 2.0 * random.uniform(0.01, 0.2) * math.sqrt(stiffness * mass * share)
    plant = replace(BENCH, mass=mass * (1.0 - share), damping=10 ** random.uniform(-0.5, 0.7), torque_lag=LAG)
    body, ranges = (
        HungBody(mass * share, stiffness, losses),
        Ranges((LAG, 3 * LAG), (0.4e-3, 1e-3), coupling=(0.5, 2.0)),
    )
    member = Member("a", plant, 0.4e-3, (Wall("a", 100.0),), None, "backward-difference", (body,), ranges)
    least = Group((member,), (), PERIOD).limit_over_ranges()
    (at,) = least.judged_at
    for each in (0.5, *(random.uniform(0.5, 2.0) for _ in range(20)), 2.0):
        within = member.at(replace(at, coupling=each))
        assert least.value <= Group((within,), (), PERIOD).rough_limit() * (1.0 + 1e-3)


def pair(*benches: tuple[Plant, float], damping: float = 0.0, dampers: tuple[float, float] = (0.0, 0.0)) -> Group:
    """Two handles under a virtual shaft, each with lag and delay known to a factor."""
    members = [
        Member(name, plant, delay, (Damper(name, own),) if own else (), None, "backward-difference",
               ranges=Ranges((0.7 * plant.torque_lag, 1.4 * plant.torque_lag), (0.5 * delay, 1.5 * delay)))
        for name, (plant, delay), own in zip("ab", benches, dampers, strict=True)
    ]  # fmt: skip
    return Group(tuple(members), (Coupling(("a", "b"), 100.0, damping=damping),), PERIOD)


HEAVY_AND_LIGHT = (Plant(4.2, 2.1, torque_lag=0.36e-3), 0.93e-3), (Plant(1.43, 0.31, torque_lag=0.156e-3), 0.32e-3)
QUICK_AND_SLOW = (Plant(2.0, 3.77, torque_lag=0.37e-3), 1.03e-3), (Plant(0.556, 1.56, torque_lag=0.24e-3), 0.288e-3)


@pytest.mark.parametrize(
    "group",
    [pair(*HEAVY_AND_LIGHT, damping=698.0), pair(*QUICK_AND_SLOW, dampers=(65.4, 244.0))],
    ids=["damped coupling", "dampers of their own"],
)
def test_no_corner_of_two_coupled_axes_has_a_smaller_limit(group: Group) -> None:
    """All 256 corners, each axis at one of its own, by the eigenvalues of the loop."""
    told = group.limit_over_ranges().value
    assert 0.0 < told < math.inf
    own = [
        [
            member.at(Values(replace(member.plant, mass=member.plant.mass * mass, damping=member.plant.damping * share,
                                     torque_lag=lag), delay))
            for mass, share, lag, delay in product(
                member.known_ranges.mass, member.known_ranges.damping, member.known_ranges.torque_lag,
                member.known_ranges.delay,
            )
        ]
        for member in group.members
    ]  # fmt: skip
    for members in product(*own):
        assert replace(group, members=members).bears(told * (1.0 - 1e-5)), members


def test_a_load_that_swings_at_the_worst_frequency_between_the_ends_of_a_coupling_is_found() -> None:
    """With virtual damping both ends bear 500 N/m, and the stated coupling bears nothing."""
    plant = Plant(0.26, 2.2, torque_lag=0.16e-3)
    ranges = Ranges((0.112e-3, 0.224e-3), (3.07e-3, 3.07e-3), mass=(0.8, 1.25), damping=(0.5, 2.0), coupling=(0.5, 2.0))
    member = Member(
        "a", plant, 3.07e-3, (Wall("a", 50.0, damping=6.0),), None, "backward-difference",
        (HungBody(0.92, 59_000.0, 2.4),), ranges,
    )  # fmt: skip
    found = Group((member,), (), 2e-3).limit_over_ranges()
    assert found.value == 0.0
    (at,) = found.judged_at
    assert 0.7 < at.coupling < 1.1
    ends = [Group((member.at(replace(at, coupling=each)),), (), 2e-3).rough_limit() for each in (0.5, 2.0)]
    assert min(ends) > 400.0

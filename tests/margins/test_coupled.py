"""Limits and verdicts of coupled axes against the pair written out by hand and against what one axis becomes."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Plant, Verdict, alone, judge, passive_limit, passive_limit_of, stiffness_limit
from haptic_fieldbus.margins.closed_loop import Axis
from haptic_fieldbus.margins.coupled import CoupledAxes, PassivityPort, damping_share
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.numerics.coupled import environment
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.coupling import Coupling
from tests.loops import BENCH, DELAYS, LAG, PERIOD, sprung_mass, wall, with_damping
from tests.pairs import PairByHand, shaft

LAGGING = replace(BENCH, torque_lag=LAG)
HEAVY, LIGHT = Plant(2.0, 0.3), Plant(0.05, 0.8)
PLANTS = [(BENCH, BENCH), (LAGGING, LIGHT), (HEAVY, replace(LIGHT, torque_lag=2 * PERIOD)), (Plant(1e-3, 3.0), LAGGING)]
PAIR_DELAYS = [(0.0, 0.0), (0.33, 0.33), (0.0, 1.0), (0.5, 1.7), (2.0, 0.25)]


def equal(plant: Plant, delay: float) -> list[Axis]:
    return [Axis(plant, delay * PERIOD)] * 2


class TestLimit:
    @pytest.mark.thorough("100 searches for a limit", quick=3)
    @pytest.mark.parametrize("plants", PLANTS, ids=range(len(PLANTS)))
    @pytest.mark.parametrize("delays", PAIR_DELAYS)
    @pytest.mark.parametrize(("damping", "ratio"), [(0.0, 1.0), (0.2, 1.0), (0.0, -2.5), (0.2, 0.1), (0.0, 30.0)])
    def test_is_where_the_pair_written_by_hand_begins_to_grow(
        self, plants: tuple[Plant, Plant], delays: tuple[float, float], damping: float, ratio: float
    ) -> None:
        pair = PairByHand(plants, delays, damping, ratio)
        limit = CoupledAxes(pair.axes(), PERIOD).limit(shaft(damping, ratio))
        assert limit > 0.0
        assert pair.growth(limit * (1 - 1e-4)) < 1.0 < pair.growth(limit * (1 + 1e-4))
        assert limit == pytest.approx(pair.limit_near(limit), rel=1e-6)
        for part in (0.9, 0.5, 0.1, 0.01):
            assert pair.growth(part * limit) < 1.0

    @pytest.mark.thorough("10 cases of one rule", quick=3)
    @pytest.mark.parametrize("delays", PAIR_DELAYS)
    @pytest.mark.parametrize("held", [20.0, 400.0])
    def test_with_a_wall_on_one_end_too(self, delays: tuple[float, float], held: float) -> None:
        pair = PairByHand((LAGGING, LIGHT), delays, 0.2, 0.6, held)
        limit = CoupledAxes(pair.axes(), PERIOD).limit(shaft(0.2, 0.6))
        assert pair.growth(limit * (1 - 1e-4)) < 1.0 < pair.growth(limit * (1 + 1e-4))
        assert limit == pytest.approx(pair.limit_near(limit), rel=1e-6)

    @pytest.mark.thorough("60 searches for a limit", quick=2)
    @pytest.mark.parametrize("delay", DELAYS)
    @pytest.mark.parametrize("plant", [BENCH, LAGGING, HEAVY, LIGHT, Plant(0.0, 1.5)])
    @pytest.mark.parametrize("damping", [0.0, 0.3])
    def test_of_equal_axes_is_half_that_of_one_at_a_wall_of_twice_the_damping(
        self, delay: float, plant: Plant, damping: float
    ) -> None:
        expected = stiffness_limit(plant, PERIOD, delay * PERIOD, with_damping(2 * damping)) / 2
        found = CoupledAxes(equal(plant, delay), PERIOD).limit(shaft(damping))
        assert found == pytest.approx(expected, rel=1e-7)

    @pytest.mark.thorough("18 cases of one rule", quick=6)
    @pytest.mark.parametrize("ratio", [3e-5, 0.02, 0.5, -3.0, 200.0, 3e4])
    @pytest.mark.parametrize("delay", [0.0, 0.33, 1.0])
    def test_of_devices_that_come_to_rest_alike_is_that_of_one_of_their_reduced_mass(
        self, ratio: float, delay: float
    ) -> None:
        """With b/m the same the twist has an equation of its own, of mass 1/(1/m1 + n²/m2)."""
        first, second = Plant(0.6, 1.5, torque_lag=LAG), Plant(0.2, 0.5, torque_lag=LAG)
        mass = 1 / (1 / first.mass + ratio**2 / second.mass)
        one = Plant(mass, mass * first.damping / first.mass, torque_lag=LAG)
        axes = [Axis(first, delay * PERIOD), Axis(second, delay * PERIOD)]
        found = CoupledAxes(axes, PERIOD).limit(shaft(0.0, ratio))
        assert found == pytest.approx(stiffness_limit(one, PERIOD, delay * PERIOD, wall), rel=1e-6)

    def test_at_a_device_too_heavy_to_move_is_that_of_a_wall(self) -> None:
        axes = [Axis(LAGGING, 3.3e-4), Axis(Plant(1e6, 1e6), 0.0)]
        expected = stiffness_limit(LAGGING, PERIOD, 3.3e-4, wall)
        assert CoupledAxes(axes, PERIOD).limit(shaft()) == pytest.approx(expected, rel=1e-4)

    def test_the_delay_of_either_end_costs_stiffness(self) -> None:
        limits = [
            CoupledAxes([Axis(LAGGING, one), Axis(LAGGING, other)], PERIOD).limit(shaft())
            for one, other in ((0.0, 0.0), (0.0, 2e-3), (2e-3, 0.0), (2e-3, 2e-3))
        ]
        assert limits[0] > limits[1] > limits[3]
        assert limits[1] == pytest.approx(limits[2], rel=1e-7)

    def test_devices_without_damping_have_none_unless_the_shaft_damps_them(self) -> None:
        """Together they drift for ever, which is no instability."""
        plants = (Plant(0.5, 0.0), Plant(1.3, 0.0))
        pair = PairByHand(plants, (0.3, 0.3), 2.0, 1.7)
        assert CoupledAxes(pair.axes(), PERIOD).limit(shaft(0.0, 1.7)) == 0.0
        mass = 1 / (1 / 0.5 + 1.7**2 / 1.3)
        expected = stiffness_limit(Plant(mass, 0.0), PERIOD, 3e-4, with_damping(2.0))
        assert CoupledAxes(pair.axes(), PERIOD).limit(shaft(2.0, 1.7)) == pytest.approx(expected, rel=1e-6)

    def test_what_depends_on_no_stiffness_has_none(self) -> None:
        found = judge(CoupledAxes(equal(BENCH, 0.0), PERIOD), lambda stiffness: shaft(0.1)(0.0), 100.0)[0]
        assert (found.stiffness_limit.stable, found.stiffness_limit.passive) == (math.inf, math.inf)
        assert (found.stiffness_limit.quantisation, found.verdict) == (None, Verdict.PASSIVE)


class TestPassiveLimit:
    @pytest.mark.thorough("18 searches for a limit", quick=1)
    @pytest.mark.parametrize("delay", DELAYS)
    @pytest.mark.parametrize("plant", [BENCH, LAGGING, HEAVY])
    def test_of_equal_axes_is_half_that_of_one(self, delay: float, plant: Plant) -> None:
        found = judge(CoupledAxes(equal(plant, delay), PERIOD), shaft(), 10.0)[0].stiffness_limit.passive
        assert found == pytest.approx(passive_limit(plant, PERIOD, delay * PERIOD) / 2, rel=1e-7)

    def test_of_equal_axes_without_delay_is_damping_over_the_period(self) -> None:
        """b > K·T, and K·T + 2·|B| with a virtual damper"""
        for damping in (0.0, 0.3, -0.3):
            found = CoupledAxes(equal(BENCH, 0.0), PERIOD).passive_limit(shaft(damping), math.inf)
            assert found == pytest.approx((BENCH.damping - 2 * abs(damping)) / PERIOD, rel=1e-7)

    @pytest.mark.thorough("15 searches for a limit", quick=1)
    @pytest.mark.parametrize("delays", PAIR_DELAYS)
    @pytest.mark.parametrize("ratio", [1.0, -0.3, 5.0])
    def test_needs_all_the_damping_there_is(self, delays: tuple[float, float], ratio: float) -> None:
        axes = PairByHand((LAGGING, HEAVY), delays).axes()
        ports = [PassivityPort(axis.plant.damping, axis.delay, axis.plant.torque_lag) for axis in axes]
        limit = CoupledAxes(axes, PERIOD).passive_limit(shaft(0.05, ratio), math.inf)
        shares = [damping_share(shaft(0.05, ratio)(part * limit), ports, PERIOD) for part in (0.3, 1.0, 1.001)]
        if not limit:
            assert damping_share(shaft(0.05, ratio)(0.0), ports, PERIOD) > 1.0
            return
        assert shares[0] < 1.0 < shares[2]
        assert shares[1] == pytest.approx(1.0, rel=1e-7)

    @pytest.mark.thorough("40 searches for a limit", quick=1)
    @pytest.mark.parametrize("plants", PLANTS, ids=range(len(PLANTS)))
    @pytest.mark.parametrize("delays", PAIR_DELAYS)
    @pytest.mark.parametrize("ratio", [1.0, -2.5])
    def test_what_is_passive_is_stable(
        self, plants: tuple[Plant, Plant], delays: tuple[float, float], ratio: float
    ) -> None:
        axes = PairByHand(plants, delays).axes()
        passive = CoupledAxes(axes, PERIOD).passive_limit(shaft(0.0, ratio), math.inf)
        assert 0.0 < passive <= CoupledAxes(axes, PERIOD).limit(shaft(0.0, ratio)) * (1 + 1e-9)

    @pytest.mark.thorough("12 searches for a limit", quick=1)
    @pytest.mark.parametrize("delays", [(0.0, 0.0), (0.0, 2.0), (1.0, 0.0), (3.0, 1.0)])
    @pytest.mark.parametrize("ratio", [1.0, 0.4, -2.0])
    def test_heavy_hands_in_the_worst_proportion_leave_no_stability_above_it(
        self, delays: tuple[float, float], ratio: float
    ) -> None:
        """So it is not only sufficient. Slow motions are the worst: b − K·½(c_i + c_j)·g_i·g_j, c the forces' ages."""
        dampings = np.array([1.5, 0.6])
        ages = (np.array(delays) + 0.5) * PERIOD
        form = 0.5 * (ages[:, None] + ages) * np.outer([1.0, -ratio], [1.0, -ratio])
        values, shapes = scipy.linalg.eigh(form, np.diag(dampings))
        passive = 1.0 / values[-1]
        masses = 1e4 * np.array([1.0, -ratio]) / shapes[:, -1] * np.sign(shapes[0, -1])
        assert (masses > 0.0).all()
        axes = [
            Axis(Plant(mass, damping), delay * PERIOD)
            for mass, damping, delay in zip(masses.tolist(), dampings.tolist(), delays, strict=True)
        ]
        assert CoupledAxes(axes, PERIOD).passive_limit(shaft(0.0, ratio), math.inf) == pytest.approx(passive, rel=1e-6)
        assert CoupledAxes(axes, PERIOD).limit(shaft(0.0, ratio)) == pytest.approx(passive, rel=1e-3)

    @pytest.mark.thorough("judges many hands")
    def test_hands_of_one_body_cannot_make_a_passive_shaft_unstable(self) -> None:
        """Masses, springs and dampers on and between the handles, at random, without delay."""
        random = np.random.default_rng(7)
        axes = [Axis(BENCH, 0.0), Axis(LIGHT, 0.0)]
        g = np.array([1.0, -0.7])
        passive = CoupledAxes(axes, PERIOD).passive_limit(shaft(0.0, 0.7), math.inf)
        worst = 0.0
        for _ in range(300):
            links = 10.0 ** random.uniform(-2, 5, (3, 2)) * random.integers(0, 2, (3, 2))
            ways = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, random.normal()]])
            stiffness, damping = (ways.T @ np.diag(links[:, at]) @ ways for at in range(2))
            mass = np.diag([BENCH.mass, LIGHT.mass]) + np.diag(10.0 ** random.uniform(-4, 2, 2))
            rest = damping + np.diag([BENCH.damping, LIGHT.damping])
            inverse = np.linalg.inv(mass)
            system = np.zeros((6, 6))
            system[:2, 2:4] = np.eye(2)
            system[2:4] = np.hstack([-inverse @ stiffness, -inverse @ rest, inverse])
            moved = scipy.linalg.expm(system * PERIOD)
            loop = moved[:4, :4].copy()
            loop[:, :2] -= moved[:4, 4:] @ (0.999 * passive * np.outer(g, g))
            worst = max(worst, float(np.abs(np.linalg.eigvals(loop)).max()))
        assert worst <= 1.0 + 1e-7

    def test_is_zero_where_nothing_could_be_passive(self) -> None:
        assert CoupledAxes(equal(BENCH, 0.0), PERIOD).passive_limit(shaft(BENCH.damping), 1e4) == 0.0
        for other in (Plant(1.0, 0.0), replace(BENCH, tachometer=True)):
            axes = [Axis(BENCH, 0.0), Axis(other, 0.0)]
            assert CoupledAxes(axes, PERIOD).passive_limit(shaft(), 1e4) == 0.0


class TestJudgement:
    def test_of_one_axis_is_that_of_one_axis(self) -> None:
        plant = replace(LAGGING, coulomb=0.25, resolution=1.2e-5)
        expected = judge(alone(plant, PERIOD, 3.3e-4), with_damping(0.4), 600.0, 0.4)[0]
        (found,) = judge(CoupledAxes([Axis(plant, 3.3e-4)], PERIOD), with_damping(0.4), 600.0, 0.4)
        assert found.stiffness_limit.passive == pytest.approx(
            passive_limit_of(plant, PERIOD, 3.3e-4, with_damping(0.4), math.inf), rel=1e-7
        )
        limit = replace(found.stiffness_limit, passive=expected.stiffness_limit.passive)
        assert replace(found, stiffness_limit=limit) == expected

    def test_is_one_told_for_each_axis_with_its_plant_and_delay(self) -> None:
        axes = [Axis(LAGGING, 3.3e-4), Axis(LIGHT, 1e-3)]
        first, second = judge(CoupledAxes(axes, PERIOD), shaft(0.1, 2.0), 40.0, 0.1)
        assert (first.plant, first.delay_s, second.plant, second.delay_s) == (LAGGING, 3.3e-4, LIGHT, 1e-3)
        assert replace(first, plant=LIGHT, delay_s=1e-3) == second
        assert (first.stiffness, first.damping, first.period_s) == (40.0, 0.1, PERIOD)
        assert first.stiffness_limit.stable is not None
        assert first.margin == pytest.approx(first.stiffness_limit.stable / 40.0, rel=0.01)
        assert first.spectral_radius == pytest.approx(1.0, abs=1e-12)

    @pytest.mark.thorough("4 cases of one rule", quick=1)
    @pytest.mark.parametrize(
        ("stiffness", "friction", "verdict"),
        [
            (500.0, 1.0, Verdict.PASSIVE),
            (770.0, 1.0, Verdict.STABLE),
            (770.0, 0.01, Verdict.LIMIT_CYCLE),
            (850.0, 1.0, Verdict.UNSTABLE),
        ],
    )
    def test_follows_the_table(self, stiffness: float, friction: float, verdict: Verdict) -> None:
        """passive to 752, stable to 798: half of what one of these benches is at a wall"""
        plant = replace(LAGGING, coulomb=0.25 * friction, resolution=1.2e-5)
        (told, _) = judge(CoupledAxes(equal(plant, 0.33), PERIOD), shaft(), stiffness)
        assert told.verdict is verdict

    def test_friction_is_asked_for_where_a_count_is_felt_most(self) -> None:
        """K ≤ 2·fc_i/(κ_i·D_i), κ = 1 and n²"""
        axes = [Axis(Plant(0.6, 1.5, 0.3, 1e-5), 0.0), Axis(Plant(0.6, 1.5, 0.2, 1e-6), 0.0)]
        for ratio, expected in ((1.0, 6e4), (2.0, 6e4), (4.0, 2.5e4), (-10.0, 4e3)):
            assert CoupledAxes(axes, PERIOD).quantisation_limit(shaft(0.3, ratio)) == pytest.approx(expected)
        assert CoupledAxes(axes[:1] * 2, PERIOD).quantisation_limit(shaft(0.3)) == pytest.approx(6e4)
        assert CoupledAxes(equal(HEAVY, 0.0), PERIOD).quantisation_limit(shaft()) is None

    @pytest.mark.parametrize(
        ("damping", "verdict"), [(0.7, Verdict.PASSIVE), (2.0, Verdict.STABLE), (5000.0, Verdict.UNSTABLE)]
    )
    def test_a_damper_alone_is_judged_without_stiffness(self, damping: float, verdict: Verdict) -> None:
        found = judge(CoupledAxes(equal(BENCH, 0.0), PERIOD), shaft(damping), None, damping)[0]
        assert (found.verdict, found.stiffness, found.margin) == (verdict, None, None)
        assert found.stiffness_limit.stable is None

    def test_a_wall_on_one_end_takes_its_part_of_the_stability(self) -> None:
        told = [
            judge(CoupledAxes([Axis(LAGGING, 0.0, own), Axis(LAGGING, 0.0)], PERIOD), shaft(), 100.0)[0]
            for own in (None, wall(500.0, 0.2), wall(5000.0))
        ]
        assert told[0].margin is not None
        assert told[1].margin is not None
        assert told[0].margin > told[1].margin > 0.0
        assert told[0].spectral_radius == pytest.approx(1.0, abs=1e-9)
        assert told[1].spectral_radius < 1.0 - 1e-6
        assert (told[2].margin, told[2].verdict) == (0.0, Verdict.UNSTABLE)

    def test_a_virtual_mass_inside_the_shaft_is_judged_with_its_states(self) -> None:
        def heavy_shaft(stiffness: float) -> StateSpace:
            """x1 – spring – virtual mass – spring – x2: at rest half as stiff as each."""
            mass = 0.2
            space = StateSpace(
                np.array([[0.0, 1.0], [-2 * stiffness / mass, 0.0]]),
                np.array([[0.0, 0.0, 0.0, 0.0], [stiffness / mass, 0.0, stiffness / mass, 0.0]]),
                stiffness * np.array([[1.0, 0.0], [1.0, 0.0]]),
                -stiffness * np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
            )
            return environment(space, period=PERIOD, method="exact-foh", estimators=(None, None))

        # Equal ends that move together share the mass, and against each other leave it where it is.
        together = stiffness_limit(LAGGING, PERIOD, 3.3e-4, sprung_mass(0.1, "exact-foh"))
        against = stiffness_limit(LAGGING, PERIOD, 3.3e-4, wall)
        told = judge(CoupledAxes(equal(LAGGING, 0.33), PERIOD), heavy_shaft, 100.0)[0]
        assert told.stiffness_limit.stable == pytest.approx(min(together, against), rel=1e-6)
        assert told.stiffness_limit.passive == 0.0
        assert told.verdict is Verdict.STABLE

    @pytest.mark.thorough("3 cases of one rule", quick=1)
    @pytest.mark.parametrize("stiffness", [math.nan, -1.0, math.inf])
    def test_a_stiffness_that_is_none_is_refused_with_the_limit_of_this_pair(self, stiffness: float) -> None:
        with pytest.raises(UsageError, match=r"expected a number from 0 up; this loop is stable to \d"):
            judge(CoupledAxes(equal(BENCH, 0.0), PERIOD), shaft(), stiffness)

    def test_times_that_no_loop_has_are_refused(self) -> None:
        with pytest.raises(UsageError, match="expected a time from 0 s up"):
            judge(CoupledAxes([Axis(BENCH, 0.0), Axis(BENCH, -1e-3)], PERIOD), shaft(), 10.0)

    def test_a_one_sided_coupling_is_judged_too(self) -> None:
        """A follower that is not felt: a wall whose place the leader moves. Stable as a wall is, passive never."""

        def follower(stiffness: float) -> StateSpace:
            return gain([[0.0, 0.0], [stiffness, -stiffness]])

        told = judge(CoupledAxes(equal(LAGGING, 0.33), PERIOD), follower, 100.0)[0]
        expected = stiffness_limit(LAGGING, PERIOD, 3.3e-4, wall)
        assert told.stiffness_limit.stable == pytest.approx(expected, rel=1e-8)
        assert told.stiffness_limit.passive == 0.0


def test_a_count_of_one_axis_acts_on_the_friction_of_the_other_one() -> None:
    """Hands that cross an edge of the coarse encoder by 2 µm, while the fine axis moves by 5 mm, gain energy."""
    fine, coarse = Plant(0.5, 3.0, 0.01, 1e-6), Plant(0.5, 3.0, 0.2, 1e-4)

    def verdict(first: Plant, second: Plant) -> Verdict:
        members = tuple(
            Member(name, plant, 0.0, (), None, "backward-difference") for name, plant in (("p", first), ("q", second))
        )
        return Group(members, (Coupling(("p", "q"), 500.0),), PERIOD).stability.verdict

    assert verdict(fine, coarse) is Verdict.STABLE
    assert verdict(replace(fine, coulomb=0.03), coarse) is Verdict.PASSIVE


def test_the_rounding_of_a_velocity_acts_through_a_coupling_too() -> None:
    """A to and fro of 6 µm over an edge in two periods gains 1.5 µJ: a count looks like B·D/T = 0.1 N."""
    for coulomb, verdict in ((0.005, Verdict.STABLE), (0.25, Verdict.PASSIVE)):
        plant = Plant(0.5, 3.0, coulomb, 1e-4)
        members = tuple(Member(name, plant, 0.0, (), None, "backward-difference") for name in "pq")
        assert Group(members, (Coupling(("p", "q"), 50.0, damping=1.0),), PERIOD).stability.verdict is verdict

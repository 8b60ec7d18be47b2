"""The limit of passivity, and what is suggested instead of an unstable scene."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest

from haptic_fieldbus.margins import (
    Plant,
    Stability,
    Suggestion,
    Verdict,
    alone,
    judge,
    passive_limit,
    passive_limit_of,
    stiffness_limit,
    suggest,
)
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.passivity import Increments
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from tests.cases import every
from tests.loops import BENCH, DELAYS, LAG, PERIOD, sprung_mass, wall, with_damping


def low_pass(stiffness: float, damping: float) -> StateSpace:
    """Velocity by backward difference through v⁺ = 0.8 v + 0.2 u; states: the position before, and v before."""
    a = np.array([[0.0, 0.0], [-0.2 / PERIOD, 0.8]])
    b = np.array([[1.0], [0.2 / PERIOD]])
    velocity, feedthrough = a[1], b[1, 0]
    return StateSpace(a, b, -damping * velocity[None], np.array([[-stiffness - damping * feedthrough]]))


def moving_average(stiffness: float, damping: float) -> StateSpace:
    """(x_k − x_{k−4})/(4·T); states: the four positions before."""
    a, b = np.eye(4, k=-1), np.eye(4)[:, :1]
    slope = damping / (4 * PERIOD)
    return StateSpace(a, b, np.array([[0.0, 0.0, 0.0, slope]]), np.array([[-stiffness - slope]]))


FILTERED = {"first-order low-pass": low_pass, "moving average": moving_average}


class TestPassiveLimit:
    @pytest.mark.parametrize("delay", DELAYS)
    def test_the_limit_of_a_spring_is_where_the_damping_needed_is_the_damping(self, delay: float) -> None:
        limit = passive_limit(BENCH, PERIOD, delay * PERIOD)
        assert damping_needed(wall(limit), PERIOD, delay * PERIOD) == pytest.approx(BENCH.damping, rel=1e-6)

    @every("delay", DELAYS)
    @every("lag", [0.0, LAG, 2 * PERIOD])
    @every("damping", [0.3, -0.3, 1.5])
    def test_the_limit_with_a_damper_needs_all_the_damping_there_is(
        self, delay: float, lag: float, damping: float
    ) -> None:
        plant = replace(BENCH, torque_lag=lag)
        limit = passive_limit_of(plant, PERIOD, delay * PERIOD, with_damping(damping), math.inf)
        needed = [
            damping_needed(wall(part * limit, damping), PERIOD, delay * PERIOD, lag) for part in (0.3, 1.0, 1.001)
        ]
        assert needed[1] == pytest.approx(BENCH.damping, rel=1e-6)
        assert needed[0] < BENCH.damping < needed[2]

    def test_without_delay_it_is_the_published_bound(self) -> None:
        """b > K·T/2 + |B|"""
        assert passive_limit(BENCH, PERIOD, 0.0) == pytest.approx(2 * BENCH.damping / PERIOD)
        for damping in (0.5, -0.5):
            found = passive_limit_of(BENCH, PERIOD, 0.0, with_damping(damping), math.inf)
            assert found == pytest.approx(2 * (BENCH.damping - 0.5) / PERIOD)

    @pytest.mark.parametrize("delay", DELAYS)
    def test_with_delay_it_is_the_bound_of_the_two_instants_that_a_fractional_delay_mixes(self, delay: float) -> None:
        """K < 2b/(g + √(g² + δ·(T − δ)))"""
        rest = math.fmod(delay, 1.0) * PERIOD
        centre = PERIOD / 2 + delay * PERIOD
        expected = 2 * BENCH.damping / (centre + math.sqrt(centre**2 + rest * (PERIOD - rest)))
        assert passive_limit(BENCH, PERIOD, delay * PERIOD) == pytest.approx(expected, rel=1e-9)

    def test_more_virtual_than_real_damping_is_never_passive(self) -> None:
        assert passive_limit_of(BENCH, PERIOD, 0.0, with_damping(BENCH.damping + 0.1), math.inf) == 0.0

    def test_a_device_without_damping_is_passive_at_no_stiffness(self) -> None:
        assert passive_limit_of(Plant(1.0, 0.0), PERIOD, 0.0, wall, math.inf) == 0.0

    @pytest.mark.parametrize("delay", DELAYS)
    @pytest.mark.parametrize("lag", [0.1 * PERIOD, LAG, 3 * PERIOD])
    def test_the_lag_of_the_torque_loop_costs_a_little_less_than_a_delay_of_the_same_time(
        self, delay: float, lag: float
    ) -> None:
        lagging = passive_limit(replace(BENCH, torque_lag=lag), PERIOD, delay * PERIOD)
        centre = PERIOD / 2 + delay * PERIOD + lag
        assert passive_limit(BENCH, PERIOD, delay * PERIOD) > lagging <= BENCH.damping / centre
        needed = damping_needed(wall(lagging), PERIOD, delay * PERIOD, lag)
        assert needed == pytest.approx(BENCH.damping, rel=1e-6)

    @pytest.mark.parametrize("delay", [0.0, 0.33, 1.7])
    @pytest.mark.parametrize("lag", [LAG, 3 * PERIOD])
    def test_the_lag_counts_in_the_damping_that_is_asked(self, delay: float, lag: float) -> None:
        """By the damping needed, and by the limit of a spring, which asks for all there is."""
        plant = replace(BENCH, torque_lag=lag)
        loop = alone(plant, PERIOD, delay * PERIOD)
        assert loop.damping_share(wall(passive_limit(plant, PERIOD, delay * PERIOD))) == pytest.approx(1.0, rel=1e-6)
        needed = damping_needed(wall(300.0, 0.2), PERIOD, delay * PERIOD, lag)
        assert loop.damping_share(wall(300.0, 0.2)) == pytest.approx(needed / plant.damping, rel=1e-12)

    @pytest.mark.parametrize("delay", [0.0, 0.33, 1.7])
    @pytest.mark.parametrize("lag", [LAG, 3 * PERIOD])
    def test_the_lag_counts_where_the_limit_is_searched(self, delay: float, lag: float) -> None:
        """A spring in series with a dashpot by backward Euler, whose pole moves with its stiffness."""

        def maxwell(stiffness: float) -> StateSpace:
            dashpot = 20.0
            whole = stiffness * PERIOD + dashpot
            pole, step = dashpot / whole, -stiffness * dashpot / whole
            return StateSpace(*(np.array([[each]]) for each in (pole, 1.0, step * (pole - 1.0), step)))

        plant = replace(BENCH, torque_lag=lag)
        found = passive_limit_of(plant, PERIOD, delay * PERIOD, maxwell, math.inf)
        needed = [damping_needed(maxwell(part * found), PERIOD, delay * PERIOD, lag) for part in (0.99, 1.0, 1.01)]
        assert needed[1] == pytest.approx(BENCH.damping, rel=1e-5)
        assert needed[0] < BENCH.damping < needed[2]

    @pytest.mark.parametrize("name", ["first-order low-pass", "moving average"])
    def test_a_filtered_damper_is_passive_as_colgate_and_schenkel_say(self, name: str) -> None:
        """b > T/2/(1 − cos ωT)·Re{(1 − e^{−jωT})·H}, H by its formula; brute force over frequency."""
        angle = np.linspace(1e-4, math.pi, 200_001)
        z = np.exp(1j * angle)
        weight = {"first-order low-pass": 0.2 / (1 - 0.8 / z), "moving average": (1 + 1 / z + z**-2 + z**-3) / 4}[name]
        force = 300.0 + 1.2 * weight * (1 - 1 / z) / PERIOD
        expected = (PERIOD / 2 / (1 - np.cos(angle)) * ((1 - 1 / z) * force).real).max()
        assert damping_needed(FILTERED[name](300.0, 1.2), PERIOD, 0.0) == pytest.approx(expected, rel=1e-6)
        found = passive_limit_of(BENCH, PERIOD, 0.0, lambda k: FILTERED[name](k, 1.2), math.inf)
        assert damping_needed(FILTERED[name](found, 1.2), PERIOD, 0.0) == pytest.approx(BENCH.damping, rel=1e-6)

    @pytest.mark.parametrize("delay", [0.0, 0.33, 1.0])
    @pytest.mark.parametrize(("mass", "damping"), [(0.63, 1.58), (0.01, 0.4), (5.0, 20.0)])
    def test_what_is_passive_is_stable(self, delay: float, mass: float, damping: float) -> None:
        plant = Plant(mass, damping)
        limit = passive_limit(plant, PERIOD, delay * PERIOD)
        assert limit <= stiffness_limit(plant, PERIOD, delay * PERIOD, wall) * (1 + 1e-9)

    def test_an_undamped_virtual_mass_is_passive_at_no_stiffness(self) -> None:
        found = judge(alone(replace(BENCH, resolution=0.0), PERIOD, 0.33e-3), sprung_mass(5.0, "exact-foh"), 300.0)[0]
        assert found.stiffness_limit.passive == 0.0
        assert found.verdict is Verdict.STABLE

    @pytest.mark.parametrize("delay", [0.0, 0.4])
    def test_any_other_environment_is_swept(self, delay: float) -> None:
        """A spring behind a low-pass filter: what it needs is proportional to its stiffness."""

        def filtered(stiffness: float) -> StateSpace:
            a = np.array([[0.8]])
            return StateSpace(a, np.array([[0.2]]), np.array([[-stiffness]]), np.array([[0.0]]))

        found = judge(alone(BENCH, PERIOD, delay * PERIOD), filtered, 100.0)[0]
        needed = damping_needed(filtered(1.0), PERIOD, delay * PERIOD)
        assert found.stiffness_limit.passive == pytest.approx(BENCH.damping / needed, rel=1e-5)


class TestSuggestion:
    PLANT = replace(BENCH, torque_lag=LAG)

    def judged(self, stiffness: float, damping: float) -> Stability:
        return judge(alone(self.PLANT, PERIOD, 0.33e-3), with_damping(damping), stiffness, damping)[0]

    def test_offers_a_softer_wall_or_one_with_damping_for_the_shipped_bench(self) -> None:
        assert self.judged(3000.0, 0.0).verdict is Verdict.UNSTABLE
        found = suggest(alone(self.PLANT, PERIOD, 0.33e-3), wall, 3000.0, 0.0)
        assert (found.stiffness, found.damping) == (1100.0, 2.0)
        assert found.damping_limit == pytest.approx(3609, abs=1)
        assert self.judged(1100.0, 0.0).verdict is not Verdict.UNSTABLE
        assert self.judged(3000.0, 2.0).verdict is not Verdict.UNSTABLE

    def test_adds_to_the_damping_that_there_is(self) -> None:
        found = suggest(alone(self.PLANT, PERIOD, 0.33e-3), wall, 5000.0, 2.0)
        assert found.stiffness == 2500.0
        assert found.damping is not None
        assert found.damping > 2.0
        assert found.damping_limit is not None
        assert found.damping_limit >= 1.2 * 5000.0

    def test_offers_no_damping_where_the_scene_has_none(self) -> None:
        found = suggest(alone(self.PLANT, PERIOD, 0.33e-3), lambda k, _: sprung_mass(0.1, "exact-foh")(k), 600.0, None)
        assert found == Suggestion(150.0, None, None)

    def test_offers_nothing_where_nothing_helps(self) -> None:
        undamped = Plant(0.5, 0.0)
        assert suggest(alone(undamped, PERIOD, 1e-3), lambda k, _: wall(k), 100.0, 0.0) == Suggestion(None, None, None)
        assert suggest(alone(self.PLANT, PERIOD, 1e-3), wall, 1e9, 0.0).damping is None

    def test_a_massless_handle_is_offered_a_softer_wall_only(self) -> None:
        """0.7 · 2b/T."""
        assert suggest(alone(Plant(0.0, 1.0), PERIOD, 0.0), wall, 1e5, 0.0) == Suggestion(1400.0, None, None), (
            "0.7·2b/T"
        )


class TestAContactWithoutEnd:
    """On a device by numbers nothing limits the depth: a body that stiffens is there as steep as a float can be."""

    @staticmethod
    def judged(effort: float, depth: float, exponent: float, loss: float = 0.0) -> Stability:
        element = HuntCrossley("a", effort, depth, exponent=exponent, loss=loss)
        member = Member("a", Plant(0.38, 0.803), 0.0, (element,), None, "backward-difference")
        return Group((member,), (), PERIOD).stability

    def test_a_body_that_stiffens_with_the_third_power_is_not_passive(self) -> None:
        found = self.judged(0.0451, 0.378e-3, 3.8)
        assert found.verdict is not Verdict.PASSIVE
        assert found.stiffness_limit.passive == 0.0

    @pytest.mark.thorough("judges 200 bodies")
    def test_no_drawn_body_overflows(self) -> None:
        random = np.random.default_rng(26)
        for _ in range(200):
            effort, depth = 10.0 ** random.uniform(-2.0, 2.5), 10.0 ** random.uniform(-4.0, -1.0)
            found = self.judged(effort, depth, random.uniform(1.0, 4.0), random.choice([0.0, 0.5]))
            assert math.isfinite(found.spectral_radius)
            assert found.verdict in Verdict

    @pytest.mark.parametrize("slope", [1e3, 1e153, 1e160, 1e300])
    @pytest.mark.parametrize("delay", [0.0, 0.4e-3])
    def test_the_damping_that_it_needs_is_that_of_forty_digits(self, slope: float, delay: float) -> None:
        with mpmath.workdps(40):
            along = mpmath.mpf(slope) * (mpmath.mpf(0.5 * PERIOD) + delay)
            spread = mpmath.mpf(delay) * (PERIOD - delay)
            needed = (along + mpmath.sqrt(along**2 + mpmath.mpf(slope) ** 2 * spread)) / 2
        assert Increments(slope, 0.0).damping_needed(PERIOD, delay, 0.0) == pytest.approx(float(needed), rel=1e-9)

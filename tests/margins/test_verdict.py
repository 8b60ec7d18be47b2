"""Limits and verdicts against loops written out by hand, Jury's criterion and published bounds."""

import math
from dataclasses import replace
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import EnvironmentOf, Plant, Verdict, alone, judge, stiffness_limit
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.linear import LARGEST
from haptic_fieldbus.numerals import rounded_down
from haptic_fieldbus.numerics.passivity import damping_needed
from haptic_fieldbus.numerics.sampled import environment, spectral_radius
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.standard_linear_solid import StandardLinearSolid
from haptic_fieldbus.scenes.wall import Wall
from tests.cases import every
from tests.loops import BENCH, DELAYS, LAG, PERIOD, ByHand, sprung_mass, wall, with_damping


@pytest.mark.thorough("96 searches for a limit", quick=8)
@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("lag", [0.0, LAG])
@pytest.mark.parametrize(("mass", "damping"), [(0.63, 1.58), (0.05, 0.8), (2.0, 0.1), (1e-3, 3.0)])
@pytest.mark.parametrize("virtual", [0.0, 0.4])
def test_the_limit_is_where_the_loop_written_by_hand_begins_to_grow(
    delay: float, lag: float, mass: float, damping: float, virtual: float
) -> None:
    plant = Plant(mass, damping, torque_lag=lag)
    limit = stiffness_limit(plant, PERIOD, delay * PERIOD, with_damping(virtual))
    if not limit:
        assert ByHand(plant, delay * PERIOD, 1e-6 * mass / PERIOD**2, virtual).growth() > 1.0
        return
    below, above = (ByHand(plant, delay * PERIOD, limit * part, virtual).growth() for part in (1 - 1e-6, 1 + 1e-6))
    assert below < 1.0 < above
    for part in (0.9, 0.5, 0.1, 0.01):
        assert ByHand(plant, delay * PERIOD, limit * part, virtual).growth() < 1.0


@pytest.mark.thorough("18 searches for a limit", quick=2)
@pytest.mark.parametrize("method", ["exact-foh", "forward-euler"])
@pytest.mark.parametrize("delay", [0.0, 0.33, 1.0])
@pytest.mark.parametrize("mass", [0.02, 0.5, 10.0])
def test_the_limit_with_a_virtual_mass_is_where_the_loop_written_by_hand_begins_to_grow(
    method: str, delay: float, mass: float
) -> None:
    plant = replace(BENCH, torque_lag=LAG)
    limit = stiffness_limit(plant, PERIOD, delay * PERIOD, sprung_mass(mass, method))
    below, above = (
        ByHand(plant, delay * PERIOD, limit * part, mass=mass, method=method).growth() for part in (1 - 1e-6, 1 + 1e-6)
    )
    assert below < 1.0 < above


def test_the_exact_method_allows_more_stiffness_than_forward_euler() -> None:
    exact, euler = (
        stiffness_limit(BENCH, PERIOD, 0.33e-3, sprung_mass(0.1, method)) for method in ("exact-foh", "forward-euler")
    )
    assert 0.0 < 5 * euler < exact


def test_the_loop_matrix_has_the_eigenvalues_of_the_loop_written_by_hand() -> None:
    plant = replace(BENCH, torque_lag=LAG)
    ours = np.linalg.eigvals(alone(plant, PERIOD, 1.3e-3).matrix(wall(900.0, 0.7)))
    by_hand = np.linalg.eigvals(ByHand(plant, 1.3e-3, 900.0, 0.7).period_map())
    for mode in ours:
        assert np.abs(by_hand - mode).min() < 1e-7


@pytest.mark.parametrize("mass", [1e-3, 0.1, 0.63, 20.0])
@pytest.mark.parametrize("damping", [0.2, 1.58, 30.0])
def test_the_plain_wall_has_the_limit_of_jury(mass: float, damping: float) -> None:
    pole = math.exp(-damping * PERIOD / mass)
    lag = -math.expm1(-damping * PERIOD / mass) * mass / damping
    ahead, behind = PERIOD - lag, lag - pole * PERIOD  # b·G(z)·(z − 1)·(z − a) = ahead·z + behind
    limits = [damping * (1 - pole) / behind]
    if ahead > behind:
        limits.append(2 * damping * (1 + pole) / (ahead - behind))
    found = stiffness_limit(Plant(mass, damping), PERIOD, 0.0, wall)
    assert found == pytest.approx(min(limits), rel=1e-6 if damping * PERIOD / mass < 1e-4 else 1e-8)


@pytest.mark.parametrize("delay", DELAYS)
def test_for_light_damping_the_limit_is_damping_over_the_mean_age_of_the_force(delay: float) -> None:
    plant = Plant(5.0, 0.5)
    expected = 0.5 / (PERIOD / 2 + delay * PERIOD)
    assert stiffness_limit(plant, PERIOD, delay * PERIOD, wall) == pytest.approx(expected, rel=2e-3)


def test_an_undamped_device_has_no_stable_stiffness_at_all() -> None:
    assert stiffness_limit(Plant(0.5, 0.0), PERIOD, 0.0, wall) == 0.0
    assert stiffness_limit(Plant(0.5, 0.0, torque_lag=LAG), PERIOD, 1e-3, wall) == 0.0


def test_virtual_damping_gives_an_undamped_device_a_limit() -> None:
    assert stiffness_limit(Plant(0.5, 0.0), PERIOD, 0.0, with_damping(2.0)) > 100.0


def test_with_delay_virtual_damping_helps_up_to_a_point_and_then_hurts() -> None:
    limits = [stiffness_limit(BENCH, PERIOD, 1e-3, with_damping(damping)) for damping in (0.0, 260.0, 500.0, 1000.0)]
    assert limits[0] < limits[1] > limits[2] > limits[3] == 0.0


def test_a_massless_handle_is_a_plant_too() -> None:
    """x⁺ = x·(1 − K·T/b)."""
    assert stiffness_limit(Plant(0.0, 1.5), PERIOD, 0.0, wall) == pytest.approx(2 * 1.5 / PERIOD)
    lagging = stiffness_limit(Plant(0.0, 1.5, torque_lag=LAG), PERIOD, 0.0, wall)
    almost = stiffness_limit(Plant(1e-7, 1.5, torque_lag=LAG), PERIOD, 0.0, wall)
    assert lagging == pytest.approx(almost, rel=1e-3)


def test_an_environment_that_never_destabilises_has_no_limit() -> None:
    found = judge(alone(BENCH, PERIOD, 0.0), lambda stiffness: wall(0.0), 100.0)[0]
    assert found.stiffness_limit.stable == math.inf
    assert found.to_json()["margin"] is None
    assert found.to_json()["stiffness_limit"] == {
        "passive": None,
        "stable": None,
        "quantisation": found.stiffness_limit.quantisation,
        "cautious": None,
    }


class TestNoLimit:
    """A virtual mass by backward Euler pulls like a mass however stiff its spring is."""

    @every("period", [1e-2, 1e-4])
    @every("mass", [1e-6, 0.5])
    @every("delay", [0.0, 0.4])
    def test_is_infinite_and_null_in_json(self, period: float, mass: float, delay: float) -> None:
        found = judge(alone(BENCH, period, delay * period), by_backward_euler(mass, period), 600.0)[0]
        assert found.stiffness_limit.stable == math.inf
        limits = found.to_json()["stiffness_limit"]
        assert isinstance(limits, dict)
        assert limits["stable"] is None
        assert found.to_json()["margin"] is None
        assert found.verdict is not Verdict.UNSTABLE

    @pytest.mark.parametrize("times", [1e2, 1e4, 1e6, 1e10])
    def test_is_so_in_fifty_digits(self, times: float) -> None:
        """The loop written out: device exact, z⁺ by solving the implicit equation; times m/T² + b/T."""
        stiffness = times * (BENCH.mass / PERIOD**2 + BENCH.damping / PERIOD)
        with mp.workdps(50):
            m, b, span, k, held = map(mp.mpf, (BENCH.mass, BENCH.damping, PERIOD, stiffness, 0.5))
            decay, square = mp.exp(-b * span / m), k / held * span**2
            slid, pushed = (1 - decay) * m / b, (1 - decay) / b
            moved = span / b - m / b * pushed

            def period(x: mp.mpf, v: mp.mpf, p: mp.mpf, q: mp.mpf) -> list[mp.mpf]:
                rate = (q + k / held * span * (x - p)) / (1 + square)
                p = p + span * rate
                force = k * (p - x)
                return [x + slid * v + moved * force, decay * v + pushed * force, p, rate]

            units = [[mp.mpf(int(row == column)) for row in range(4)] for column in range(4)]
            modes = mp.eig(mp.matrix([period(*unit) for unit in units]).T, left=False, right=False)
            sizes = sorted((abs(mode) for mode in modes), reverse=True)
        assert abs(sizes[0] - 1) < 1e-20  # everything pushed away at once
        assert float(sizes[1]) < 1.0

    def test_what_is_passive_below_a_limit_is_so_below_none_too(self) -> None:
        """Against the sweep at each stiffness; a virtual mass that loses its energy is passive up to some stiffness."""
        environment_of = by_backward_euler(0.5, PERIOD)
        limit = judge(alone(BENCH, PERIOD, 0.4e-3), environment_of, 600.0)[0].stiffness_limit.passive
        assert limit is not None
        for part in (1e-3, 0.1, 0.5, 0.999):
            assert damping_needed(environment_of(part * limit), PERIOD, 0.4e-3) < BENCH.damping
        assert damping_needed(environment_of(1.001 * limit), PERIOD, 0.4e-3) > BENCH.damping

    def test_a_wall_as_stiff_as_one_likes_has_one(self) -> None:
        """The largest stiffness looked at is far above any limit there is."""
        for mass, damping in ((1e-5, 100.0), (10.0, 1e-2), (0.6, 1.5)):
            scale = mass / PERIOD**2 + damping / PERIOD
            limits = [
                stiffness_limit(Plant(mass, damping), PERIOD, delay * PERIOD, with_damping(virtual))
                for delay in DELAYS
                for virtual in (0.0, 0.5 * mass / PERIOD)
            ]
            assert max(limits) < 1e-3 * LARGEST * scale


def by_backward_euler(mass: float, period: float) -> EnvironmentOf:
    return lambda stiffness: environment(
        SprungMass("handle", stiffness, mass).dynamics, period=period, method="backward-euler", estimator=None
    )


class TestVerdict:
    @pytest.mark.parametrize(
        ("stiffness", "coulomb", "resolution", "verdict"),
        [
            (1000.0, 0.25, 1.2e-5, Verdict.PASSIVE),
            (1000.0, 0.0, 0.0, Verdict.PASSIVE),
            (1550.0, 0.25, 1.2e-5, Verdict.STABLE),
            (1550.0, 0.0, 0.0, Verdict.STABLE),
            (1000.0, 0.005, 1.2e-5, Verdict.LIMIT_CYCLE),
            (1550.0, 0.005, 1.2e-5, Verdict.LIMIT_CYCLE),
            (1000.0, 0.0, 1.2e-5, Verdict.LIMIT_CYCLE),
            (1700.0, 0.25, 1.2e-5, Verdict.UNSTABLE),
            (1700.0, 0.0, 1.2e-5, Verdict.UNSTABLE),
        ],
    )
    def test_follows_the_table(self, stiffness: float, coulomb: float, resolution: float, verdict: Verdict) -> None:
        """passive to 1505, stable to 1597, quantisation at 2·fc/D"""
        plant = replace(BENCH, coulomb=coulomb, resolution=resolution, torque_lag=LAG)
        assert judge(alone(plant, PERIOD, 0.33e-3), wall, stiffness)[0].verdict is verdict

    @pytest.mark.parametrize(
        ("coulomb", "resolution", "limit"), [(0.3, 0.0, None), (0.0, 0.0, None), (0.0, 1e-5, 0.0), (0.3, 1e-5, 6e4)]
    )
    def test_the_quantisation_limit_is_null_without_an_encoder_step_and_zero_without_friction(
        self, coulomb: float, resolution: float, limit: float | None
    ) -> None:
        found = judge(alone(Plant(0.6, 1.5, coulomb, resolution), PERIOD, 0.0), wall, 10.0)[
            0
        ].stiffness_limit.quantisation
        assert found == (None if limit is None else pytest.approx(limit))

    def test_margin_is_the_limit_over_the_stiffness(self) -> None:
        found = judge(alone(BENCH, PERIOD, 0.0), wall, 600.0)[0]
        assert found.stiffness_limit.stable is not None
        assert found.margin == rounded_down(found.stiffness_limit.stable, 3) / 600.0

    def test_the_spectral_radius_is_that_of_the_whole_loop(self) -> None:
        found = judge(alone(BENCH, PERIOD, 0.5e-3), wall, 600.0)[0]
        assert found.spectral_radius == spectral_radius(alone(BENCH, PERIOD, 0.5e-3).matrix(wall(600.0)))
        assert found.spectral_radius < 1.0

    @pytest.mark.parametrize(
        ("damping", "verdict"),
        [(1.0, Verdict.PASSIVE), (1.57, Verdict.PASSIVE), (20.0, Verdict.STABLE), (5000.0, Verdict.UNSTABLE)],
    )
    def test_a_pure_damper_is_judged_without_stiffness(self, damping: float, verdict: Verdict) -> None:
        found = judge(alone(BENCH, PERIOD, 0.0), lambda stiffness: wall(stiffness, damping), None, damping)[0]
        assert found.verdict is verdict
        assert (found.stiffness, found.margin) == (None, None)
        assert set(found.to_json()["stiffness_limit"].values()) == {None}  # type: ignore[attr-defined]

    def test_free_space_is_passive(self) -> None:
        assert judge(alone(BENCH, PERIOD, 1e-3), lambda stiffness: wall(0.0), None)[0].verdict is Verdict.PASSIVE

    @pytest.mark.parametrize(("damping", "verdict"), [(0.0, Verdict.PASSIVE), (0.2, Verdict.STABLE)])
    def test_an_undamped_device_is_passive_with_no_force_only(self, damping: float, verdict: Verdict) -> None:
        loop = alone(Plant(1.0, 0.0), PERIOD, 0.0)
        assert judge(loop, lambda stiffness: wall(0.0, damping), None, damping)[0].verdict is verdict

    def test_an_undamped_device_is_unstable_at_the_softest_wall(self) -> None:
        assert judge(alone(Plant(1.0, 0.0), PERIOD, 0.0), wall, 1e-9)[0].verdict is Verdict.UNSTABLE

    def test_a_sprung_mass_may_be_pushed_away_and_stay_there(self) -> None:
        """Its loop has an eigenvalue of exactly 1, which is no instability."""
        found = judge(
            alone(replace(BENCH, resolution=0.0), PERIOD, 0.33e-3), sprung_mass(1.0, "exact-foh"), 600.0, 0.0
        )[0]
        assert found.spectral_radius == pytest.approx(1.0, abs=1e-12)
        assert found.verdict is Verdict.STABLE

    def test_json_has_the_documented_keys(self) -> None:
        found = judge(alone(BENCH, PERIOD, 0.33e-3), wall, 600.0)[0].to_json()
        assert list(found) == [
            "period_s", "delay_s", "plant", "stiffness", "damping", "limit",
            "stiffness_limit", "judged_at", "spectral_radius", "margin", "verdict", "own_laws",
        ]  # fmt: skip
        assert found["verdict"] == "passive"
        assert found["plant"] == {
            "mass": BENCH.mass,
            "damping": BENCH.damping,
            "coulomb": 0.2513,
            "resolution": 0.05 / 4096,
            "torque_lag": 0.0,
            "tachometer": False,
        }


@pytest.mark.parametrize(
    "wrong",
    [
        {"mass": -1.0},
        {"damping": math.nan},
        {"coulomb": -0.1},
        {"resolution": math.inf},
        {"torque_lag": -1e-3},
        {"mass": 0.0, "damping": 0.0},
    ],
)
def test_a_device_that_cannot_be_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        replace(Plant(mass=0.6, damping=1.5), **wrong)


@pytest.mark.parametrize(("rest", "branch", "time"), [(1900.0, 100.0, 0.01), (1500.0, 500.0, 0.1)])
def test_a_tissue_between_two_counts_swings_as_a_wall_of_its_stiffness_does(
    rest: float, branch: float, time: float
) -> None:
    """Friction of 0.05 N holds 1000 N/m at counts of 0.1 mm; the force of both swings by 0.2 N."""
    plant = Plant(0.6, 3.0, 0.05, 1e-4)

    def verdict(element: Element) -> Verdict:
        member = Member("a", plant, 0.0, (element,), "exact-foh", "backward-difference")
        return Group((member,), (), PERIOD).stability.verdict

    assert verdict(Wall("a", rest + branch)) is Verdict.LIMIT_CYCLE
    assert verdict(StandardLinearSolid("a", rest, branch, time)) is Verdict.LIMIT_CYCLE
    assert verdict(StandardLinearSolid("a", 0.4 * rest, 0.2 * branch, time)) is not Verdict.LIMIT_CYCLE

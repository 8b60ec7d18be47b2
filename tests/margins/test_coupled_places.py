"""Coupled axes at all places of their own elements, and couplings that something cuts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant, Verdict
from haptic_fieldbus.margins.closed_loop import Axis
from haptic_fieldbus.margins.coupled import CoupledAxes, has_potential
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.wall import Wall
from tests.loops import BENCH, LAG, PERIOD
from tests.pairs import PairByHand, shaft

AXES = ("a", "b")
LAGGING, LIGHT = replace(BENCH, torque_lag=LAG), Plant(0.05, 0.8, coulomb=0.01)


def pair(own: tuple[Element, ...], coupling: Coupling, effort: float = math.inf) -> Group:
    first = Member("a", LAGGING, 0.3e-3, own, None, "backward-difference", effort=effort)
    second = Member("b", LIGHT, 0.5e-3, (), None, "backward-difference", effort=effort)
    return Group((first, second), (coupling,), PERIOD)


def by_hand(held: float, ratio: float = 1.0) -> PairByHand:
    return PairByHand((LAGGING, LIGHT), (0.3, 0.5), 0.0, ratio, held)


@pytest.mark.thorough("judges two pairs", quick=1)
@pytest.mark.parametrize("ratio", [1.0, 0.4])
def test_a_shaft_that_a_damped_wall_calms_is_refused_for_where_the_wall_is_not(ratio: float) -> None:
    limit = by_hand(0.0, ratio).limit_near(CoupledAxes(by_hand(0.0, ratio).axes(), PERIOD).limit(shaft(0.0, ratio)))
    found = pair((Wall("a", 1.0, damping=3.0),), Coupling(AXES, 1.05 * limit, ratio=ratio)).stability
    assert by_hand(0.0, ratio).growth(1.05 * limit) > 1.0
    assert found.verdict is Verdict.UNSTABLE
    assert found.stiffness_limit.stable == pytest.approx(limit, rel=1e-6)


def test_a_body_that_stiffens_is_judged_at_each_of_its_slopes() -> None:
    """Of the slopes up to that of its depth, those of the pair by hand grow as the worst does."""
    body = HuntCrossley("a", 20.0, 0.01, exponent=2.0)
    group = pair((body,), Coupling(AXES, 200.0))
    slopes = np.linspace(0.0, 2.0 * 20.0 / 0.01, 60)
    worst = max(by_hand(float(slope)).growth(200.0) for slope in slopes)
    assert worst > 1.0
    assert group.growth() == pytest.approx(worst, rel=1e-6)


@pytest.mark.thorough("searches a limit at many places")
def test_a_crest_between_detents_is_no_reason_to_refuse_a_shaft() -> None:
    assert pair((Detents("a", 0.2, 0.01),), Coupling(AXES, 100.0)).stability.verdict is not Verdict.UNSTABLE
    assert pair((Detents("a", 6.0, 0.01),), Coupling(AXES, 100.0)).stability.verdict is Verdict.UNSTABLE


def test_a_shaft_with_play_is_also_judged_without_force() -> None:
    own = (Wall("a", 2500.0),)
    assert by_hand(2500.0).growth(1.0) > 1.0
    assert pair(own, Coupling(AXES, 200.0, damping=0.5, dead_band=1e-3)).stability.verdict is Verdict.UNSTABLE


@pytest.mark.thorough("searches 24 limits")
@pytest.mark.parametrize("delays", [(0.0, 0.0), (0.4, 1.7)])
@pytest.mark.parametrize("ratio", [1.0, -0.4])
def test_the_proof_for_a_shaft_that_is_cut_gives_nothing_away_without_a_damper(
    delays: tuple[float, float], ratio: float
) -> None:
    axes = [Axis(plant, delay * PERIOD) for plant, delay in zip((LAGGING, LIGHT), delays, strict=True)]
    exact, cut = CoupledAxes(axes, PERIOD), CoupledAxes(axes, PERIOD, is_linear=False)
    limit = exact.passive_limit(shaft(0.0, ratio), math.inf)
    assert cut.passive_limit(shaft(0.0, ratio), math.inf) == pytest.approx(limit, rel=1e-5)
    for damping in (0.05, 0.2):
        both = (each.passive_limit(shaft(damping, ratio), math.inf) for each in (cut, exact))
        assert 0.0 < next(both) <= next(both)


def around(ratio: float, efforts: tuple[float, float], own: float, seed: int) -> float:
    """Work of the cut forces of a shaft of 100 N/m, and of a spring on the first axis, around a drawn loop."""
    random, turn = np.random.default_rng(seed), np.linspace(0.0, 2.0 * np.pi, 20_001)
    first, second = (
        sum(random.normal() * np.sin(n * turn + 6.3 * random.random()) for n in (1, 2, 3)) for _ in range(2)
    )
    twist = 100.0 * (first - ratio * second)
    forces = np.clip(-twist - own * first, -efforts[0], efforts[0]), np.clip(ratio * twist, -efforts[1], efforts[1])
    middle = [0.5 * (force[1:] + force[:-1]) for force in forces]
    return float(middle[0] @ np.diff(first) + middle[1] @ np.diff(second))


@pytest.mark.thorough("integrates around 60 loops", quick=2)
@pytest.mark.parametrize("ratio", [1.0, -0.5])
@pytest.mark.parametrize("second", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("own", [0.0, 300.0])
def test_motors_that_cut_both_ends_at_the_same_twist_alone_keep_a_potential(
    ratio: float, second: float, own: float
) -> None:
    efforts = (50.0, 50.0 * abs(ratio) * second)
    works = [abs(around(ratio, efforts, own, seed)) for seed in range(5)]
    keeps = has_potential([Coupling(AXES, 100.0, ratio=ratio)], dict(zip(AXES, efforts, strict=True)), not own)
    assert keeps == (second == 1.0 and not own)
    assert keeps == (max(works) < 1e-2)


@pytest.mark.thorough("searches many limits")
def test_a_shaft_between_motors_that_may_cut_it_is_passive_only_where_that_is_proved() -> None:
    plain, calmed = Coupling(AXES, 100.0), Coupling(AXES, 100.0, saturation=40.0)
    assert pair((), plain, 50.0).stability.verdict is Verdict.PASSIVE
    assert pair((Wall("a", 100.0),), plain).stability.verdict is Verdict.PASSIVE
    assert pair((Wall("a", 100.0),), plain, 50.0).stability.verdict is Verdict.STABLE
    assert pair((), replace(plain, ratio=0.5), 50.0).stability.verdict is Verdict.STABLE
    assert pair((), replace(calmed, ratio=0.5), 50.0).stability.verdict is Verdict.PASSIVE


def test_a_shaft_to_an_axis_without_friction_is_not_passive_beside_an_encoder_that_rounds() -> None:
    free = replace(LIGHT, coulomb=0.0)
    first, second = pair((), Coupling(AXES, 100.0), 50.0).members
    group = Group((first, replace(second, plant=free)), (Coupling(AXES, 100.0),), PERIOD)
    assert group.stability.verdict is Verdict.STABLE

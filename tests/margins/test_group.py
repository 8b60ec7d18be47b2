"""Groups of axes, tied or by themselves: which hang together, what is varied, what would be stable, and by hand."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.margins import Suggestion, Verdict, passive_limit
from haptic_fieldbus.margins.group import Group, Member, connected
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.wall import Wall
from tests.loops import BENCH, LAG, PERIOD
from tests.pairs import PairByHand

PLANT = replace(BENCH, torque_lag=LAG)
OTHER = replace(PLANT, mass=0.2, damping=0.9)
BACKWARD = "backward-difference"


def tied(*couplings: Coupling, walls: tuple[float, ...] = ()) -> Group:
    names = list(dict.fromkeys(name for coupling in couplings for name in coupling.axes))
    members = []
    for place, name in enumerate(names):
        own = (Wall(name, stiffness=walls[place]),) if len(walls) > place and walls[place] else ()
        plant = (PLANT, OTHER)[place % 2]
        members.append(Member(name, plant, (0.5, 0.8)[place % 2] * PERIOD, own, None, BACKWARD))
    return Group(tuple(members), couplings, PERIOD)


def by_itself(*elements: Element) -> Group:
    return Group((Member("a", PLANT, 0.5 * PERIOD, elements, None, BACKWARD),), (), PERIOD)


def shaft(stiffness: float = 100.0, damping: float = 0.0, ratio: float | None = None, **more: object) -> Coupling:
    return Coupling(("a", "b"), stiffness, damping, ratio, **more)  # type: ignore[arg-type]


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize(("damping", "ratio", "wall"), [(0.0, 1.0, 0.0), (0.3, -2.0, 0.0), (0.3, 0.5, 300.0)])
def test_the_limit_is_that_of_the_pair_written_by_hand(damping: float, ratio: float, wall: float) -> None:
    found = list(tied(shaft(damping=damping, ratio=ratio), walls=(wall,)).stabilities().values())
    limit = found[0].stiffness_limit.stable
    assert limit is not None
    by_hand = PairByHand((PLANT, OTHER), (0.5, 0.8), damping, ratio, wall)
    assert limit == pytest.approx(by_hand.limit_near(limit), rel=1e-6)
    assert [each.plant for each in found] == [PLANT, OTHER]
    assert found[0].stiffness_limit == found[1].stiffness_limit
    assert found[0].damping == damping


@pytest.mark.parametrize("lag", [0.0, LAG, 3 * PERIOD])
def test_what_a_wall_asks_at_its_places_is_what_a_spring_asks_behind_a_torque_loop(lag: float) -> None:
    plant = replace(BENCH, torque_lag=lag)
    member = Member("a", plant, 0.3 * PERIOD, (Wall("a", stiffness=100.0),), None, BACKWARD, effort=20.0)
    found = Group((member,), (), PERIOD).stability.stiffness_limit.passive
    assert found == pytest.approx(passive_limit(plant, PERIOD, 0.3 * PERIOD), rel=1e-6)


def test_a_coupling_may_name_its_axes_the_other_way_round() -> None:
    one = tied(shaft(damping=0.3, ratio=2.0))
    turned = replace(one, couplings=(Coupling(("b", "a"), 100.0 * 2.0**2, 0.3 * 2.0**2, 1 / 2.0),))
    first, second = one.stability.stiffness_limit.stable, turned.stability.stiffness_limit.stable
    assert first is not None
    assert second == pytest.approx(4.0 * first, rel=1e-6)
    assert (one.reference_axis, turned.reference_axis) == ("a", "b")


def test_two_couplings_side_by_side_are_one_of_their_sum() -> None:
    both = tied(shaft(100.0), replace(shaft(40.0), name="second"))
    alone = tied(shaft(140.0)).stability.stiffness_limit.stable
    found = both.stability.stiffness_limit.stable
    assert alone is not None
    assert found == pytest.approx(alone - 40.0, rel=1e-6)
    assert both.stiffest == both.couplings[0]


def test_three_axes_in_a_row_are_one_loop() -> None:
    """The middle axis feels both shafts: less stiff than a pair may be, and stable in the package's own judgement."""
    chain = tied(shaft(200.0), Coupling(("b", "c"), 200.0, name="second"))
    found = list(chain.stabilities().values())
    pair = tied(shaft(200.0)).stability
    assert len(found) == 3
    assert found[0].stiffness_limit.stable is not None
    assert pair.stiffness_limit.stable is not None
    assert 0.0 < found[0].stiffness_limit.stable < pair.stiffness_limit.stable


def test_axes_hang_together_through_others() -> None:
    couplings = [Coupling(("c", "a"), 1.0), Coupling(("e", "c"), 1.0), Coupling(("b", "f"), 1.0)]
    assert list(connected("abcdef", couplings)) == [("a", "c", "e"), ("b", "f"), ("d",)]
    assert list(connected("ab", [])) == [("a",), ("b",)]


@pytest.mark.thorough("searches a limit for each friction")
def test_less_friction_lowers_the_limit() -> None:
    one = tied(shaft(damping=0.1))
    weak = one.weakened(0.7)
    assert [member.plant.damping for member in weak.members] == [0.7 * PLANT.damping, 0.7 * OTHER.damping]
    before, after = one.stability.stiffness_limit.stable, weak.stability.stiffness_limit.stable
    assert before is not None
    assert after is not None
    assert after < 0.9 * before


@pytest.mark.thorough("judges many groups")
def test_what_is_suggested_is_stable() -> None:
    wrong = tied(shaft(3000.0, 0.1))
    assert wrong.stability.verdict is Verdict.UNSTABLE
    found = wrong.suggested()
    assert found.stiffness is not None
    assert tied(shaft(found.stiffness, 0.1)).stability.verdict is not Verdict.UNSTABLE
    assert found.damping is not None
    damped = tied(shaft(3000.0, found.damping)).stability
    assert damped.verdict is not Verdict.UNSTABLE
    assert damped.limit.value == pytest.approx(found.damping_limit, rel=0.01)
    assert damped.is_inside


@pytest.mark.thorough("searches a limit for each damping")
def test_limits_over_damping_are_those_of_a_coupling_with_that_damping() -> None:
    one, other = tied(shaft(damping=0.1)), tied(shaft(damping=0.4)).stability.stiffness_limit
    stable = one.limit(0.4)
    assert stable == pytest.approx(other.stable)
    assert one.passive_limit(0.4, stable) == pytest.approx(other.passive)


def test_the_largest_damping_moves_the_lighter_end_by_as_much_as_it_moved() -> None:
    assert tied(shaft()).largest_damping == pytest.approx(OTHER.mass / PERIOD)
    assert tied(shaft(ratio=0.1)).largest_damping == pytest.approx(PLANT.mass / PERIOD)


def test_growth_is_that_of_the_loop_as_it_is() -> None:
    one = tied(shaft(300.0, 0.2, -2.0))
    assert one.growth() == pytest.approx(PairByHand((PLANT, OTHER), (0.5, 0.8), 0.2, -2.0).growth(300.0), abs=1e-9)


def test_a_wall_that_is_unstable_by_itself_leaves_no_stiffness_to_the_coupling() -> None:
    limit = by_itself(Wall("a", 100.0)).stability.stiffness_limit.stable
    assert limit is not None
    found = tied(shaft(), walls=(1.2 * limit,)).stability
    assert found.verdict is Verdict.UNSTABLE
    assert found.stiffness_limit.stable == 0.0
    assert found.margin == 0.0
    assert math.isfinite(found.spectral_radius)


def test_an_axis_by_itself_varies_its_stiffest_element_and_keeps_the_rest() -> None:
    """Two walls side by side are one of their sum."""
    soft, stiff = Wall("a", 100.0, damping=0.3), Wall("a", 400.0)
    both, whole = by_itself(soft, stiff), by_itself(Wall("a", 500.0, damping=0.3)).stability
    assert both.stiffest is stiff
    assert (both.reference_axis, both.stability.stiffness, both.stability.damping) == ("a", 400.0, 0.3)
    assert both.stability.spectral_radius == pytest.approx(whole.spectral_radius, rel=1e-12)
    for found, expected in (
        (both.stability.stiffness_limit.stable, whole.stiffness_limit.stable),
        (both.stability.stiffness_limit.passive, whole.stiffness_limit.passive),
        (both.limit(0.0), whole.stiffness_limit.stable),
        (both.passive_limit(0.0, math.inf), whole.stiffness_limit.passive),
    ):
        assert expected is not None
        assert found == pytest.approx(expected - 100.0, rel=1e-6)
    assert both.largest_damping == pytest.approx(PLANT.mass / PERIOD)
    assert both.uncoupled() == ()


def test_what_has_no_stiffness_has_nothing_to_suggest() -> None:
    free = by_itself(Damper("a", 5000.0))
    assert (free.stiffest, free.stability.stiffness, free.stability.verdict) == (None, None, Verdict.UNSTABLE)
    assert free.suggested() == Suggestion(None, None, None)


def test_coupled_axes_by_themselves_keep_their_elements_and_nothing_else() -> None:
    pair = tied(shaft(), walls=(300.0,))
    first, second = pair.uncoupled()
    assert first.stability == by_itself(Wall("a", 300.0)).stability
    assert (first.reference_axis, second.reference_axis, second.couplings, second.stiffest) == ("a", "b", (), None)

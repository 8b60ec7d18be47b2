"""Elements without bounds of their own: judged by their force wherever the motor can hold the handle, or told."""

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.margins.stiffness_map import EVERYWHERE, OwnLaw, Places
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.constant import Constant
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.element import Element, Interval
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.signals import Signal
from tests.margins.own_drawn import BoundedPolynomial, OwnTrial, Remembering, Stated, own_loop
from tests.margins.test_claims import assert_no_false_verdict, told
from tests.telling import TOLD

PLANT = Plant(4e-5, 1e-4, torque_lag=0.159e-3)
PERIOD, DELAY, EFFORT = 1e-3, 0.4e-3, 0.4


def hardening(position: float) -> float:
    return -0.05 * position - 1e4 * position**3


def group(*elements: Element, travel: Interval = EVERYWHERE, effort: float = EFFORT) -> Group:
    member = Member("a", PLANT, DELAY, elements, None, "backward-difference", effort=effort, travel=travel)
    return Group((member,), (), PERIOD)


def own_law(element: Element, travel: Interval = EVERYWHERE, effort: float = EFFORT) -> OwnLaw:
    (found,) = group(element, travel=travel, effort=effort).stability.own_laws
    return found


@pytest.mark.thorough("simulates 300 drawn own elements", quick=("few",))
@pytest.mark.parametrize(
    ("batch", "size", "periods"), [pytest.param(0, 10, 2100, id="few"), pytest.param(1, 300, 7000, id="batch")]
)
def test_no_own_element_is_called_better_than_it_is(batch: int, size: int, periods: int, record_property: Any) -> None:
    random = np.random.default_rng(4200 + batch)
    trial = OwnTrial([own_loop(random) for _ in range(size)], 9)
    grows = assert_no_false_verdict(trial, random, periods)
    record_property(TOLD, f"own elements: {told(batch, trial, grows.reshape(9, size), np.arange(9) % 3 == 0)}")


def test_a_spring_that_hardens_is_refused_where_it_is_steep_and_told_with_its_slope() -> None:
    found = group(Stated(hardening)).stability
    assert found.verdict is Verdict.UNSTABLE
    (law,) = found.own_laws
    (end,) = [each.real for each in np.roots([1e4, 0.0, 0.05, -EFFORT]) if abs(each.imag) < 1e-12]
    assert law.steepest == pytest.approx(0.05 + 3e4 * end**2, rel=2e-3)
    assert law.is_steeper
    assert group(Stated(hardening), travel=(-1e-3, 1e-3)).stability.verdict is Verdict.STABLE


def test_a_law_that_keeps_what_it_states_is_judged_as_the_spring_of_the_package() -> None:
    """All but the proof for any hand: reading a force at places proves nothing between them."""
    ours = group(Spring("a", 0.05)).stability
    theirs = group(Stated(lambda x: -0.05 * x)).stability
    assert theirs.spectral_radius == pytest.approx(ours.spectral_radius, abs=1e-9)
    assert (ours.own_laws, theirs.own_laws[0].is_steeper) == ((), False)
    assert theirs.verdict is Verdict.STABLE


def test_what_is_stated_counts_where_it_is_stiffer_than_what_is_read() -> None:
    assert group(Stated(lambda x: -0.05 * x, 0.3)).stability.verdict is Verdict.UNSTABLE


@pytest.mark.parametrize("travel", [(-0.1, 0.1), EVERYWHERE], ids=["limited", "unlimited"])
@pytest.mark.parametrize("pitch", [1e-3, 0.02])
def test_no_pitch_hides_between_the_places(travel: Interval, pitch: float) -> None:
    turn = 2.0 * math.pi / pitch
    law = own_law(Stated(lambda x: -math.sin(turn * x) / turn), travel)
    assert law.steepest == pytest.approx(1.0, rel=1e-3)


def test_a_wall_that_the_motor_ends_within_a_tenth_of_a_millimetre_is_found() -> None:
    law = own_law(Stated(lambda x: -5e4 * max(x - 0.0312345, 0.0)), (-0.5, 0.5))
    assert law.steepest == pytest.approx(5e4, rel=1e-3)
    assert law.position == pytest.approx(0.0312345, abs=2e-5)


def test_a_jump_is_as_steep_as_the_places_are_close() -> None:
    assert own_law(Stated(lambda x: -0.1 if x > 0.2 else 0.0), (-1.0, 1.0)).steepest > 1e3


def test_a_force_of_velocity_is_read_at_rest() -> None:
    both = (Signal.POSITION, Signal.VELOCITY)
    wall = Stated(lambda x, v: min(-0.05 * x - 2e-4 * v, 0.0) if x > 0.0 else 0.0, 0.01, both)
    places = cast("Places", group(wall).environment())
    (inside,) = np.nonzero(places.stiffness > 0.03)
    assert len(inside)
    np.testing.assert_allclose(places.damping[inside], 2e-4, rtol=1e-6)
    assert own_law(wall).beyond == ("velocity",)
    assert own_law(Stated(lambda v: -0.001 * v, 0.0, (Signal.VELOCITY,))).steepest == 0.0


def test_places_without_a_number_are_left_out_and_other_errors_are_not() -> None:
    def rooted(x: float) -> float:
        return -0.01 * math.sqrt(x + 1.0) if x < 1e3 else -math.exp(x)

    assert math.isfinite(own_law(Stated(rooted)).steepest)
    assert own_law(Stated(lambda x: -0.05 * x**1.5)).places > 100  # complex below 0
    nowhere = own_law(Stated(lambda x: math.nan))
    assert (nowhere.places, nowhere.stated) == (0, own_law(Stated(lambda x: -0.05 * x)).stated)
    assert math.isnan(nowhere.steepest)
    with pytest.raises(KeyError):
        own_law(Stated(lambda x: {}[x]))
    with pytest.raises(TypeError, match="subscriptable"):
        own_law(Stated(lambda x: x[0]))


def test_without_limits_of_travel_and_motor_a_turn_to_either_side_is_read() -> None:
    law = own_law(Stated(lambda x: -0.05 * x), effort=math.inf)
    assert law.travel == (-2.0 * math.pi, 2.0 * math.pi)


class TestPushedAwayWithoutEnd:
    def softening(self, sign: float = 1.0) -> Stated:
        return Stated(lambda x: -0.05 * x + 0.05 * x**3 * (sign * x > 0.0))

    @pytest.mark.parametrize("sign", [1.0, -1.0])
    def test_it_is_refused_on_a_travel_without_end_alone(self, sign: float) -> None:
        found = group(self.softening(sign)).stability
        assert (found.verdict, found.own_laws[0].runs_off) == (Verdict.UNSTABLE, True)
        limited = group(self.softening(sign), travel=(-3.0, 3.0)).stability
        assert (limited.verdict, limited.own_laws[0].runs_off) == (Verdict.STABLE, False)

    def test_a_spring_beside_it_that_wins_holds_it(self) -> None:
        stiff = Stated(lambda x: -0.06 * x**3 * (x > 0.0), name="stiff")
        assert not any(law.runs_off for law in group(self.softening(), stiff).stability.own_laws)

    def test_a_constant_push_and_detents_are_as_those_of_the_package(self) -> None:
        for law in (lambda x: 0.1, math.sin, lambda x: 0.1 + 0.01 * math.sin(x)):
            assert not own_law(Stated(law)).runs_off
        assert group(Constant("a", 0.1)).stability.verdict is not Verdict.UNSTABLE

    def test_bounds_of_its_own_do_not_hide_it(self) -> None:
        bounded = BoundedPolynomial("a", 0.05, 0.0, 0.05, cube=-1.0)
        found = group(bounded, travel=(-3.0, math.inf)).stability
        assert (found.verdict, [law.runs_off for law in found.own_laws]) == (Verdict.UNSTABLE, [True])
        assert group(bounded, travel=(-3.0, 3.0)).stability.own_laws == ()

    def test_coupled_axes_are_refused_with_it(self) -> None:
        members = [
            Member(name, PLANT, DELAY, own, None, "backward-difference", effort=EFFORT)
            for name, own in (("a", (self.softening(),)), ("b", ()))
        ]
        found = Group(tuple(members), (Coupling(("a", "b"), 0.02),), PERIOD)
        assert found.stability.verdict is Verdict.UNSTABLE
        assert found.stability.own_laws[0].runs_off


def test_an_element_with_a_memory_is_judged_by_what_it_states_and_says_so() -> None:
    law = own_law(Remembering())
    assert (law.places, law.stated, law.beyond) == (0, 0.05, ("memory", "elapsed time"))
    assert not law.is_steeper
    assert law.to_json()["steepest"] is None


def test_an_element_that_cannot_be_hashed_is_judged_too() -> None:
    @dataclass(frozen=True)
    class Loose(Stated):
        def __hash__(self) -> int:
            raise TypeError("unhashable")

    assert own_law(Loose(hardening)).is_steeper


def test_a_force_that_counts_its_calls_is_not_disturbed() -> None:
    @dataclass
    class Counting:
        axis: str = "a"
        name: str = "counting"
        needs: tuple[Signal, ...] = (Signal.POSITION,)
        calls: int = 0

        def force(self, position: float) -> float:
            self.calls += 1
            return 0.0

        def linearised(self) -> StateSpace:
            return gain([[0.0, 0.0]])

    counting = Counting()
    assert own_law(counting).places > 100
    assert counting.calls == 0


def test_the_stiffness_that_varies_is_read_again() -> None:
    @dataclass(frozen=True)
    class Scaled(Stated):
        stiffness: float = 0.05

        def force(self, *values: float) -> float:
            return self.stiffness * self.law(*values)

    ours = group(Spring("a", 0.05)).rough_limit()
    assert group(Scaled(lambda x: -x, 0.0)).rough_limit() == pytest.approx(ours, rel=1e-5)

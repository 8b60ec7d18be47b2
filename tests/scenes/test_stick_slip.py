"""Stick-slip against its saw tooth."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.stick_slip import StickSlip
from tests.scenes.leaps import along, leaps
from tests.scenes.sheet import Motion, forces, given_to_the_hand, spring_leak

SLIP = StickSlip("handle", stiffness=800.0, breakaway=2.0)
TOOTH = 2.0 / 800.0


@pytest.mark.parametrize("moves", [7, 50, 333])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_steady_way_gives_the_saw_tooth_at_any_speed(moves: int, way: float) -> None:
    """Also with several teeth in one move."""
    place = np.linspace(0.0, 0.0523, moves + 1)
    found = forces(SLIP, Motion(1e-3, 0.3 + way * place, np.zeros(moves + 1)))
    np.testing.assert_allclose(found, -way * 800.0 * np.mod(place, TOOTH), atol=1e-9)


def test_each_tooth_costs_what_its_spring_held() -> None:
    motion = along([0.0, 20.5 * TOOTH], 41 * 2000)
    work = -given_to_the_hand(motion, forces(SLIP, motion), held=False)
    assert work == pytest.approx((20 + 0.25) * 0.5 * 2.0**2 / 800.0, rel=2e-4)


def test_within_a_tooth_the_handle_gets_back_what_it_gave() -> None:
    motion = along([0.0, 0.99 * TOOTH, -0.99 * TOOTH, 0.0], 100)
    assert given_to_the_hand(motion, forces(SLIP, motion), held=False) == pytest.approx(0.0, abs=1e-15)


@settings(derandomize=True)
@given(motion=leaps(8e-3))
def test_it_leaks_when_sampled_no_more_than_its_spring(motion: Motion) -> None:
    given_away = given_to_the_hand(motion, forces(SLIP, motion), held=True)
    assert given_away <= spring_leak(800.0, motion) * (1.0 + 1e-9) + 1e-15


@settings(derandomize=True)
@given(places=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_it_is_never_above_breakaway_and_raises_nothing(places: list[float]) -> None:
    law = SLIP.begin(1e-3)
    for place in places:
        assert not abs(law(place)) > 2.0 * (1.0 + 1e-12)


def test_a_way_beyond_all_numbers_is_no_number() -> None:
    law = SLIP.begin(1e-3)
    law(-1.7e308)
    assert math.isnan(law(1.7e308))


@pytest.mark.parametrize("wrong", [{"breakaway": 0.0}, {"stiffness": 0.0}, {"breakaway": math.inf}, {"window": 1.0}])
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(StickSlip).validate_python({"axis": "handle", "breakaway": 1.0, "stiffness": 600.0, **wrong})

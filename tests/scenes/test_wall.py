"""The wall: sign, what it never does, and what stability is told about it."""

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

Side = Literal["positive", "negative"]
SIDES: tuple[Side, ...] = ("positive", "negative")
lengths = st.floats(-0.2, 0.2)
speeds = st.floats(-3.0, 3.0)


@pytest.mark.parametrize(("side", "into"), [("positive", 1.0), ("negative", -1.0)])
class TestAWallOnOneSide:
    def test_pushes_out_of_its_material_by_stiffness_times_penetration(self, side: Side, into: float) -> None:
        wall = Wall("handle", stiffness=600.0, position=0.02, side=side)
        assert wall.force(0.02 + into * 0.003) == pytest.approx(-into * 1.8)

    def test_gives_exactly_zero_outside_and_at_its_surface(self, side: Side, into: float) -> None:
        wall = Wall("handle", stiffness=600.0, position=0.02, damping=5.0, side=side)
        assert [wall.force(0.02 - into * depth, into) for depth in (0.0, 1e-12, 0.5)] == [0.0, 0.0, 0.0]

    def test_damping_adds_on_the_way_in_and_takes_on_the_way_out(self, side: Side, into: float) -> None:
        wall = Wall("handle", stiffness=600.0, damping=5.0, side=side)
        assert wall.force(into * 0.01, into * 0.1) == pytest.approx(-into * 6.5)
        assert wall.force(into * 0.01, -into * 0.1) == pytest.approx(-into * 5.5)

    def test_never_pulls_back_a_handle_that_leaves_fast(self, side: Side, into: float) -> None:
        wall = Wall("handle", stiffness=600.0, damping=5.0, side=side)
        assert wall.force(into * 0.01, -into * 2.0) == 0.0

    def test_decelerates_a_handle_that_enters(self, side: Side, into: float) -> None:
        """A mass thrown at the wall turns round: the sign that the classic pseudocode has wrong."""
        wall, mass, step = Wall("handle", stiffness=600.0, position=into * 0.02, side=side), 0.5, 1e-5
        position, velocity = 0.0, into * 0.4
        for _ in range(20_000):
            velocity += step * wall.force(position) / mass
            position += step * velocity
        assert velocity == pytest.approx(-into * 0.4, rel=1e-2)


@settings(derandomize=True)
@given(position=lengths, velocity=speeds, surface=lengths, damping=st.floats(0, 50), side=st.sampled_from(SIDES))
def test_its_force_is_that_of_its_mirror_image_mirrored(
    position: float, velocity: float, surface: float, damping: float, side: Side
) -> None:
    wall = Wall("handle", stiffness=700.0, position=surface, damping=damping, side=side)
    mirrored = Wall("handle", stiffness=700.0, position=-surface, damping=damping, side=SIDES[1 - SIDES.index(side)])
    assert wall.force(position, velocity) == -mirrored.force(-position, -velocity)


@settings(derandomize=True)
@given(position=lengths, velocity=speeds, side=st.sampled_from(SIDES))
def test_it_takes_power_whenever_the_spring_does_not_give_it_back(position: float, velocity: float, side: Side) -> None:
    """Passive in continuous time: what it gives beyond the spring's energy is never positive."""
    wall = Wall("handle", stiffness=700.0, damping=9.0, position=0.01, side=side)
    spring = Wall("handle", stiffness=700.0, position=0.01, side=side)
    assert wall.force(position, velocity) * velocity <= spring.force(position) * velocity + 1e-12


@settings(derandomize=True)
@given(position=lengths, velocity=speeds, side=st.sampled_from(SIDES))
def test_a_bilateral_wall_is_a_spring_and_a_damper_about_its_position(
    position: float, velocity: float, side: Side
) -> None:
    wall = Wall("handle", stiffness=700.0, damping=9.0, position=0.01, sides="bilateral", side=side)
    assert wall.force(position, velocity) == pytest.approx(-700.0 * (position - 0.01) - 9.0 * velocity)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("sides", ["unilateral", "bilateral"])
def test_a_position_that_is_no_number_gives_a_force_that_is_none(
    side: Side, sides: Literal["unilateral", "bilateral"]
) -> None:
    assert math.isnan(Wall("handle", stiffness=700.0, side=side, sides=sides).force(math.nan))


def test_it_asks_for_velocity_only_when_it_has_damping() -> None:
    assert Wall("handle", stiffness=600.0).needs == (Signal.POSITION,)
    assert Wall("handle", stiffness=600.0, damping=0.1).needs == (Signal.POSITION, Signal.VELOCITY)
    assert not Wall("handle", stiffness=600.0).linearised().uses_velocity


def test_stability_is_judged_by_the_contact() -> None:
    np.testing.assert_array_equal(Wall("handle", stiffness=600.0, damping=2.0).linearised().d, [[-600.0, -2.0]])


@pytest.mark.parametrize(
    "wrong",
    [
        {"stiffness": 0.0},
        {"stiffness": -1.0},
        {"stiffness": math.nan},
        {"stiffness": math.inf},
        {"damping": -0.1},
        {"damping": math.nan},
        {"position": math.inf},
        {"sides": "both"},
        {"side": "left"},
        {"mass": 1.0},
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Wall).validate_python({"axis": "handle", "stiffness": 600.0, **wrong})

"""The proxy: the side from which the handle came, at any depth and speed."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.scenes.proxy import Proxy
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

PROXY = Proxy("handle", stiffness=600.0, position=0.02)
places = st.floats(-1e3, 1e3)


@settings(derandomize=True)
@given(first=places, rest=st.lists(places, max_size=20))
def test_it_is_for_ever_the_wall_of_the_side_that_it_was_begun_from(first: float, rest: list[float]) -> None:
    """However far and fast the handle goes: no push through, even by jumps of a kilometre."""
    force = PROXY.begin(1e-3)
    assert force(first) == 0.0
    if first == 0.02:
        return
    wall = Wall("handle", stiffness=600.0, position=0.02, side="positive" if first < 0.02 else "negative")
    assert [force(x) for x in rest] == pytest.approx([wall.force(x) for x in rest])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_handle_that_begins_on_the_surface_belongs_to_where_it_goes_first(side: float) -> None:
    force = PROXY.begin(1e-3)
    assert [force(0.02), force(0.02), force(0.02 + side * 1e-9)] == [0.0, 0.0, 0.0]
    assert force(0.02 - side * 0.01) == pytest.approx(side * 6.0)


@settings(derandomize=True)
@given(
    depth=st.floats(0.0, 0.1),
    speed=st.floats(-5.0, 5.0),
    damping=st.floats(0.0, 50.0),
    side=st.sampled_from([-1.0, 1.0]),
)
def test_it_never_pulls(depth: float, speed: float, damping: float, side: float) -> None:
    """And where it pushes it is the spring and the damper."""
    force = Proxy("handle", stiffness=600.0, damping=damping).begin(1e-3)
    force(side, 0.0)
    found = side * force(-side * depth, speed)
    assert found >= 0.0
    if found:
        assert found == pytest.approx(600.0 * depth - side * damping * speed)


def test_it_remembers_nothing_of_an_earlier_run() -> None:
    PROXY.begin(1e-3)(1.0)
    assert PROXY.begin(1e-3)(-1.0) == 0.0


def test_a_position_that_is_no_number_gives_a_force_that_is_none() -> None:
    force = PROXY.begin(1e-3)
    assert math.isnan(force(math.nan))
    assert math.isnan(force(math.nan))


def test_it_needs_the_velocity_only_for_its_damper() -> None:
    assert PROXY.needs == (Signal.POSITION,)
    assert Proxy("handle", stiffness=600.0, damping=1.0).needs == (Signal.POSITION, Signal.VELOCITY)

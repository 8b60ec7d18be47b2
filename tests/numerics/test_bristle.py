"""The bristle: exact against the differential equation, never longer than steady sliding stretches it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from haptic_fieldbus.numerics.relaxation import SAMPLED_EXCESS, advance, bind

moves = st.floats(-1.0, 1.0)
steadies = st.floats(1e-5, 1.0)


@pytest.mark.parametrize("move", [-3e-3, -1e-5, 2e-4, 5e-3])
@pytest.mark.parametrize("start", [-1.4e-3, 0.0, 0.9e-3])
def test_a_move_is_that_of_the_differential_equation(start: float, move: float) -> None:
    steady, way = 1e-3, math.copysign(1.0, move)
    found = solve_ivp(lambda u, z: way - z / steady, (0.0, abs(move)), [start], rtol=1e-12, atol=1e-16)
    assert advance(start, move, steady) == pytest.approx(found.y[0, -1], rel=1e-9, abs=1e-14)


@settings(derandomize=True)
@given(share=st.floats(-1.0, 1.0), first=st.floats(0.0, 1.0), second=st.floats(0.0, 1.0), steady=steadies)
def test_two_moves_one_way_are_one_move(share: float, first: float, second: float, steady: float) -> None:
    twice = advance(advance(share * steady, first, steady), second, steady)
    assert twice == pytest.approx(advance(share * steady, first + second, steady), rel=1e-9, abs=1e-12 * steady)


@settings(derandomize=True)
@given(
    share=st.floats(-1.0, 1.0),
    move=st.floats(allow_nan=False, allow_infinity=False),
    steady=st.floats(1e-9, 1e9),
)
def test_no_move_stretches_it_further_than_steady_sliding(share: float, move: float, steady: float) -> None:
    assert abs(advance(share * steady, move, steady)) <= steady * (1.0 + 1e-15)


def test_a_small_move_stretches_a_relaxed_bristle_by_itself() -> None:
    assert advance(0.0, 1e-15, 1.0) == pytest.approx(1e-15, rel=1e-12)
    assert advance(0.3, 0.0, 1.0) == 0.3
    assert math.isnan(advance(0.3, math.nan, 1.0))


def test_it_leaks_when_held_at_most_as_much_more_than_a_spring_as_it_says() -> None:
    """Any stretch up to ten times the steady one, as after a fall of the friction; moves of any size."""
    stretch = np.linspace(-10.0, 10.0, 1001)[:, None]
    move = np.geomspace(1e-3, 1e3, 3001)[None, :]
    after = stretch - (1.0 - stretch) * np.expm1(-move)
    given_beyond_the_stored = -stretch * move + 0.5 * (after**2 - stretch**2)
    excess = float((given_beyond_the_stored / (0.5 * move**2)).max())
    assert excess == pytest.approx(SAMPLED_EXCESS, abs=1e-3)
    assert excess <= SAMPLED_EXCESS


@settings(derandomize=True)
@given(way=st.lists(moves, max_size=30), start=moves)
def test_its_force_is_within_its_friction_along_any_way(way: list[float], start: float) -> None:
    law = bind(500.0, 2.0)
    assert law(start) == 0.0
    forces = [law(start + float(place)) for place in np.cumsum(way)]
    assert max(map(abs, forces), default=0.0) <= 2.0 * (1.0 + 1e-12)

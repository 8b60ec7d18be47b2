"""The spring condition: its law, its energy in closed form, and what is refused."""

import itertools
import math

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.signals import Signal
from tests.scenes.sheets.spring import stored

PLAY = Spring(
    "handle", stiffness=500.0, position=0.01, dead_band=0.002, positive_saturation=3.0, negative_saturation=2.0
)


def test_it_pulls_to_its_rest_position_from_both_sides() -> None:
    force = Spring("handle", stiffness=500.0, position=0.01).force
    assert [force(place) for place in (0.012, 0.01, 0.008)] == pytest.approx([-1.0, 0.0, 1.0])


def test_it_is_free_within_the_dead_band_and_bounded_by_its_saturations() -> None:
    places = [-1.0, 0.005, 0.0081, 0.01, 0.0119, 0.013, 1.0]
    assert [PLAY.force(place) for place in places] == pytest.approx([2.0, 1.5, 0.0, 0.0, 0.0, -0.5, -3.0])


def test_each_side_has_its_share_of_stiffness_and_damping() -> None:
    force = Spring("handle", stiffness=500.0, damping=4.0, negative_coefficient=0.25).force
    assert [force(0.01, 0.1), force(-0.01, 0.1)] == pytest.approx([-5.4, 1.15])


def test_saturation_bounds_the_damping_too() -> None:
    force = Spring("handle", stiffness=500.0, damping=50.0, positive_saturation=3.0).force
    assert [force(0.004, 1.0), force(0.004, -1.0), force(0.004, 0.0)] == [-3.0, 3.0, -2.0]


@settings(derandomize=True)
@given(position=st.floats(-0.05, 0.05))
def test_the_work_against_it_is_what_it_stores(position: float) -> None:
    corners = [PLAY.position + side * (0.002 + limit / 500.0) for side, limit in ((1, 3.0), (-1, 2.0))]
    edges = [PLAY.position - 0.002, PLAY.position + 0.002]
    low, high = sorted((PLAY.position, position))
    inner = [place for place in (*corners, *edges) if low < place < high]
    work, _ = scipy.integrate.quad(PLAY.force, PLAY.position, position, points=inner or None)
    assert -work == pytest.approx(stored(PLAY, position), abs=1e-9)


def test_a_mass_on_it_swings_as_the_oscillator_in_closed_form() -> None:
    """x = x₀·e^(−ζωt)·(cos ω_d t + ζω/ω_d·sin ω_d t), ω = 40 1/s, ζ = 0.1."""
    force = Spring("handle", stiffness=800.0, damping=4.0).force
    time = np.linspace(0.0, 0.5, 26)
    found = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], force(y[0], y[1]) / 0.5], (0.0, 0.5), [0.01, 0.0], t_eval=time, rtol=1e-10, atol=1e-12
    )
    turn = 40.0 * math.sqrt(1.0 - 0.01)
    expected = 0.01 * np.exp(-4.0 * time) * (np.cos(turn * time) + 4.0 / turn * np.sin(turn * time))
    np.testing.assert_allclose(found.y[0], expected, atol=1e-9)


def test_sampled_it_gives_half_its_stiffness_times_the_move_squared_and_no_less() -> None:
    """The bound is reached: to and fro between two places in the linear part."""
    force, moves = Spring("handle", stiffness=500.0).force, [0.001, 0.002] * 50
    given_away = sum(force(here) * (there - here) for here, there in itertools.pairwise(moves))
    ends = 0.5 * 500.0 * (moves[0] ** 2 - moves[-1] ** 2)
    assert given_away == pytest.approx(ends + 0.5 * 500.0 * 99 * 0.001**2)


def test_it_asks_for_velocity_only_when_it_has_damping() -> None:
    assert PLAY.needs == (Signal.POSITION,)
    assert Spring("handle", stiffness=5.0, damping=0.1).needs == (Signal.POSITION, Signal.VELOCITY)


def test_stability_is_judged_by_its_stiffer_side() -> None:
    spring = Spring("handle", stiffness=600.0, damping=2.0, dead_band=0.01, negative_coefficient=0.1)
    np.testing.assert_array_equal(spring.linearised().d, [[-600.0, -2.0]])


@pytest.mark.parametrize("place", [1e300, -1e300, math.nextafter(0.0, 1.0)])
def test_absurd_places_give_finite_forces(place: float) -> None:
    assert math.isfinite(PLAY.force(place))


@pytest.mark.parametrize(
    "wrong",
    [
        {"stiffness": 0.0},
        {"stiffness": math.inf},
        {"damping": -0.1},
        {"dead_band": -1e-9},
        {"positive_coefficient": 1.1},
        {"negative_coefficient": -0.1},
        {"positive_coefficient": 0.9, "negative_coefficient": 0.9},
        {"positive_saturation": 0.0},
        {"negative_saturation": math.nan},
        {"side": "positive"},
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Spring).validate_python({"axis": "handle", "stiffness": 600.0, **wrong})

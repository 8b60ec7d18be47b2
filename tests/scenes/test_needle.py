"""The needle: puncture, friction, cutting, and the energy of each."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad

from haptic_fieldbus.scenes.needle import Needle
from haptic_fieldbus.signals import Signal
from tests.lanes import examples
from tests.scenes.sheet import Motion, forces, given_to_the_hand
from tests.scenes.sheets.needle import stored

PERIOD = 1e-3
NEEDLE = Needle("handle", puncture=2.0, depth=0.006, grip=500.0, friction=0.8, cutting=0.6)


def moved(needle: Needle, *places: float, speed: float = 0.01, period: float = PERIOD) -> Motion:
    """From place to place at constant speed."""
    legs = [np.linspace(a, b, max(2, round(abs(b - a) / (speed * period))) + 1)[1:] for a, b in pairwise(places)]
    position = np.concatenate([[places[0]], *legs])
    return Motion(period, position, np.append(np.diff(position), 0.0) / period)


@settings(derandomize=True)
@given(part=st.floats(0.0, 0.999), curvature=st.floats(0.0, 1.0))
def test_before_puncture_it_is_a_spring_of_second_order(part: float, curvature: float) -> None:
    """a₁·d + a₂·d², with a₁ = P·(1 − c)/D and a₂ = P·c/D²."""
    needle = Needle("handle", puncture=2.0, depth=0.006, grip=500.0, curvature=curvature)
    depth = 0.006 * part
    expected = 2.0 * (1.0 - curvature) / 0.006 * depth + 2.0 * curvature / 0.006**2 * depth**2
    assert needle.begin(PERIOD)(depth) == pytest.approx(-expected, abs=1e-12)


def test_pushed_in_it_punctures_then_cuts_with_friction_and_is_pulled_back_on_the_way_out() -> None:
    motion = moved(NEEDLE, -0.001, 0.03, -0.001)
    found, deepest = forces(NEEDLE, motion), int(np.argmax(motion.position))
    before = (motion.position > 0.0) & (motion.position < 0.006) & (np.arange(len(found)) < deepest)
    assert found[before].min() == pytest.approx(-2.0, rel=0.01)
    assert abs(found[np.argmax(motion.position >= 0.006)]) < 0.01
    np.testing.assert_allclose(found[(motion.position > 0.01) & (np.arange(len(found)) < deepest)], -1.4)
    out = (np.arange(len(found)) > deepest) & (motion.position > 0.0) & (motion.position < 0.025)
    np.testing.assert_allclose(found[out], 0.8)
    assert (found[motion.position <= 0.0] == 0.0).all()


def test_going_back_into_what_is_cut_there_is_friction_only() -> None:
    motion = moved(NEEDLE, -0.001, 0.03, 0.015, 0.028)
    assert forces(NEEDLE, motion)[-1] == pytest.approx(-0.8)


@pytest.mark.parametrize(("heals", "expected"), [(True, -1.0), (False, -0.8)])
def test_a_hole_heals_or_stays(heals: bool, expected: float) -> None:
    """Half the capsule's way in for the second time: its spring again, or the friction of the hole."""
    needle = Needle("handle", puncture=2.0, depth=0.006, grip=500.0, friction=0.8, curvature=0.0, heals=heals)
    assert forces(needle, moved(needle, -0.001, 0.01, -0.001, 0.003))[-1] == pytest.approx(expected)


def test_it_breaks_away_at_one_friction_and_slides_with_another() -> None:
    """Sticks up to `breakaway`, slips with `friction`, sticks again when slower than `slow`."""
    needle = Needle("handle", puncture=2.0, depth=0.006, grip=500.0, friction=0.5, breakaway=0.9, slow=0.005)
    fast = forces(needle, moved(needle, -0.001, 0.02, speed=0.02))[200:]
    assert fast.min() == pytest.approx(-2.0, rel=0.02)
    slipping = forces(needle, moved(needle, 0.0, 0.02, speed=0.02))
    assert -slipping[-2] == pytest.approx(0.5)
    creeping = -forces(needle, moved(needle, 0.007, 0.02, speed=0.002))
    assert creeping.max() == pytest.approx(0.9, rel=0.01)
    assert creeping[-2000:].min() == pytest.approx(0.5, rel=0.01)


def test_slipping_ends_where_it_turns_or_is_slower_than_slow() -> None:
    """Then it is held up to `breakaway` again, from where it stands."""
    needle = Needle("handle", puncture=2.0, depth=0.006, grip=500.0, friction=0.5, breakaway=0.9, slow=0.005)
    for speed, expected in ((0.005, -0.5), (0.0049, -0.85), (-0.02, -0.85)):
        force = needle.begin(PERIOD)
        assert [force(0.01, 0.02), force(0.02, 0.02)] == pytest.approx([0.0, -0.5])
        assert force(0.0207, speed) == pytest.approx(expected)


def test_drag_grows_with_speed_once_it_is_in() -> None:
    needle = Needle("handle", puncture=2.0, depth=0.006, grip=500.0, friction=0.5, drag=3.0)
    assert forces(needle, moved(needle, 0.0, 0.02, speed=0.2))[-2] == pytest.approx(-0.5 - 3.0 * 0.2)
    assert needle.begin(PERIOD)(0.003, 5.0) == NEEDLE.begin(PERIOD)(0.003)


@pytest.mark.thorough("simulates a whole insertion in small steps")
def test_a_whole_insertion_costs_what_the_closed_form_says() -> None:
    """Capsule P·D·((1 − c)/2 + c/3); friction both ways and cutting, each short of its spring's first stretch."""
    motion = moved(NEEDLE, 0.0, 0.03, 0.0, period=1e-5)
    cost = -given_to_the_hand(motion, forces(NEEDLE, motion), held=False)
    capsule, way = 2.0 * 0.006 * (0.5 / 2.0 + 0.5 / 3.0), 0.024
    entering = 0.8 * way - 0.8**2 / (2 * 500.0) + 0.6 * way - 0.6**2 / (2 * 500.0)
    leaving = 0.8 * 0.03 - 2 * 0.8 * 0.8 / 500.0 - 0.6**2 / (2 * 500.0)
    assert cost == pytest.approx(capsule + entering + leaving, rel=1e-3)
    assert stored(NEEDLE, 0.006 * (1 - 1e-12)) == pytest.approx(capsule)
    assert quad(lambda d: -NEEDLE.begin(PERIOD)(d), 0.0, 0.006 * (1 - 1e-12))[0] == pytest.approx(capsule)


@settings(derandomize=True, max_examples=examples(300))
@given(
    places=st.lists(st.floats(-0.01, 0.04), min_size=2, max_size=40),
    friction=st.floats(0.0, 3.0),
    extra=st.floats(0.0, 3.0),
    cutting=st.floats(0.0, 3.0),
    heals=st.booleans(),
)
def test_held_it_leaks_no_more_than_its_springs(
    places: list[float], friction: float, extra: float, cutting: float, heals: bool
) -> None:
    """Whatever jumps it makes between samples: K·Σ(Δx)²/2 and what the capsule had stored at first."""
    needle = Needle(
        "handle", 2.0, 0.006, 500.0, friction=friction, breakaway=friction + extra, cutting=cutting, heals=heals
    )
    position = np.array(places)
    motion = Motion(PERIOD, position, np.append(np.diff(position), 0.0) / PERIOD)
    given_away = given_to_the_hand(motion, forces(needle, motion), held=True)
    bound = stored(needle, places[0]) + 0.5 * needle.stiffness * float(np.sum(motion.moves**2))
    assert given_away <= bound + 1e-12


def test_begun_deep_inside_it_does_not_kick() -> None:
    force = NEEDLE.begin(PERIOD)
    assert [force(0.05), force(0.05)] == [0.0, 0.0]


def test_both_sides_are_each_others_mirror_image() -> None:
    motion = moved(NEEDLE, -0.001, 0.03, 0.01, 0.02, -0.001)
    left = Needle("handle", 2.0, 0.006, 500.0, friction=0.8, cutting=0.6, side="negative")
    mirrored = Motion(PERIOD, -motion.position, -motion.velocity)
    np.testing.assert_array_equal(forces(left, mirrored), -forces(NEEDLE, motion))


def test_stability_is_told_the_steepest_of_capsule_and_grip() -> None:
    """The capsule's slope at puncture by difference quotient; friction and edge, once in, grip together."""
    step = 1e-9
    slope = (NEEDLE.begin(PERIOD)(0.006 - step) - NEEDLE.begin(PERIOD)(0.006 - 2.0 * step)) / step
    assert -slope == pytest.approx(2.0 / 0.006 * 1.5, rel=1e-4)
    assert NEEDLE.stiffness == 1000.0
    assert Needle("handle", 2.0, 0.006, 500.0, friction=0.8).stiffness == pytest.approx(500.0)
    assert Needle("handle", 20.0, 0.006, 500.0).stiffness == pytest.approx(5000.0)
    half = NEEDLE.with_stiffness(500.0)
    np.testing.assert_allclose(
        forces(half, moved(half, -0.001, 0.02, 0.0)), 0.5 * forces(NEEDLE, moved(NEEDLE, -0.001, 0.02, 0.0)), atol=1e-12
    )
    np.testing.assert_array_equal(NEEDLE.linearised().d, [[-1000.0, 0.0]])


def test_it_needs_the_velocity_only_where_it_matters() -> None:
    assert NEEDLE.needs == (Signal.POSITION,)
    for drag, breakaway in ((1.0, 0.0), (0.0, 1.0)):
        needle = Needle("handle", 2.0, 0.006, 500.0, drag=drag, breakaway=breakaway)
        assert needle.needs == (Signal.POSITION, Signal.VELOCITY)


def test_what_is_no_number_is_handed_on() -> None:
    assert math.isnan(NEEDLE.begin(PERIOD)(math.nan))
    force = NEEDLE.begin(PERIOD)
    force(0.02)
    assert math.isnan(force(math.nan))


@pytest.mark.parametrize(
    "wrong",
    [{"puncture": 0.0}, {"depth": 0.0}, {"grip": 0.0}, {"friction": -1.0}, {"curvature": 1.5}, {"slow": 0.0}],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(Needle).validate_python({"axis": "handle", "puncture": 2.0, "depth": 0.006, "grip": 500.0, **wrong})


def test_a_breakaway_below_the_friction_is_refused_in_words() -> None:
    with pytest.raises(ValueError, match=r"breakaway 0\.5: expected 0, or from friction \(0\.8\) up"):
        Needle("handle", 2.0, 0.006, 500.0, friction=0.8, breakaway=0.5)

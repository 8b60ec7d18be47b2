"""Karnopp's window with a spring that sticks: what it holds, where it breaks away, and that it never gives energy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.integrate import quad

from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.signals import Signal
from tests.scenes.leaps import along, leaps
from tests.scenes.sheet import Motion, forces, given_to_the_hand, spring_leak

COULOMB = Friction("handle", coulomb=1.0, stiffness=800.0)
STICKING = Friction("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, window=0.02)
SIDED = Friction(
    "handle", 1.0, 800.0, breakaway=2.0, window=0.02, positive_coefficient=0.25, dead_band=1e-3, name="sided"
)


def test_it_holds_like_a_spring_below_its_friction_and_lets_the_handle_return() -> None:
    law = COULOMB.begin(1e-3)
    assert [law(place) for place in (0.5, 0.501, 0.499, 0.5)] == pytest.approx([0.0, -0.8, 0.8, 0.0], abs=1e-9)


def test_it_slides_at_its_friction_whatever_the_speed() -> None:
    law = COULOMB.begin(1e-3)
    assert [law(place) for place in (0.0, 0.1, 1e6, 1e6 - 1.0, -1e12)] == [0.0, -1.0, -1.0, 1.0, 1.0]


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("amplitude", [5e-4, 2e-3, 5e-2])
def test_a_cycle_costs_what_the_closed_form_says(amplitude: float) -> None:
    """4·fc·(a − fc/K) where it slides, nothing where it only sticks."""
    motion = along([amplitude, -amplitude, amplitude, -amplitude, amplitude], 20_000)
    force = forces(COULOMB, motion)
    # begins where a cycle ends: the first one stretches the spring from slack
    rest = Motion(1e-3, motion.position[40_000:], motion.velocity[40_000:])
    work = -given_to_the_hand(rest, force[40_000:], held=False)
    assert work == pytest.approx(4.0 * max(0.0, amplitude - 1.0 / 800.0), rel=1e-4, abs=1e-9)


def branch(friction: Friction, amplitude: float, back: float, forth: float) -> tuple[list[float], list[float]]:
    """Corners of one way of the steady cycle, along that way, and the forces there; shares of fc on both ways.

    It turns under the friction of the way back, is free after c·fc/K, takes hold 2·w later, and slides after c·fc/K.
    """
    back, forth = back * friction.coulomb, forth * friction.coulomb
    free = -amplitude + back / friction.stiffness
    holds = free + 2.0 * friction.dead_band
    places = [-amplitude, free, holds, holds + forth / friction.stiffness, amplitude]
    return places, [back, 0.0, 0.0, -forth, -forth]


@pytest.mark.parametrize(("positive", "negative"), [(1.0, 1.0), (1.0, 0.6), (0.3, 1.0), (1.0, 0.0), (0.0, 1.0)])
@pytest.mark.parametrize("dead_band", [0.0, 2e-3])
def test_a_cycle_of_unequal_sides_is_the_hysteresis_of_the_closed_form(
    positive: float, negative: float, dead_band: float
) -> None:
    """Work of a cycle: (c₊ + c₋)·fc·(2·a − 2·w − (c₊ + c₋)·fc/K), by that and by quadrature of the closed form."""
    friction = Friction("handle", 1.5, 800.0, 0.0, 0.0, 0.0, positive, negative, dead_band)
    amplitude, work = 1e-2, 0.0
    motion = along([0.0, amplitude, -amplitude, amplitude, -amplitude], 2_000)
    force = forces(friction, motion)
    for way, begin, shares in ((1.0, 4_000, (negative, positive)), (-1.0, 6_000, (positive, negative))):
        corners = branch(friction, amplitude, *shares)
        line = slice(begin, begin + 2_001)
        oracle = np.interp(way * motion.position[line], *corners)
        np.testing.assert_allclose(way * force[line], oracle, rtol=0.0, atol=1e-9)
        work -= quad(np.interp, -amplitude, amplitude, args=corners, points=corners[0][1:-1])[0]
    both = (positive + negative) * friction.coulomb
    assert work == pytest.approx(both * (2.0 * amplitude - 2.0 * dead_band - both / friction.stiffness), rel=1e-9)
    cycle = Motion(1e-3, motion.position[4_000:], motion.velocity[4_000:])
    assert -given_to_the_hand(cycle, force[4_000:], held=False) == pytest.approx(work, rel=1e-4)


@pytest.mark.parametrize("negative", [1.0, 0.4])
def test_a_cycle_between_both_limits_costs_nothing(negative: float) -> None:
    friction = Friction("handle", 1.0, 800.0, negative_coefficient=negative, dead_band=2e-3)
    size = 2e-3 + negative / 800.0
    motion = along([0.0, size, -size, size, 0.0], 2_000)
    force = forces(friction, motion)
    assert (force.min(), force.max()) == pytest.approx((-negative, negative))
    assert given_to_the_hand(motion, force, held=False) == pytest.approx(0.0, abs=1e-12)


def test_friction_takes_hold_after_the_dead_band_from_rest_and_after_twice_as_much_from_way_to_way() -> None:
    law = Friction("handle", coulomb=1.0, stiffness=800.0, dead_band=2e-3).begin(1e-3)
    places = (0.5, 0.502, 0.503, 0.6, 0.59875, 0.59475, 0.594, 0.498)
    assert [law(place) for place in places] == pytest.approx([0.0, 0.0, -0.8, -1.0, 0.0, 0.0, 0.6, 1.0], abs=1e-9)


def test_each_side_has_its_share_of_friction_and_of_breakaway_and_all_of_the_damping() -> None:
    damped = Friction("handle", 1.0, 800.0, 2.0, 0.02, damping=3.0, negative_coefficient=0.25).begin(1e-3)
    found = [damped(*each) for each in [(0.0, 0.0), (1.0, 0.02), (2.0, 0.1), (1.0, -0.02), (0.0, -0.1)]]
    assert found == pytest.approx([0.0, -2.06, -1.3, 0.56, 0.55])


@pytest.mark.parametrize("friction", [COULOMB, STICKING])
def test_a_dead_band_of_next_to_nothing_changes_next_to_nothing(friction: Friction) -> None:
    """The law of unequal sides against the leaner one that is taken without any of its parameters."""
    banded = replace(friction, dead_band=1e-15)
    rng = np.random.default_rng(1)
    motion = Motion(1e-3, np.cumsum(rng.normal(0.0, 1e-3, 500)), rng.normal(0.0, 0.03, 500))
    np.testing.assert_allclose(forces(banded, motion), forces(friction, motion), rtol=0.0, atol=1e-9)


def test_below_the_window_it_holds_up_to_breakaway_and_above_it_slides() -> None:
    law = STICKING.begin(1e-3)
    assert law(0.0, 0.0) == 0.0
    assert law(0.0024, 0.019) == pytest.approx(-1.92)
    assert law(0.0030, 0.02) == pytest.approx(-2.0)
    assert law(0.0031, 0.021) == pytest.approx(-1.0)
    assert law(0.0032, 0.019) == pytest.approx(-1.08)
    assert law(0.0132, -0.02) == pytest.approx(-2.0)
    assert law(0.0131, -0.021) == pytest.approx(-1.0)  # the window has two edges
    assert law(-0.02, -0.021) == pytest.approx(1.0)


def test_damping_is_added_and_nothing_else_takes_part_in_it() -> None:
    damped, dry = Friction("handle", 1.0, 800.0, damping=3.0).begin(1e-3), COULOMB.begin(1e-3)
    for place, speed in [(0.0, 0.1), (0.01, -2.0), (-0.02, 5.0)]:
        assert damped(place, speed) == pytest.approx(dry(place) - 3.0 * speed)


def thrown(law: object, steps: int, step: float) -> tuple[list[float], list[float]]:
    """Way and force of 0.5 kg thrown at 0.4 m/s, symplectic Euler."""
    position, velocity, way, force = 0.0, 0.4, [0.0], [0.0]
    for _ in range(steps):
        force.append(law(position, velocity))  # type: ignore[operator]
        velocity += step * force[-1] / 0.5
        position += step * velocity
        way.append(position)
    return way, force


@pytest.mark.thorough("simulates many throws")
def test_a_thrown_mass_goes_as_far_as_the_closed_form_says_and_comes_to_rest() -> None:
    """½·m·v² = fc·(s − fc/K) + ½·fc²/K; then it swings about the stick point, which a little damping ends."""
    dry = COULOMB.begin(1e-6)
    way, _ = thrown(lambda position, velocity: dry(position), 400_000, 1e-6)
    assert max(way) == pytest.approx(0.5 * 0.5 * 0.16 + 0.5 / 800.0, rel=1e-5)
    damped = Friction("handle", coulomb=1.0, stiffness=800.0, damping=2.0).begin(1e-5)
    _, force = thrown(damped, 600_000, 1e-5)
    assert max(map(abs, force[-1000:])) < 1e-3


def test_it_rests_at_a_period_where_the_sign_of_the_velocity_chatters() -> None:
    """The shipped bench at 1 kHz, 0.63 kg and 1.58 N·s/m: friction by sign swaps its force for ever."""
    sticking = Friction("handle", coulomb=1.0, stiffness=600.0).begin(1e-3)

    def last_force(law: object) -> float:
        decay = math.exp(-1.58 * 1e-3 / 0.63)
        position, velocity, force = 0.0, 0.3, 0.0
        for _ in range(20_000):
            force = law(position, velocity)  # type: ignore[operator]
            # the exact step of mass and damper under a held force
            rest = force / 1.58
            position += rest * 1e-3 + (velocity - rest) * (1.0 - decay) * 0.63 / 1.58
            velocity = rest + (velocity - rest) * decay
        return abs(force)

    assert last_force(lambda position, velocity: sticking(position)) < 1e-6
    assert last_force(lambda position, velocity: -math.copysign(1.0, velocity)) == 1.0


@pytest.mark.parametrize("friction", [STICKING, SIDED], ids=lambda friction: friction.name)
@settings(derandomize=True)
@given(motion=leaps(5e-3, fastest=0.04))
def test_it_leaks_when_sampled_no_more_than_its_spring_whatever_an_estimate_says_of_the_speed(
    friction: Friction, motion: Motion
) -> None:
    given_away = given_to_the_hand(motion, forces(friction, motion), held=True)
    assert given_away <= spring_leak(800.0, motion) * (1.0 + 1e-9) + 1e-15


@settings(derandomize=True)
@given(
    places=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20),
    speed=st.floats(-1e9, 1e9),
    damping=st.floats(0.0, 10.0),
    dead_band=st.sampled_from([0.0, 1e-3]),
)
def test_its_force_is_bounded_at_any_speed(places: list[float], speed: float, damping: float, dead_band: float) -> None:
    law = replace(STICKING, damping=damping, dead_band=dead_band).begin(1e-3)
    assert max(abs(law(place, speed)) for place in places) <= (2.0 + damping * abs(speed)) * (1.0 + 1e-9)


@pytest.mark.parametrize("nan", [(math.nan, 0.0), (0.0, math.nan), (math.nan, math.nan)])
@pytest.mark.parametrize("after", [0, 1])
@pytest.mark.parametrize("friction", [STICKING, SIDED], ids=lambda friction: friction.name)
def test_what_is_no_number_gives_a_force_that_is_none(friction: Friction, nan: tuple[float, float], after: int) -> None:
    law = friction.begin(1e-3)
    for _ in range(after):
        law(0.0, 0.0)
    assert math.isnan(law(*nan))


def test_it_asks_for_velocity_only_for_window_and_damping() -> None:
    assert COULOMB.needs == (Signal.POSITION,)
    assert Friction("handle", 1.0, 800.0, breakaway=1.0, window=0.1).needs == (Signal.POSITION,)
    assert Friction("handle", 1.0, 800.0, positive_coefficient=0.5, dead_band=1e-3).needs == (Signal.POSITION,)
    assert STICKING.needs == (Signal.POSITION, Signal.VELOCITY)
    np.testing.assert_array_equal(Friction("handle", 1.0, 800.0, damping=2.0).linearised().d, [[-800.0, -2.0]])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"breakaway": 0.5}, "breakaway 0.5: expected 0, or at least coulomb, 1"),
        ({"breakaway": 1.5}, "window 0: expected a speed above 0, as breakaway is above coulomb"),
        ({"coulomb": 0.0}, "greater than"),
        ({"stiffness": math.inf}, "finite"),
        ({"window": -0.1}, "greater than or equal to 0"),
        ({"damping": -1.0}, "greater than or equal to 0"),
        ({"dead_band": -1e-3}, "greater than or equal to 0"),
        ({"positive_coefficient": 1.1}, "less than or equal to 1"),
        (
            {"positive_coefficient": 0.5, "negative_coefficient": 0.5},
            "expected 1 for the stronger side, which coulomb describes",
        ),
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        TypeAdapter(Friction).validate_python({"axis": "handle", "coulomb": 1.0, "stiffness": 600.0, **wrong})

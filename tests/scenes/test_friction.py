"""Karnopp's window with a spring that sticks: what it holds, where it breaks away, and that it never gives energy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from haptic_fieldbus.scenes.friction import Friction
from haptic_fieldbus.signals import Signal
from tests.scenes.leaps import along, leaps
from tests.scenes.sheet import Motion, forces, given_to_the_hand, spring_leak

COULOMB = Friction("handle", coulomb=1.0, stiffness=800.0)
STICKING = Friction("handle", coulomb=1.0, stiffness=800.0, breakaway=2.0, window=0.02)


def test_it_holds_like_a_spring_below_its_friction_and_lets_the_handle_return() -> None:
    law = COULOMB.begin(1e-3)
    assert [law(place) for place in (0.5, 0.501, 0.499, 0.5)] == pytest.approx([0.0, -0.8, 0.8, 0.0], abs=1e-9)


def test_it_slides_at_its_friction_whatever_the_speed() -> None:
    law = COULOMB.begin(1e-3)
    assert [law(place) for place in (0.0, 0.1, 1e6, 1e6 - 1.0, -1e12)] == [0.0, -1.0, -1.0, 1.0, 1.0]


@pytest.mark.parametrize("amplitude", [5e-4, 2e-3, 5e-2])
def test_a_cycle_costs_what_the_closed_form_says(amplitude: float) -> None:
    """4·fc·(a − fc/K) where it slides, nothing where it only sticks."""
    motion = along([amplitude, -amplitude, amplitude, -amplitude, amplitude], 20_000)
    force = forces(COULOMB, motion)
    # begins where a cycle ends: the first one stretches the spring from slack
    rest = Motion(1e-3, motion.position[40_000:], motion.velocity[40_000:])
    work = -given_to_the_hand(rest, force[40_000:], held=False)
    assert work == pytest.approx(4.0 * max(0.0, amplitude - 1.0 / 800.0), rel=1e-4, abs=1e-9)


def test_below_the_window_it_holds_up_to_breakaway_and_above_it_slides() -> None:
    law = STICKING.begin(1e-3)
    assert law(0.0, 0.0) == 0.0
    assert law(0.0024, 0.019) == pytest.approx(-1.92)
    assert law(0.0030, 0.02) == pytest.approx(-2.0)
    assert law(0.0031, 0.021) == pytest.approx(-1.0)
    assert law(0.0032, 0.019) == pytest.approx(-1.08)
    assert law(0.0132, -0.02) == pytest.approx(-2.0)


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


@settings(derandomize=True)
@given(motion=leaps(5e-3, fastest=0.04))
def test_it_leaks_when_sampled_no_more_than_its_spring_whatever_an_estimate_says_of_the_speed(motion: Motion) -> None:
    given_away = given_to_the_hand(motion, forces(STICKING, motion), held=True)
    assert given_away <= spring_leak(800.0, motion) * (1.0 + 1e-9) + 1e-15


@settings(derandomize=True)
@given(
    places=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20),
    speed=st.floats(-1e9, 1e9),
    damping=st.floats(0.0, 10.0),
)
def test_its_force_is_bounded_at_any_speed(places: list[float], speed: float, damping: float) -> None:
    law = Friction("handle", 1.0, 800.0, breakaway=2.0, window=0.02, damping=damping).begin(1e-3)
    assert max(abs(law(place, speed)) for place in places) <= (2.0 + damping * abs(speed)) * (1.0 + 1e-9)


@pytest.mark.parametrize("nan", [(math.nan, 0.0), (0.0, math.nan), (math.nan, math.nan)])
@pytest.mark.parametrize("after", [0, 1])
def test_what_is_no_number_gives_a_force_that_is_none(nan: tuple[float, float], after: int) -> None:
    law = STICKING.begin(1e-3)
    for _ in range(after):
        law(0.0, 0.0)
    assert math.isnan(law(*nan))


def test_it_asks_for_velocity_only_for_window_and_damping() -> None:
    assert COULOMB.needs == (Signal.POSITION,)
    assert Friction("handle", 1.0, 800.0, breakaway=1.0, window=0.1).needs == (Signal.POSITION,)
    assert STICKING.needs == (Signal.POSITION, Signal.VELOCITY)
    np.testing.assert_array_equal(Friction("handle", 1.0, 800.0, damping=2.0).linearised().d, [[-800.0, -2.0]])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"breakaway": 0.5}, "breakaway 0.5: expected 0, or at least coulomb, 1"),
        ({"breakaway": 1.5}, "window 0: expected a speed above 0, as breakaway is above coulomb"),
        ({"coulomb": 0.0}, "greater than 0"),
        ({"stiffness": math.inf}, "finite"),
        ({"window": -0.1}, "greater than or equal to 0"),
        ({"damping": -1.0}, "greater than or equal to 0"),
    ],
)
def test_parameters_without_a_meaning_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        TypeAdapter(Friction).validate_python({"axis": "handle", "coulomb": 1.0, "stiffness": 600.0, **wrong})

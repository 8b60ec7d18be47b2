"""The pulses that ask an encoder: they move two counts by an oracle of its own, they are not felt, or they are not."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.encoder_probe import (
    EncoderProbe,
    HandOnHandle,
    encoder_lines,
    encoder_probe,
    travel,
    why_not_asked,
)
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.builders import VELOCITY_ONLY, WALL, plan_of, rig_of, scene_of

RATED = 0.4 * 2.0 * math.pi / 0.05
"""[N] of the shipped bench."""
STILL, PAIRS, FELT_SHARE, FRICTIONS, ASKED_COUNTS, LONGEST_PULSE = 2.0, 5, 0.08, 1.5, 2.0, 0.05
HAND = {Workspace.LINEAR: HandOnHandle(1000.0, 10.0, 0.02), Workspace.ROTARY: HandOnHandle(2.5, 0.025, 5e-5)}
"""As docs/explanation/safety.md promises them."""
KNOB = scene_of(Wall("knob", stiffness=0.5, position=0.1), workspace=Workspace.ROTARY)


def probed(plan: Plan) -> tuple[AxisPlan, EncoderProbe]:
    (axis,) = plan.axes
    probe = encoder_probe(axis, plan.period)
    assert probe is not None
    return axis, probe


def text(plan: Plan) -> str:
    return "\n".join(encoder_lines(plan.axes[0], plan.period))


@settings(deadline=None)
@given(
    st.floats(0.01, 3.0), st.floats(0.0, 100.0), st.floats(50.0, 5000.0), st.floats(0.0, 100.0), st.floats(0.001, 0.1)
)
def test_the_travel_is_that_of_a_mass_a_spring_and_a_damper(
    mass: float, damping: float, stiffness: float, hand_damping: float, time: float
) -> None:
    hand = HandOnHandle(stiffness, hand_damping, 0.02)
    times = np.linspace(0.0, time, 2001)
    held = scipy.integrate.solve_ivp(
        lambda t, z: [z[1], (1.0 - (damping + hand_damping) * z[1] - stiffness * z[0]) / (mass + 0.02)],
        (0.0, time), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-15,
    )  # fmt: skip
    way = held.y[0]
    turned = np.flatnonzero(np.diff(way) < 0.0)
    first = way[: turned[0] + 1] if turned.size else way
    plant = Plant(mass, damping + 1e-9)
    assert travel(plant, hand, time) == pytest.approx(float(first.max()), rel=1e-4)


def test_two_equal_poles_are_no_exception() -> None:
    """b = 2·√(k·m): x = (1 − (1 + ω·t)·e^(−ω·t))/k."""
    hand, omega = HandOnHandle(1000.0, 0.0, 0.0), math.sqrt(1000.0 / 0.5)
    moved = travel(Plant(0.5, 2.0 * math.sqrt(500.0)), hand, 0.02)
    assert moved == pytest.approx((1.0 - (1.0 + omega * 0.02) * math.exp(-omega * 0.02)) / 1000.0, rel=1e-6)
    assert travel(Plant(0.5, 1.0), hand, 0.0) == 0.0


def moved_by_a_pair(plant: Plant, hand: HandOnHandle, probe: EncoderProbe, slew: float, pull: float) -> float:
    """Range of the handle in a pair of pulses [m or rad], by a solver for stiff systems.

    Friction is a steep function of speed; the torque loop and the slew limit delay the pulses; `pull` is the force that
    friction holds when the pair begins.
    """
    length, mass = probe.periods * probe.period, plant.mass + hand.mass
    # As slow as to go less than a hundredth of a count by itself.
    slow = 1e-3 * plant.resolution / length

    def command(t: float) -> float:
        fallen = max(-probe.effort, -slew * t)
        return fallen if t < length else min(probe.effort, -probe.effort + slew * (t - length))

    def change(t: float, z: NDArray[np.float64]) -> list[float]:
        x, v, f = z
        friction = plant.coulomb * math.tanh(v / slow)
        force = pull + f - friction - (plant.damping + hand.damping) * v - hand.stiffness * x
        return [v, force / mass, (command(t) - f) / plant.torque_lag]

    begin = math.atanh(max(-0.999999, min(0.999999, pull / plant.coulomb))) * slow if plant.coulomb else 0.0
    way = [0.0]
    state = [0.0, begin, 0.0]
    for first, last in ((0.0, length), (length, 2.0 * length)):
        found = scipy.integrate.solve_ivp(
            change, (first, last), state, method="LSODA", rtol=1e-6, atol=1e-12, max_step=length / 50
        )
        way += list(found.y[0])
        state = list(found.y[:, -1])
    return max(way) - min(way)


@pytest.mark.parametrize("share", [0.0, 0.3, -0.3, 0.7, -1.0, 1.0])
@pytest.mark.parametrize("scene", [WALL, KNOB], ids=["linear", "rotary"])
@pytest.mark.parametrize("rate", [1000.0, 250.0])
def test_a_pair_moves_two_counts_whatever_friction_held_before(rate: float, scene: object, share: float) -> None:
    axis, probe = probed(plan_of(scene, rate))  # type: ignore[arg-type]
    assert axis.plant is not None
    plant = replace(axis.plant, torque_lag=axis.delay.torque_loop)
    moved = moved_by_a_pair(plant, HAND[axis.workspace], probe, axis.limits.slew, share * plant.coulomb)
    assert moved >= 0.99 * ASKED_COUNTS * axis.resolution


def test_the_shipped_bench_is_asked_with_one_and_a_half_times_its_friction() -> None:
    axis, probe = probed(plan_of())
    friction = 2.0e-3 * 2.0 * math.pi / 0.05
    assert FRICTIONS * friction <= probe.effort < FRICTIONS * friction + axis.effort_unit
    assert probe.least == pytest.approx(probe.effort / FELT_SHARE)
    assert probe.least > axis.limits.holding
    assert 0.01 < probe.periods * probe.period <= LONGEST_PULSE
    assert STILL + PAIRS * 0.5 < probe.time < 10.0


@pytest.mark.parametrize("scene", [WALL, KNOB], ids=["linear", "rotary"])
@pytest.mark.parametrize("rate", [2000.0, 1000.0, 100.0, 50.0, 20.0])
@pytest.mark.parametrize("friction", [0.0, 2.0e-3, 8.0e-3])
def test_no_pulse_is_felt_or_asked_for_later_than_ten_seconds(scene: object, rate: float, friction: float) -> None:
    rig = rig_of(scene, coulomb_friction=friction)  # type: ignore[arg-type]
    axis, probe = probed(plan_of(scene, rate, rig))  # type: ignore[arg-type]
    assert probe.effort <= FELT_SHARE * probe.least * (1.0 + 1e-9)
    assert probe.effort / axis.effort_unit == pytest.approx(round(probe.effort / axis.effort_unit))
    assert probe.least <= axis.limits.effort
    assert probe.periods >= 1
    assert probe.wait * probe.period >= axis.delay.total
    assert probe.time + 0.1 < 10.0


def test_a_hand_that_holds_harder_needs_larger_pulses() -> None:
    """On the knob of the shipped bench a count is 1.5 mrad, so that the hand decides and not the friction."""
    axis, probe = probed(plan_of(KNOB))
    assert probe.effort == pytest.approx(
        (axis.rig.coulomb_friction or 0.0) + 2.0 * axis.resolution * HAND[Workspace.ROTARY].stiffness, rel=0.1
    )


def test_force_that_a_hand_may_be_left_alone_with_asks_nothing() -> None:
    plan = plan_of(rig=rig_of(WALL, limits=Limits(effort=0.05 * RATED)))
    assert encoder_probe(plan.axes[0], plan.period) is None
    assert text(plan) == ""
    assert "encoder" not in [line.split(" ", 1)[0] for line in explain(plan).splitlines()]


def test_a_drive_with_velocity_only_keeps_the_rule_and_says_so() -> None:
    plan = plan_of(profile=VELOCITY_ONLY)
    assert encoder_probe(plan.axes[0], plan.period) is None
    assert text(plan) == (
        "encoder not tested by pulses: test drive offers velocity only; without a count for 90 s the force is "
        "limited to 2.51 N"
    )


def test_pulses_that_would_be_felt_are_not_given_and_the_plan_says_so() -> None:
    """Friction of 0.05 N·m is 6.3 N at the handle: 9.4 N would be needed, and 8 % of 50.3 N is 4.0 N."""
    plan = plan_of(rig=rig_of(WALL, coulomb_friction=0.05))
    assert encoder_probe(plan.axes[0], plan.period) is None
    assert "tested by pulses: pulses of ±9.42 N are needed, but pulses above 8 % of 50.3 N can be felt; " in text(plan)


def test_a_period_that_is_longer_than_a_pulse_asks_nothing() -> None:
    plan = plan_of(rate=10.0, scene=scene_of(Wall("handle", stiffness=20.0, position=0.02)))
    assert "a pulse of one period is longer than 50 ms" in text(plan)


def test_a_torque_loop_that_is_slower_than_a_pulse_asks_nothing() -> None:
    plan = plan_of()
    slow = replace(plan.axes[0], delay=replace(plan.axes[0].delay, torque_loop=0.05))
    assert why_not_asked(slow, plan.period) == "longer pulses are needed, but pulses above 8 % of 50.3 N can be felt"


def test_a_rig_that_wants_less_force_sooner_gets_it_by_the_rule() -> None:
    plan = plan_of(rig=rig_of(WALL, limits=Limits(stall=4.0)))
    assert encoder_probe(plan.axes[0], plan.period) is None
    assert text(plan).startswith("encoder not tested by pulses: the test takes 4.7 s, but limits.stall is 4 s; ")


def test_a_bench_whose_inertia_is_not_known_asks_nothing() -> None:
    plan = plan_of(rig=rig_of(WALL, inertia=None))
    assert encoder_probe(plan.axes[0], plan.period) is None
    assert why_not_asked(plan.axes[0], plan.period) == "the inertia is unknown"


def test_the_plan_tells_how_the_encoder_is_asked_and_below_which_force_it_is_not() -> None:
    plan = plan_of()
    axis, probe = probed(plan)
    asked, against, below = text(plan).splitlines()
    assert asked == (
        "encoder test by pulses after 2 s without a count under 5.03 N or more: pairs of ±0.402 N for "
        f"{probe.periods} ms, at most 8 % of the force"
    )
    assert against.startswith("a pair moves two counts against 0.251 N of friction and a hand of 1000 N/m; 5 pairs")
    assert below == "from 2.51 N to 5.03 N without a count for 90 s the force is limited to 2.51 N"
    assert all(line in explain(plan) for line in (asked, against, below))
    assert why_not_asked(axis, plan.period) == "pulses could be felt below 5.03 N"


def test_without_friction_the_encoder_is_asked_under_all_that_is_no_holding_force() -> None:
    plan = plan_of(rig=rig_of(WALL, coulomb_friction=0.0))
    axis, probe = probed(plan)
    assert probe.least == axis.limits.holding
    assert len(text(plan).splitlines()) == 2

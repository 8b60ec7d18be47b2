"""An axis whose drive offers velocity only, from bytes to bytes: position, lost readings, limits, the drift trip."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate

from haptic_fieldbus.cycle.cycle import Cycle, decoded_columns
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.drive.rig import Limits, LinearMechanism
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import VELOCITY_ONLY, plan_of, rig_of, scene_of
from tests.cycle.test_cycle import ENABLED, UNIT, Constant, sent

STEP = 0.05 / 600
"""0.1 r/min of the motor at the handle [m/s]."""
PERIOD, PERIOD_NS = 1e-3, 1_000_000
FREE = scene_of(Constant("handle", 0.0))
HARD_LIMITS = Limits(speed=1.0, position=(-0.01, 0.02), drift=1.0)


def plan_with(scene: Scene = FREE, limits: Limits | None = None, mechanism: LinearMechanism | None = None) -> Plan:
    changes = {"limits": limits or Limits()} | ({"mechanism": mechanism} if mechanism else {})
    return plan_of(scene, rig=rig_of(scene, **changes), profile=VELOCITY_ONLY)


def image(reading: int, number: int, flags: int = 0, age: int = 0) -> bytes:
    return struct.pack("<qIHHHih", number * PERIOD_NS, age, flags, 0, ENABLED, reading, 0)


def fed(cycle: Cycle, readings: list[int], start: int = 0) -> list[float]:
    """The positions of the handle, period after period."""
    at, found = cycle.columns.index("handle.position"), []
    for number, reading in enumerate(readings, start=start):
        cycle(image(reading, number))
        found.append(cycle.row[at])
    return found


def test_the_position_is_the_trapezoid_of_what_was_read() -> None:
    speed = 0.3 * np.sin(np.arange(1000) * 0.02)
    readings = np.rint(speed / STEP).astype(int)
    cycle = Cycle(plan_with())
    found = fed(cycle, readings.tolist())
    summed = scipy.integrate.cumulative_trapezoid(readings * STEP, dx=PERIOD, initial=0.0)
    np.testing.assert_allclose(found, summed, atol=1e-15)
    true = 0.3 * PERIOD / 0.02 * (1 - np.cos(np.arange(1000) * 0.02))
    assert np.abs(found - true).max() < cycle.axes["handle"].state.drift == pytest.approx(999 * PERIOD * STEP / 2)


def test_zero_is_where_the_handle_was_enabled_also_when_it_moves_then() -> None:
    assert fed(Cycle(plan_with()), [500, 500]) == pytest.approx([0.0, 500 * STEP * PERIOD])


def test_a_mirrored_mechanism_turns_the_velocity_around() -> None:
    mirrored = plan_with(mechanism=LinearMechanism("linear", 0.05, sign=-1))
    assert fed(Cycle(mirrored), [0, 100, 100])[-1] == -fed(Cycle(plan_with()), [0, 100, 100])[-1] < 0


def test_a_damper_gets_the_velocity_that_was_read() -> None:
    scene = scene_of(Wall("handle", stiffness=600.0, damping=5.0, position=0.0))
    cycle = Cycle(plan_with(scene))
    position = fed(cycle, [0] * 502 + [240] * 10)[-1]
    assert cycle.row[cycle.columns.index("handle.velocity")] == pytest.approx(240 * STEP)
    assert cycle.row[cycle.columns.index("handle.gain")] == 1.0, "no gap"
    assert cycle.row[cycle.columns.index("handle.force")] == pytest.approx(-600.0 * position - 5.0 * 240 * STEP)
    assert sent(cycle(image(240, 512)))[1] < 0


def test_what_is_read_and_what_it_makes_stand_in_the_row_under_names_of_their_own() -> None:
    plan = plan_with()
    cycle = Cycle(plan)
    fed(cycle, [0, 7])
    assert decoded_columns(plan)[-2] == "handle.velocity reading"
    assert cycle.row[cycle.columns.index("handle.velocity reading")] == 7
    assert len(set(cycle.columns)) == len(cycle.columns) == len(cycle.row)


def test_other_feedback_that_is_mapped_is_still_found() -> None:
    cycle = Cycle(plan_with(scene_of(Constant("handle", 0.0, needs=(Signal.TORQUE_ACTUAL,)))))
    for number in range(2):
        cycle(struct.pack("<qIHHHih", number * PERIOD_NS, 0, 0, 0, ENABLED, 100, 5))
    assert cycle.axes["handle"].sensed.torque_actual == pytest.approx(5 * UNIT)


def test_a_reading_that_stays_away_is_held_and_then_replaced() -> None:
    cycle = Cycle(plan_with())
    before = fed(cycle, [100] * 10)[-1]
    drift = cycle.axes["handle"].state.drift
    at = cycle.columns.index("handle.position")
    cycle(image(100, 10, LinkFlag.STALE))
    assert cycle.row[at] - before == pytest.approx(100 * STEP * PERIOD)
    cycle(image(300, 11))
    assert cycle.row[at] - before == pytest.approx(2 * PERIOD * 200 * STEP)
    assert cycle.axes["handle"].state.drift - drift == pytest.approx(2 * PERIOD * (0.5 * STEP + 0.5 * 200 * STEP))
    assert cycle.trip is None


def test_periods_that_were_slept_through_are_integrated_over() -> None:
    cycle = Cycle(plan_with())
    before = fed(cycle, [100] * 10)[-1]
    assert fed(cycle, [100], start=14)[0] - before == pytest.approx(5 * PERIOD * 100 * STEP)


def test_feedback_that_stays_away_stops_when_it_is_too_old() -> None:
    cycle = Cycle(plan_with())
    fed(cycle, [0] * 10)
    ages = range(1, 40)
    for number in ages:
        cycle(image(0, 10 + number, LinkFlag.STALE, age=number * 1_000_000))
        if cycle.trip is not None:
            break
    assert cycle.trip is not None
    assert (cycle.trip.kind, number) == (TripKind.FEEDBACK_LOST, 31)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("missing", [0, 1, 5])
def test_velocities_that_no_hand_can_change_so_fast_trip(sign: int, missing: int) -> None:
    """The limit is a change over the time between two readings, and what rounding and one count a period look like."""
    limit, counted = 100.0, 2.0 * 0.05 / 4096 / PERIOD
    largest = limit * PERIOD * (missing + 1) + max(2.0 * STEP, counted)
    for reading, kinds in ((math.floor(largest / STEP), []), (math.ceil(largest / STEP), [TripKind.ACCELERATION])):
        cycle = Cycle(plan_with(limits=Limits(speed=5.0, acceleration=limit)))
        fed(cycle, [0, 0])
        for number in range(missing):
            cycle(image(0, 2 + number, flags=LinkFlag.STALE))
        fed(cycle, [sign * reading], start=2 + missing)
        assert ([cycle.trip.kind] if cycle.trip else []) == kinds


@pytest.mark.parametrize("sign", [1, -1])
def test_the_speed_limit_looks_at_the_reading(sign: int) -> None:
    cycle = Cycle(plan_with(limits=replace(HARD_LIMITS, position=None, acceleration=2000.0)))
    for number, reading in enumerate([0, math.floor(1.0 / STEP), math.ceil(1.0 / STEP)]):
        assert cycle.trip is None
        fed(cycle, [sign * reading], start=number)
    assert cycle.trip is not None
    assert (cycle.trip.kind, cycle.trip.limit) == (TripKind.SPEED, 1.0)
    assert cycle.trip.value == pytest.approx(1.0, abs=STEP)


@pytest.mark.parametrize(("sign", "limit"), [(1, 0.02), (-1, -0.01)])
def test_a_position_limit_stops_where_the_handle_may_be_outside(sign: int, limit: float) -> None:
    """The trip comes at the first period in which position and drift together reach beyond the limit."""
    cycle, number = Cycle(plan_with(limits=HARD_LIMITS)), 0
    while cycle.trip is None:
        fed(cycle, [sign * 1000], start=number)
        number += 1
    assert (cycle.trip.kind, cycle.trip.limit) == (TripKind.POSITION, limit)
    reach = (number - 1) * PERIOD * (1000 * STEP + 0.5 * STEP)
    assert cycle.trip.value == pytest.approx(sign * reach)
    assert abs(limit) < reach < abs(limit) + PERIOD * 1001 * STEP


def test_the_drift_trip_comes_when_half_steps_have_added_up_to_the_limit() -> None:
    limit = 20.5 * PERIOD * STEP / 2
    cycle = Cycle(plan_with(limits=Limits(drift=limit)))
    outputs = [sent(cycle(image(0, number))) for number in range(22)]
    assert cycle.trip is not None
    assert (cycle.trip.kind, cycle.trip.limit, cycle.trip.t_ns) == (TripKind.DRIFT, limit, 21 * PERIOD_NS)
    assert cycle.trip.value == pytest.approx(21 * PERIOD * STEP / 2)
    assert outputs[-2][0] == 0x0F
    assert outputs[-1] == (0, 0)


def test_the_default_drift_is_a_tenth_of_a_turn_of_the_motor() -> None:
    plan = plan_with()
    assert plan.axes[0].limits.drift == pytest.approx(0.1 * 0.05)
    assert plan_with(limits=Limits(drift=0.003)).axes[0].limits.drift == 0.003


def test_a_drive_with_a_position_never_drifts() -> None:
    cycle = Cycle(plan_of(FREE))
    fed(cycle, [0, 1, 2])
    assert cycle.axes["handle"].state.drift == 0.0


def test_a_handle_that_stands_still_under_torque_has_less_of_it_after_a_while() -> None:
    """A reading of 0 throughout, under a constant 10 N: after 2 s, here, 5 % of rated torque are left."""
    scene = scene_of(Constant("handle", 10.0))
    cycle = Cycle(plan_with(scene, limits=Limits(stall=2.0, drift=1.0)))
    targets = [sent(cycle(image(0, number)))[1] for number in range(2700)]
    assert targets[1900] == round(10.0 / UNIT)
    assert targets[-1] == 50
    assert cycle.trip is None


def test_in_a_gap_of_a_drive_that_reads_velocity_the_law_pauses_too() -> None:
    """At 83.3 mm/s into a wall, 5 readings are lost: the law goes on 6 periods later, or half a millimetre deeper."""
    cycle = Cycle(plan_with(scene_of(Wall("handle", 600.0))))
    fed(cycle, [0] * 600 + [1000] * 20)
    force = cycle.columns.index("handle.force")
    before = cycle.row[force]
    for _ in range(5):
        cycle(image(1000, 619, LinkFlag.STALE))
    fed(cycle, [1000], 625)
    assert cycle.row[force] == before < -0.9
    assert cycle.axes["handle"].permission.gaps.farthest == pytest.approx(6 * PERIOD * 1000 * STEP)


def test_power_is_that_of_the_velocity_that_was_read() -> None:
    """10 N over 0.12 m/s are 1.2 W, over 0.09 m/s they are 0.9 W."""
    for speed, trips in ((0.09, False), (0.12, True), (-0.12, False)):
        cycle = Cycle(plan_with(scene_of(Constant("handle", 10.0)), Limits(power=1.0, drift=1.0)))
        fed(cycle, [round(speed / STEP)] * 1500)
        found = None if cycle.trip is None else cycle.trip.kind
        assert found is (TripKind.POWER if trips else None)

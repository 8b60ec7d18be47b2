"""The first rendered period: nothing is rendered before every axis has said where its handle is."""

import struct
from typing import Literal

import pytest

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.drive.rig import LinearMechanism
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag
from tests.builders import plan_of, rig_of, scene_of
from tests.cycle.test_cycle import COUNT, ENABLED, image, sent

INSIDE = 4096
"""Counts by which the right handle is 50 mm inside a wall that begins at 0: 30 N, and a start may ask for 12.6 N."""
PERIOD_NS = 1_000_000


def two_walls(zero: Literal["start"] | int) -> Plan:
    scene = scene_of(
        Wall("left", stiffness=600.0, position=0.02), Wall("right", stiffness=600.0, position=0.0, name="other")
    )
    return plan_of(scene, rig=rig_of(scene, mechanism=LinearMechanism("linear", 0.05, zero=zero)))


class Handles:
    """Two handles in a cycle that has just been enabled; the feedback of the right one may be missing."""

    def __init__(self, zero: Literal["start"] | int) -> None:
        self.cycle, self._t_ns = Cycle(two_walls(zero)), 0

    def period(self, right: int | None, age_ns: int = 0) -> tuple[int, int, int, int]:
        """Controlword and target torque of both; the right handle is at these counts, None: not told."""
        self._t_ns += PERIOD_NS
        stale = 0 if right is not None else LinkFlag.STALE
        axes = (0, 0, 0, age_ns, stale, 0, ENABLED, 0, 0, ENABLED, right or 0, 0)
        output = struct.unpack("<HhHh", self.cycle(struct.pack("<qIHHIHHHihHih", self._t_ns, *axes)))
        return output[0], output[1], output[2], output[3]


@pytest.mark.parametrize("missing", [0, 1, 2, 25])
def test_a_large_force_is_refused_also_when_feedback_comes_later_than_the_power_state(missing: int) -> None:
    handles = Handles(zero=0)
    for _ in range(missing):
        assert handles.period(None) == (0x0F, 0, 0x0F, 0)
    assert handles.period(INSIDE) == (0, 0, 0, 0)
    trip = handles.cycle.trip
    assert trip is not None
    assert (trip.kind, trip.axis) == (TripKind.START_FORCE, "right")
    assert trip.value == pytest.approx(-600.0 * INSIDE * COUNT)


def test_zero_is_where_the_handle_is_when_it_is_first_told() -> None:
    handles = Handles(zero="start")
    handles.period(None)
    for _ in range(5):
        assert handles.period(INSIDE) == (0x0F, 0, 0x0F, 0)
    assert handles.cycle.trip is None
    assert handles.cycle.axes["right"].state.zero_counts == INSIDE


def test_an_axis_whose_feedback_never_comes_ends_the_run_by_its_age() -> None:
    handles = Handles(zero=0)
    for age in range(0, 31, 10):
        assert handles.period(None, age * PERIOD_NS) == (0x0F, 0, 0x0F, 0)
    assert handles.period(None, 31 * PERIOD_NS) == (0, 0, 0, 0)
    assert handles.cycle.trip is not None
    assert (handles.cycle.trip.kind, handles.cycle.trip.axis) == (TripKind.FEEDBACK_LOST, "right")


def test_of_one_axis_too_the_position_is_waited_for() -> None:
    """Of a drive that sends statusword and position in two TPDOs."""
    scene = scene_of(Wall("handle", stiffness=600.0, position=-0.05))
    cycle = Cycle(plan_of(scene))
    assert sent(cycle(image(flags=LinkFlag.STALE))) == (0x0F, 0)
    assert sent(cycle(image())) == (0, 0)
    assert cycle.trip is not None
    assert cycle.trip.kind is TripKind.START_FORCE

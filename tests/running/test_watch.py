"""Values shown of an axis that is watched, against values worked out by hand; and the pace of the looks."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from haptic_fieldbus.buses.scan_result import DriveReading
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.cia402 import MappedObject, VelocitySection
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import LinearMechanism, RigAxis, RotaryMechanism
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.running.watch import ENABLED, Viewer, Watched, watch_axes
from haptic_fieldbus.signals import Signal

PROFILE = canopen_profile(load_profile("generic_cia402"))
LINEAR = RigAxis("bus", 5, PROFILE.name, LinearMechanism("linear", 0.05, sign=-1, zero=1000), 4000, rated_torque=0.4)


def seen(t_ns: int = 0, status: int = 0x0270, **values: int) -> DriveReading:
    named = {Signal.STATUSWORD: status, **{Signal[name.upper()]: value for name, value in values.items()}}
    return DriveReading(t_ns, named, age=0.004)


def test_counts_become_metres_of_the_handle_and_permille_become_torque_at_the_shaft() -> None:
    view = Viewer(Watched(LINEAR, PROFILE, CIA402)).view(seen(position=2000, torque_actual=-250))
    assert view.position == pytest.approx(-0.0125)  # a quarter of a turn, reversed
    assert view.torque_actual == pytest.approx(-0.1)
    assert (view.state, view.statusword, view.unit, view.age_s) == ("switch on disabled", 0x0270, "m", 0.004)
    assert view.velocity is None


def test_the_first_place_is_zero_where_the_rig_says_start_and_a_gear_divides() -> None:
    viewer = Viewer(Watched(replace(LINEAR, mechanism=RotaryMechanism("rotary", 10.0)), PROFILE, CIA402))
    assert viewer.view(seen(position=7777)).position == 0.0
    view = viewer.view(seen(t_ns=100_000_000, position=7777 + 4000))
    assert view.position == pytest.approx(2 * math.pi / 10)
    assert view.velocity == pytest.approx(2 * math.pi)
    assert view.unit == "rad"


def test_the_velocity_of_the_drive_is_taken_where_it_offers_one() -> None:
    velocity = VelocitySection(MappedObject(0x606C, DataType.INT32, unit="rpm"))
    viewer = Viewer(Watched(LINEAR, replace(PROFILE, velocity=velocity), CIA402))
    assert viewer.view(seen(position=0, velocity=120)).velocity == pytest.approx(-0.1)  # two turns a second, reversed


def test_without_a_rig_there_are_steps_of_the_drive_alone() -> None:
    bare = replace(LINEAR, rated_torque=None)
    view = Viewer(Watched(bare, PROFILE, CIA402, known=False)).view(seen(position=5, torque_actual=3))
    assert (view.position, view.velocity, view.torque_actual, view.unit) == (None, None, None, None)
    assert (view.position_counts, view.torque_actual_raw) == (5, 3)


@pytest.mark.parametrize(
    ("status", "words"),
    [(0x0, "not ready to switch on"), (0x40, "switch on disabled"), (0x21, "ready to switch on"),
     (0x23, "switched on"), (0x27, "operation enabled"), (0x07, "quick stop active"),
     (0x0F, "fault reaction active"), (0x08, "fault")],
)  # fmt: skip
def test_a_statusword_has_the_words_of_cia_402(status: int, words: str) -> None:
    view = Viewer(Watched(LINEAR, PROFILE, CIA402)).view(seen(status=status, position=0))
    assert view.state == words
    assert (view.note == ENABLED) is (words == "operation enabled")


def test_values_that_did_not_come_are_none_and_leave_no_velocity_behind() -> None:
    viewer = Viewer(Watched(LINEAR, PROFILE, CIA402))
    viewer.view(seen(position=0))
    lost = viewer.view(DriveReading(50_000_000, note="no answer"))
    assert (lost.position, lost.state, lost.note, lost.age_s) == (None, None, "no answer", None)
    assert viewer.view(seen(t_ns=100_000_000, position=9999)).velocity is None


class Slow:
    """An onlooker whose look takes a while."""

    listened = masters = ""

    def __init__(self, clock: VirtualClock, takes_ns: int) -> None:
        self._clock, self._takes_ns = clock, takes_ns
        self.looks: list[int] = []

    def look(self) -> Mapping[str, DriveReading]:
        self.looks.append(self._clock.now_ns())
        self._clock.compute(self._takes_ns)
        return {"handle": seen(position=0)}


@pytest.mark.parametrize(
    ("takes_ms", "expected_ms"),
    [(1, [0, 100, 200, 300, 400]), (99, [0, 100, 200, 300, 400]), (150, [0, 150, 300, 450])],
)
def test_looks_that_are_late_are_left_out(takes_ms: int, expected_ms: list[int]) -> None:
    clock = VirtualClock()
    slow = Slow(clock, takes_ms * 1_000_000)
    views: list[Any] = list(watch_axes({"handle": Watched(LINEAR, PROFILE, CIA402)}, [slow], clock, 0.1, 0.5))
    assert len(views) == len(slow.looks)
    assert [at // 1_000_000 for at in slow.looks] == expected_ms

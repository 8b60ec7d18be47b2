"""Set-points sent against those that the drive shows, from bytes to bytes: a drive by hand that hears, or does not."""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.plausibility import EchoMismatch
from haptic_fieldbus.cycle.safety import Trip, TripKind
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.drive.cia402 import MappedObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import LinearMechanism
from haptic_fieldbus.errors import DriveFaultError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import PERMILLE, PROFILE, plan_of, rig_of, scene_of
from tests.lanes import examples

ENABLED = 0x0637
UNIT = 0.4 / 1000 / (0.05 / (2 * math.pi))
"""One step of target torque [N]."""
RATES = (1000.0, 250.0, 50.0)
LAG = 1.0 / (2.0 * math.pi * 1000.0)
SlowDown = Literal["demand", "actual"]
DEMAND = MappedObject(0x6074, DataType.INT16, unit=PERMILLE)
SLOW = replace(PROFILE, pdo=replace(PROFILE.pdo, rpdo_acts="next_sync"))
FADED_IN = 0.6
"""[s]"""


@dataclass
class ForceByPeriod:
    """An element that asks for what it is told; as a value it is the same whatever that is."""

    steps: Callable[[int], int]
    axis: str = "handle"
    name: str = "asked"
    needs: Sequence[Signal] = (Signal.POSITION,)
    period: int = 0

    def force(self, position: float) -> float:
        self.period += 1
        return UNIT * self.steps(self.period)

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


def plan_with(steps: Callable[[int], int], rate: float, profile: CanopenProfile, sign: Literal[-1, 1] = 1) -> Plan:
    scene = scene_of(ForceByPeriod(steps))  # type: ignore[arg-type]
    rig = rig_of(scene, mechanism=LinearMechanism("linear", 0.05, sign=sign))
    return compile_plan(scene, rig, {PROFILE.name: profile}, rate)


def profile_of(way: SlowDown, base: CanopenProfile = PROFILE) -> CanopenProfile:
    return replace(base, torque=replace(base.torque, demand=DEMAND if way == "demand" else None, echo=way))


@dataclass
class Drive:
    """Shows target torques as a drive does; from the period `deaf_at` on it keeps the one it has."""

    way: SlowDown
    rate: float
    """[Hz]"""
    deaf_at: float = math.inf
    highest: int = 32767
    lost: Callable[[int], bool] = lambda number: False
    noise: Callable[[int], int] = lambda number: 0
    waits: bool = False

    def __post_init__(self) -> None:
        self.number = 0
        self.heard, self.acting, self.torque = 0, 0, 0.0

    def take(self, target: int) -> None:
        self.number += 1
        if self.number < self.deaf_at and not self.lost(self.number):
            self.heard = max(-self.highest, min(self.highest, target))

    def show(self) -> int:
        """At the next latch."""
        before, self.acting = self.acting, self.heard
        if self.way == "demand":
            return (before if self.waits else self.acting) + self.noise(self.number)
        late = 1.0 / self.rate if self.waits else 0.0004
        self.torque = before + (self.torque - before) * math.exp(-late / LAG)
        self.torque = self.acting + (self.torque - self.acting) * math.exp(-(1.0 / self.rate - late) / LAG)
        return round(self.torque) + self.noise(self.number)


def trip_of(
    plan: Plan, drive: Drive, seconds: float, stale: Callable[[int], bool] = lambda number: False
) -> Trip | None:
    """Run cycle and drive beside each other."""
    cycle, shown = Cycle(plan), 0
    for number in range(round(seconds * drive.rate)):
        if not stale(number):
            shown = drive.show()
        flags = LinkFlag.STALE if stale(number) else 0
        age = 100_000 + (plan.period_ns if flags else 0)
        image = struct.pack("<qIHHHih", number * plan.period_ns, age, flags, 0, ENABLED, 0, shown)
        _, target = struct.unpack("<Hh", cycle(image))
        if cycle.trip is not None:
            return cycle.trip
        drive.take(target)
    return None


def constant(number: int) -> int:
    return 150


def wave(periods: float, amplitude: int = 150) -> Callable[[int], int]:
    return lambda number: round(amplitude * math.sin(2.0 * math.pi * number / periods))


def square(periods: int) -> Callable[[int], int]:
    return lambda number: 150 if number // periods % 2 else -150


MOTIONS: dict[str, Callable[[int], int]] = {
    "constant": constant,
    "slow wave": wave(300.0),
    "fast wave": wave(7.0),
    "to and fro each period": square(1),
    "to and fro each other period": square(2),
    "to and fro each twentieth": square(20),
}
WAYS: tuple[SlowDown, ...] = ("demand", "actual")


@pytest.mark.thorough("every motion at every rate", quick=2)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", MOTIONS)
def test_a_drive_that_hears_never_trips(way: SlowDown, rate: float, name: str) -> None:
    assert trip_of(plan_with(MOTIONS[name], rate, profile_of(way)), Drive(way, rate), 3.0) is None


@pytest.mark.thorough("every motion", quick=1)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", MOTIONS)
def test_a_drive_that_takes_over_at_a_sync_never_trips(way: SlowDown, name: str) -> None:
    for plan in (profile_of(way, SLOW), profile_of(way)):  # also one that does so although its profile says otherwise
        assert trip_of(plan_with(MOTIONS[name], 1000.0, plan), Drive(way, 1000.0, waits=True), 3.0) is None


@pytest.mark.parametrize(("beside", "trips"), [(1, False), (-1, False), (2, True), (-2, True)])
def test_a_demand_that_is_two_steps_beside_the_target_is_another_one(beside: int, trips: bool) -> None:
    drive = Drive("demand", 1000.0, noise=lambda number: beside)
    assert bool(trip_of(plan_with(constant, 1000.0, profile_of("demand")), drive, 2.0)) is trips


def swinging_a_little(number: int) -> int:
    """A jump of two steps to the middle of a swing of two steps, which never leaves the tolerance around it."""
    return (-21, -22, -20)[number % 3] if number > 900 else -19


def test_a_control_tick_at_the_next_sync_may_show_either_target_and_never_trips() -> None:
    late = replace(PROFILE, timing=replace(PROFILE.timing, control_period=0.001))
    plan = plan_with(swinging_a_little, 1000.0, profile_of("demand", late))
    assert plan.delay.bus + plan.delay.compute + plan.delay.drive == pytest.approx(plan.period)
    for waits in (False, True):
        assert trip_of(plan, Drive("demand", 1000.0, waits=waits), 3.0) is None


@pytest.mark.thorough("every motion at every rate", quick=4)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", [name for name in MOTIONS if name != "constant"])
def test_a_drive_that_no_longer_hears_trips_in_time(way: SlowDown, rate: float, name: str) -> None:
    """The deadline runs from the first target that differs by more than the tolerance from the one that is kept."""
    deaf_at, tolerance = round(FADED_IN * rate) + 3, 30 if way == "actual" else 1
    plan = plan_with(MOTIONS[name], rate, profile_of(way))
    drive = Drive(way, rate, deaf_at)
    trip = trip_of(plan, drive, 4.0)
    assert trip is not None
    assert trip.kind is TripKind.SET_POINTS_DEAD
    changes = [
        number for number in range(deaf_at, deaf_at + 400) if abs(MOTIONS[name](number) - drive.heard) > tolerance
    ]
    longest = max(0.035, 3.0 / rate)
    # Period n is latched at n − 1; torques that swing about the kept one differ in every other period or less.
    waited = trip.t_ns * 1e-9 - (changes[0] - 1) / rate
    assert longest - 1.5 / rate <= waited <= longest + 21 / rate


def test_what_a_drive_gives_while_it_does_not_hear_is_booked() -> None:
    """For 20 of the 35 ms after which it trips, the drive keeps 150 steps where 60 are sent, and the handle moves."""
    deaf, speed, plan = range(900, 920), 0.02, plan_with(lambda n: 150 if n < 900 else 60, 1000.0, profile_of("demand"))
    drive, cycle = Drive("demand", 1000.0, lost=lambda number: number in deaf), Cycle(plan)
    for number in range(1000):
        shown, counts = drive.show(), round(min(max(0, number - 900), 30) * 1e-3 * speed / plan.axes[0].position_unit)
        image = struct.pack("<qIHHHih", number * plan.period_ns, 100_000, 0, 0, ENABLED, counts, shown)
        drive.take(struct.unpack("<Hh", cycle(image))[1])
    assert cycle.trip is None
    (ledger,) = cycle.ledgers
    # The first of these periods does not count.
    assert ledger.booked["echo"] == pytest.approx(90 * UNIT * speed * (len(deaf) - 1) * 1e-3, rel=0.15)


@pytest.mark.parametrize("way", WAYS)
def test_a_constant_torque_proves_nothing_until_it_changes(way: SlowDown) -> None:
    changes_at = 2500
    plan = plan_with(lambda number: 150 if number < changes_at else 90, 1000.0, profile_of(way))
    trip = trip_of(plan, Drive(way, 1000.0, deaf_at=700), 4.0)
    assert trip is not None
    assert trip.t_ns * 1e-9 == pytest.approx(changes_at * 1e-3 + 0.035, abs=0.003)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("rate", RATES)
def test_torque_that_the_drive_cuts_trips(way: SlowDown, rate: float) -> None:
    plan = plan_with(lambda number: 200 if number > FADED_IN * rate else 60, rate, profile_of(way))
    trip = trip_of(plan, Drive(way, rate, highest=100), 4.0)
    assert trip is not None
    assert trip.value == pytest.approx(100 * UNIT)
    assert trip.limit == pytest.approx(200 * UNIT)
    error = trip_error(trip, plan, 0)
    assert isinstance(error, DriveFaultError)
    shown = "torque demand" if way == "demand" else "torque actual"
    for words in ("set-points do not act", "10.1 N was sent", f"{shown} of node 1 is 5.03 N"):
        assert words in str(error)


@pytest.mark.thorough("6 cases of one rule", quick=3)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("every", [2, 3, 10])
def test_single_set_points_that_are_lost_all_the_time_are_no_reason_to_stop(way: SlowDown, every: int) -> None:
    drive = Drive(way, 1000.0, lost=lambda number: number % every == 0)
    assert trip_of(plan_with(wave(40.0), 1000.0, profile_of(way)), drive, 4.0) is None


@pytest.mark.parametrize("way", WAYS)
def test_feedback_that_is_missing_now_and_then_is_no_reason_to_stop(way: SlowDown) -> None:
    gaps = {number + more for number in range(700, 4000, 97) for more in range(3)}
    assert trip_of(plan_with(wave(300.0), 1000.0, profile_of(way)), Drive(way, 1000.0), 4.0, gaps.__contains__) is None


@pytest.mark.parametrize("way", WAYS)
def test_targets_that_fade_in_a_gap_and_are_never_sent_are_no_reason_to_stop(way: SlowDown) -> None:
    """On Modbus TCP nothing is sent while an answer is open. A constant torque agrees then, which proves nothing."""
    gaps = {number + more for number in range(700, 4000, 34) for more in range(3)}
    drive = Drive(way, 1000.0, lost=lambda number: number - 1 in gaps)
    assert trip_of(plan_with(constant, 1000.0, profile_of(way)), drive, 4.0, gaps.__contains__) is None


@pytest.mark.parametrize("way", WAYS)
def test_a_mechanism_that_turns_the_sign_around_is_followed(way: SlowDown) -> None:
    plan = plan_with(wave(50.0), 1000.0, profile_of(way), sign=-1)
    assert trip_of(plan, Drive(way, 1000.0), 2.0) is None
    assert trip_of(plan, Drive(way, 1000.0, deaf_at=800), 2.0) is not None


@given(st.lists(st.integers(-29, 29), min_size=7, max_size=50))
def test_noise_of_the_current_within_3_percent_of_rated_is_no_reason_to_stop(noise: list[int]) -> None:
    drive = Drive("actual", 250.0, noise=lambda number: noise[number % len(noise)])
    assert trip_of(plan_with(constant, 250.0, profile_of("actual")), drive, 1.5) is None


@given(st.lists(st.integers(-150, 150), min_size=20, max_size=60), st.integers(1, 9), st.integers(0, 60))
@settings(max_examples=examples(20))
def test_whatever_is_asked_a_frozen_torque_trips_once_the_targets_stay_away_from_it(
    asked: list[int], each: int, deaf_after: int
) -> None:
    """At the end the target is 5 % of rated away from any torque that is kept: what a hand may be left alone with."""
    deaf_at = 600 + deaf_after

    def steps(number: int) -> int:
        return asked[number // each % len(asked)] if number < 1200 else 210

    for way in WAYS:
        hears, deaf = Drive(way, 1000.0), Drive(way, 1000.0, deaf_at)
        assert trip_of(plan_with(steps, 1000.0, profile_of(way)), hears, 1.3) is None
        trip = trip_of(plan_with(steps, 1000.0, profile_of(way)), deaf, 1.3)
        assert trip is not None
        assert trip.t_ns <= 1_245_000_000


@pytest.mark.parametrize(("way", "told"), [(1e-3, [10.0 * UNIT * 1e-3]), (-1e-3, [])])
def test_what_the_motor_gave_beyond_what_was_sent_is_told_when_the_doubt_ends(way: float, told: list[float]) -> None:
    """Two samples of 5 steps more than were sent, each along 1 mm; the first of a doubt is a matter of timing."""
    found = list[float]()
    (axis,) = plan_of().axes
    doubt = EchoMismatch(axis, AxisState(way=way), 1e-3, 1.0, lambda *_: None, found.append)
    for number, shown in enumerate((10, 11, 10)):
        doubt.look(number * 1_000_000, shown, 5 + shown % 2, (5,))
    assert not found
    doubt.look(3_000_000, 5, 5, (5,))
    assert found == pytest.approx(told)
    assert not doubt.open


def test_it_is_told_too_when_the_doubt_ends_the_run() -> None:
    found, trips = list[float](), list[object]()
    (axis,) = plan_of().axes
    doubt = EchoMismatch(axis, AxisState(way=1e-3), 1e-3, 1.0, lambda *trip: trips.append(trip), found.append)
    for number in range(40):
        doubt.look(number * 1_000_000, 10, 5, (5,))
        if trips:
            break
    assert found == [pytest.approx(number * 5.0 * UNIT * 1e-3)]

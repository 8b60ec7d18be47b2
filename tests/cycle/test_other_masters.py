"""Set-points of another master on Modbus, counted by what a drive shows: a drive and a gateway written by hand.

The drive here takes over each target at once; its torque follows with a lag that is worked out exactly. Another master
writes its own targets in between, which the loop never hears of.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import Trip, TripKind
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.drive.rig import Limits, Rig, default_axis
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import LinkFlag, Signal, Workspace
from tests.builders import scene_of
from tests.cycle.test_echo import ENABLED, MOTIONS, ForceByPeriod, wave
from tests.lanes import examples
from tests.protocols.modbus.lines import GENERIC, RTU, TCP, traffic_of, with_line

BEGINS = 1.0
"""[s] at which the other master begins."""
THEIRS = 800
"""Its target [‰ of rated torque]."""
ONE, TWO = (3, 23), (3, 16)
"""Functions of a drive that is written and read by one request, and by two."""


def echoing(echo: str, functions: tuple[int, ...], *, actual: bool = True) -> ModbusProfile:
    """A drive whose set-points come back in this way."""
    torque = replace(GENERIC.torque, echo=echo)  # type: ignore[arg-type]
    return replace(with_line(GENERIC, functions=functions), torque=torque if actual else replace(torque, actual=None))


DRIVES: dict[str, tuple[ModbusProfile, Signal]] = {
    "demand, two requests": (echoing("demand", TWO), Signal.TORQUE_DEMAND),
    "demand, one request": (echoing("demand", ONE), Signal.TORQUE_ACTUAL),
    "actual, two requests": (echoing("actual", TWO), Signal.TORQUE_ACTUAL),
    "actual, one request": (echoing("actual", ONE), Signal.TORQUE_ACTUAL),
    "demand alone, one request": (echoing("demand", ONE, actual=False), Signal.TARGET_ASKED),
    "none, one request": (echoing("none", ONE), Signal.TARGET_ASKED),
    "none, two requests": (echoing("none", TWO), Signal.TARGET_ASKED),
}
"""Drive → profile, and the signal that shows a set-point of another master."""
FASTEST = {"none, two requests": 500.0}
"""Rates that their three requests in a period permit [Hz]."""


def plan_with(steps: Callable[[int], int], rate: float, profile: ModbusProfile, bus: str = TCP, axes: int = 1) -> Plan:
    names = ("handle", "second", "third")[:axes]
    scene: Scene = scene_of(*(ForceByPeriod(steps, name, f"asked {name}") for name in names))  # type: ignore[arg-type]
    rigs = {
        name: replace(default_axis(Workspace.LINEAR, bus="line", node=number, profile="drive"), limits=Limits())
        for number, name in enumerate(names, start=1)
    }
    return compile_plan(scene, Rig({"line": parse_bus(bus).section}, rigs), {"drive": profile}, rate)


@dataclass
class Drive:
    """A drive behind a line, and the other master's set-points as times [s] and targets [‰]."""

    plan: Plan
    theirs: Iterable[tuple[float, int]] = ()
    gateway: bool = False
    """Whether what it answers is a period old."""
    highest: int = 32767
    """Largest torque that its current loop makes [‰]."""
    lost: Callable[[int], bool] = lambda number: False
    stale: Callable[[int], bool] = lambda number: False
    """Periods without an answer: what came last stands in the image."""
    noise: Callable[[int], int] = lambda number: 0
    acted: list[float] = field(default_factory=list)
    """For how long each set-point of the other master has acted [s]."""

    def __post_init__(self) -> None:
        (self.axis,) = self.plan.axes
        self.lag = self.axis.delay.torque_loop
        self.waiting = iter(sorted(self.theirs))
        self.next = next(self.waiting, (math.inf, 0))
        self.now, self.target, self.torque = 0.0, 0, 0.0
        self.since: float | None = None

    def advance(self, t: float) -> None:
        """Follow the targets up to this time."""
        while self.next[0] <= t:
            when, target = self.next
            self._follow(when)
            self.target, self.since = target, when if self.since is None else self.since
            self.next = next(self.waiting, (math.inf, 0))
        self._follow(t)

    def _follow(self, t: float) -> None:
        goal = max(-self.highest, min(self.highest, self.target))
        self.torque = goal + (self.torque - goal) * math.exp(-(t - self.now) / self.lag)
        self.now = t

    def take(self, target: int, number: int) -> None:
        """Take a set-point of ours."""
        if self.lost(number):
            return
        if self.since is not None:
            self.acted.append(self.now - self.since)
            self.since = None
        self.target = target

    def run(self, seconds: float) -> Trip | None:
        """Run cycle and drive beside each other."""
        cycle, times, old, written = Cycle(self.plan), traffic_of(self.plan).instants, None, 0
        one, places = traffic_of(self.plan).delay("handle").acts_first, self.plan.image.axes[0]
        read_at, written_at = times.latched["handle"], times.written["handle"]
        asked_at, period = times.shown["handle"], self.plan.period
        for number in range(round(seconds / period)):
            start = number * period
            values = {Signal.STATUSWORD: ENABLED, Signal.POSITION: 0, Signal.ASKED_PERIODS: 1}
            self.advance(start + min(asked_at, read_at))
            values[Signal.TARGET_ASKED] = self.target
            self.advance(start + read_at)
            values[Signal.TORQUE_ACTUAL] = round(self.torque) + self.noise(number)
            if one:
                self.take(written, number)
            values[Signal.TORQUE_DEMAND] = self.target
            stale = self.stale(number)
            shown = old if old is not None and (self.gateway or stale) else values
            old = shown if stale else values
            signals = [shown[mapped.signal] for mapped in self.axis.incoming]
            latched_ns = round(1e9 * (start + read_at))
            _, written = places.output.unpack_from(
                cycle(places.input.pack(latched_ns, 100_000, LinkFlag.STALE if stale else 0, 0, *signals)),
                places.outputs[0],
            )
            if cycle.trip is not None:
                self.advance(start + written_at + (period if one else 0.0))
                self.take(0, number)
                return cycle.trip
            if not one:
                self.advance(start + written_at)
                self.take(written, number)
        return None


def every(interval: float, target: int = THEIRS, phase: float = 0.0, until: float = 60.0) -> list[tuple[float, int]]:
    """Set-points of the other master once every so many seconds."""
    return [(BEGINS + phase + number * interval, target) for number in range(round((until - BEGINS) / interval))]


def little(number: int) -> int:
    """Torque that a drive without any echo may give at the start."""
    return 10


def asked_of(name: str) -> Callable[[int], int]:
    return little if name.startswith("none") else wave(40.0)


def stated(plan: Plan) -> float:
    return next(each.seconds for each in plan.deadlines if each.cause is EndCause.OTHER_MASTER)


@pytest.mark.parametrize("name", DRIVES)
def test_the_signal_that_shows_them_is_the_one_that_the_way_leaves(name: str) -> None:
    profile, signal = DRIVES[name]
    (axis,) = plan_with(constant_ten, 50.0, profile).axes
    assert axis.other_masters is not None
    assert axis.other_masters.shown_by is signal


def constant_ten(number: int) -> int:
    return 10


@pytest.mark.thorough("every motion on every drive", quick=3)
@pytest.mark.parametrize("gateway", [False, True], ids=["", "gateway"])
@pytest.mark.parametrize("rate", [1000.0, 50.0])
@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_with_one_master_never_trips(name: str, motion: str, rate: float, gateway: bool) -> None:
    """Nor does one behind a gateway whose answers are a period old."""
    profile, _ = DRIVES[name]
    steps = little if name.startswith("none") else MOTIONS[motion]
    assert Drive(plan_with(steps, min(rate, FASTEST.get(name, rate)), profile), gateway=gateway).run(2.0) is None


@pytest.mark.parametrize("bus", [TCP, RTU])
def test_a_drive_that_clips_its_current_is_not_taken_for_one_with_two_masters(bus: str) -> None:
    """Torque actual beside the echo: less than was sent is no sign of another master."""
    plan = plan_with(wave(40.0), 80.0, echoing("demand", ONE), bus)
    assert Drive(plan, highest=60).run(3.0) is None


@given(st.lists(st.integers(-49, 49), min_size=7, max_size=50))
@settings(max_examples=examples(10))
def test_noise_of_5_percent_of_rated_is_no_sign_of_another_master(noise: list[int]) -> None:
    plan = plan_with(wave(40.0), 250.0, echoing("demand", ONE))
    assert Drive(plan, noise=lambda number: noise[number % len(noise)]).run(1.5) is None


def test_a_current_loop_that_overshoots_by_a_quarter_is_no_sign_of_another_master() -> None:
    """A quarter of 150 ‰ and noise of nearly 5 % of rated torque, once in each half of a square wave."""
    plan = plan_with(lambda number: 150 if number // 10 % 2 else 0, 250.0, echoing("demand", ONE))
    ringing = Drive(plan, noise=lambda number: 85 if number % 10 == 2 else 0)
    assert ringing.run(3.0) is None


@pytest.mark.parametrize("each", [2, 3, 10])
def test_set_points_that_are_lost_all_the_time_are_no_sign_of_another_master(each: int) -> None:
    plan = plan_with(wave(40.0), 1000.0, echoing("demand", TWO))
    assert Drive(plan, lost=lambda number: number % each == 0).run(3.0) is None


def test_what_stands_in_the_image_without_an_answer_is_not_counted() -> None:
    """One set-point of another master, behind which three answers stay away, is counted once."""
    plan = plan_with(constant_ten, 50.0, echoing("demand", TWO))
    drive = Drive(plan, [(BEGINS + 0.001, THEIRS)], stale=lambda number: number in (52, 53, 54))
    assert drive.run(2.0) is None


def test_a_slow_torque_loop_is_no_sign_of_another_master() -> None:
    profile = echoing("demand", ONE)
    slow = replace(profile, timing=replace(profile.timing, torque_bandwidth=10.0))
    assert Drive(plan_with(MOTIONS["to and fro each twentieth"], 250.0, slow)).run(3.0) is None


@pytest.mark.thorough("every drive", quick=3)
@pytest.mark.parametrize("gateway", [False, True], ids=["", "gateway"])
@pytest.mark.parametrize("rate", [1000.0, 50.0])
@pytest.mark.parametrize("interval", [0.0007, 0.0113, 0.05, 0.333, 2.03])
@pytest.mark.parametrize("name", DRIVES)
def test_they_act_no_longer_than_stated_at_any_rate(name: str, interval: float, rate: float, gateway: bool) -> None:
    profile, _ = DRIVES[name]
    plan = plan_with(asked_of(name), min(rate, FASTEST.get(name, rate)), profile)
    (axis,) = plan.axes
    assert axis.other_masters is not None
    # The first one comes just behind one of ours.
    drive = Drive(plan, every(interval, phase=traffic_of(plan).instants.written["handle"] + 2e-5), gateway)
    trip = drive.run(BEGINS + 8.0)
    assert trip is not None
    assert trip.kind in (TripKind.SET_POINTS_FOREIGN, TripKind.SET_POINTS_DEAD)
    assert sum(each for each in drive.acted if each > axis.other_masters.blind) <= stated(plan)


@given(st.floats(0.001, 0.4), st.floats(0.0, 0.02), st.sampled_from((-1000, -700, 300, 800)))
@settings(max_examples=examples(15))
def test_whenever_they_come_those_that_can_be_seen_act_no_longer_than_stated(
    interval: float, phase: float, target: int
) -> None:
    for name in ("demand, two requests", "demand, one request", "demand alone, one request"):
        profile, _ = DRIVES[name]
        plan = plan_with(constant_ten, 50.0, profile)
        (axis,) = plan.axes
        assert axis.other_masters is not None
        drive = Drive(plan, every(interval, target, phase))
        drive.run(BEGINS + 3.0)
        assert sum(each for each in drive.acted if each > axis.other_masters.blind) <= stated(plan)


def test_the_trip_names_the_bus_what_was_shown_and_what_was_sent() -> None:
    plan = plan_with(constant_ten, 50.0, echoing("demand", TWO))
    trip = Drive(plan, every(0.05)).run(BEGINS + 3.0)
    assert trip is not None
    error = trip_error(trip, plan, 0)
    assert isinstance(error, SafetyTripError)
    for words in ("another master on sim-modbus-tcp sets the torque of unit 1: 3 times within 0.1 s", "40.2 N"):
        assert words in str(error)


def is_counted(trip: Trip | None) -> bool:
    """Whether it was counted; what differs for long is a trip of the echo in any case."""
    return trip is not None and trip.kind is TripKind.SET_POINTS_FOREIGN


class TestUnseen:
    """Set-points that the plan calls unseen: each for as long as it says."""

    @pytest.mark.parametrize("name", ["demand, two requests", "demand alone, one request"])
    def test_one_between_question_and_set_point_acts_until_the_set_point(self, name: str) -> None:
        profile, _ = DRIVES[name]
        plan = plan_with(constant_ten, 50.0, profile)
        (axis,), times = plan.axes, traffic_of(plan).instants
        assert axis.other_masters is not None
        after = times.shown["handle"] + 1e-5
        drive = Drive(plan, [(BEGINS + number * plan.period + after, THEIRS) for number in range(100)])
        assert drive.run(BEGINS + 2.0) is None
        assert len(drive.acted) == 100
        assert max(drive.acted) <= axis.other_masters.blind

    def test_one_just_before_ours_has_not_moved_the_torque_yet(self) -> None:
        """Torque actual follows with the lag of the torque loop."""
        plan = plan_with(constant_ten, 50.0, echoing("demand", ONE))
        (axis,), times = plan.axes, traffic_of(plan).instants
        assert axis.other_masters is not None
        before = times.written["handle"] - 1e-5
        drive = Drive(plan, [(BEGINS + number * plan.period + before, THEIRS) for number in range(100)])
        assert drive.run(BEGINS + 2.0) is None
        assert max(drive.acted) <= axis.other_masters.blind

    @pytest.mark.parametrize(("target", "is_seen"), [(200, False), (260, True), (-40, False), (-60, True), (0, False)])
    def test_one_within_5_percent_of_rated_torque_of_ours_or_weaker(self, target: int, is_seen: bool) -> None:
        """Ours are 0 and 200 ‰ of rated torque by turns."""
        plan = plan_with(lambda number: 200 if number // 2 % 2 else 0, 50.0, echoing("demand", TWO))
        assert is_counted(Drive(plan, every(0.0501, target)).run(BEGINS + 3.0)) is is_seen

    @pytest.mark.parametrize(("target", "is_seen"), [(290, False), (310, True)])
    def test_one_within_an_overshoot_where_torque_is_measured(self, target: int, is_seen: bool) -> None:
        plan = plan_with(lambda number: 200 if number // 2 % 2 else 0, 50.0, echoing("demand", ONE))
        assert is_counted(Drive(plan, every(0.0501, target)).run(BEGINS + 3.0)) is is_seen

    @pytest.mark.parametrize(("interval", "is_seen"), [(5.2, False), (4.8, True)])
    def test_fewer_than_three_within_10_seconds(self, interval: float, is_seen: bool) -> None:
        plan = plan_with(constant_ten, 50.0, echoing("demand", TWO))
        drive = Drive(plan, every(interval))
        assert (drive.run(BEGINS + 3.5 * interval) is not None) is is_seen
        assert max(drive.acted) <= plan.period + 1e-9

    def test_a_burst_counts_as_one(self) -> None:
        """At 1 kHz, noise in three samples in a row."""
        plan = plan_with(constant_ten, 1000.0, echoing("demand", TWO))
        assert Drive(plan, [(BEGINS + 0.001 * number, THEIRS) for number in range(3)]).run(2.0) is None


def test_a_target_is_read_back_from_one_unit_after_another() -> None:
    """So set-points of another master are looked for in one of three periods, and act for three times as long."""
    profile, _ = DRIVES["demand alone, one request"]
    one, three = (plan_with(constant_ten, 50.0, profile, axes=axes) for axes in (1, 3))
    assert [axis.other_masters.every for axis in three.axes if axis.other_masters] == [3, 3, 3]
    seen = 0.0005 * 3
    assert stated(three) - stated(one) == pytest.approx(3 * 2 * 0.02, abs=0.01 + seen)
    cycle, sent = Cycle(three), [0, 0, 0]
    for number in range(200):
        image = _image(three, number, sent)
        output = cycle(image)
        if cycle.trip is not None:
            break
        sent = [places.output.unpack_from(output, places.outputs[0])[1] for places in three.image.axes]
    assert cycle.trip is not None
    assert (cycle.trip.axis, cycle.trip.kind) == ("second", TripKind.SET_POINTS_FOREIGN)
    assert number == 106, "asked in the periods 100, 103 and 106"


def _image(plan: Plan, number: int, sent: list[int]) -> bytes:
    """Feedback of three units, of which the second shows another master from period 100 on, when it is asked."""
    values: list[int] = []
    for place, axis in enumerate(plan.axes):
        asked = place == 1 and number % 3 == 1
        shown = {
            Signal.STATUSWORD: ENABLED,
            Signal.POSITION: 0,
            Signal.TORQUE_DEMAND: sent[place],
            Signal.TARGET_ASKED: THEIRS if number >= 100 else sent[place],
            Signal.ASKED_PERIODS: int(asked),
        }
        values += [shown[mapped.signal] for mapped in axis.traffic.incoming]
    return plan.image.input.pack(number * plan.period_ns, *[100_000, 0, 0] * 3, *values)

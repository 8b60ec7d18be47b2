"""Set-points proved by asking: a drive written by hand that is asked now and then, from bytes to bytes."""

import math
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import Trip, TripKind
from haptic_fieldbus.cycle.trips import trip_error
from haptic_fieldbus.errors import DriveFaultError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from tests.builders import PROFILE
from tests.cycle.test_echo import ENABLED, FADED_IN, RATES, UNIT, constant, plan_with, square, wave
from tests.lanes import examples

ASKED: CanopenProfile = replace(PROFILE, torque=replace(PROFILE.torque, actual=None, echo="asked"))
AT_SYNC = replace(ASKED, pdo=replace(PROFILE.pdo, rpdo_acts="next_sync"))
EVERY = 0.005
"""[s] between two questions."""
MOTIONS: dict[str, Callable[[int], int]] = {
    "constant": constant,
    "slow wave": wave(300.0),
    "fast wave": wave(7.0),
    "to and fro each twentieth": square(20),
}


def answers_within(rate: float) -> float:
    """Patience with an answer, as the documents state it [s]."""
    return max(0.015, 2 / rate)


def stated(rate: float) -> float:
    """Longest time from the first change on, as the documents state it [s]."""
    return max(0.035, 3 / rate) + 2 * answers_within(rate)


@dataclass
class Drive:
    """Holds its target, and answers what it held at the moment of the question plus `thinking` of the way."""

    rate: float
    """[Hz]"""
    deaf_at: float = math.inf
    lost: Callable[[int], bool] = lambda number: False
    answers: Callable[[int], int | None] = lambda number: 1
    """Periods that the answer to a question takes; None: there is none."""
    waits: bool = False

    def __post_init__(self) -> None:
        self.number = 0
        self.held = [0, 0]
        """Target in force after the set-point of each period."""
        self.due: tuple[int, int, int] | None = None
        self.next = 0
        self.random = random.Random(7)

    def take(self, target: int) -> None:
        """Take the set-point of a period, and the question after it."""
        self.number += 1
        heard = self.number < self.deaf_at and not self.lost(self.number)
        self.held.append(target if heard else self.held[-1])
        if self.due is None and self.number >= self.next:
            takes = self.answers(self.number)
            self.next = self.number + max(1, math.ceil(EVERY * self.rate))
            if takes is None:
                self.next = self.number + math.ceil(answers_within(self.rate) * self.rate)
            else:
                self.due = (self.number + takes, takes, self.number)

    def answer(self) -> tuple[int, int]:
        """Content of the image of the next period: target torque, and periods since asked."""
        if self.due is None or self.number + 1 < self.due[0]:
            return 0, 0
        _, takes, asked = self.due
        self.due = None
        when = self.random.randint(asked, self.number)
        # held[n + 1] came with the set-point of period n; at a SYNC it acts one period later.
        return self.held[when + 1 - (self.waits and when == asked)], takes


def trip_of(plan: Plan, drive: Drive, seconds: float) -> Trip | None:
    """Run cycle and drive beside each other."""
    cycle = Cycle(plan)
    for number in range(round(seconds * drive.rate)):
        shown, periods = drive.answer()
        image = struct.pack("<qIHHHihH", number * plan.period_ns, 100_000, 0, 0, ENABLED, 0, shown, periods)
        _, target = struct.unpack("<Hh", cycle(image))
        if cycle.trip is not None:
            return cycle.trip
        drive.take(target)
    return None


def sometimes(number: int) -> int | None:
    """Lost now and then, else quick or slow."""
    return None if number % 7 == 0 else 1 + number % 11


ANSWERS: dict[str, Callable[[int], int | None]] = {
    "quick": lambda number: 1,
    "slow": lambda number: 12,
    "lost now and then": sometimes,
}


@pytest.mark.thorough("every motion at every rate", quick=2)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("answers", ["quick", "lost now and then"])
def test_a_drive_that_hears_never_trips(answers: str, name: str, rate: float) -> None:
    answer = ANSWERS[answers] if rate > 500 else ANSWERS["quick"]
    for profile, waits in ((ASKED, False), (AT_SYNC, True), (AT_SYNC, False)):
        drive = Drive(rate, answers=answer, waits=waits)
        assert trip_of(plan_with(MOTIONS[name], rate, profile), drive, 3.0) is None


@pytest.mark.thorough("every motion at every rate", quick=3)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    ("answers", "name"),
    [
        *(("quick", name) for name in MOTIONS if name != "constant"),
        # A torque that swings faster than answers come was everything meanwhile: nothing can be proved.
        *(("slow", name) for name in ("slow wave", "to and fro each twentieth")),
    ],
)
def test_a_drive_that_no_longer_hears_trips_in_the_stated_time(answers: str, name: str, rate: float) -> None:
    """From the first target on that differs from the one that is kept; swinging ones agree with it now and then."""
    deaf_at = round(FADED_IN * rate) + 3
    answer = ANSWERS[answers] if rate > 500 else ANSWERS["quick"]
    drive = Drive(rate, deaf_at, answers=answer)
    plan = plan_with(MOTIONS[name], rate, ASKED)
    trip = trip_of(plan, drive, 4.0)
    assert trip is not None
    assert trip.kind is TripKind.SET_POINTS_DEAD
    changes = [number for number in range(deaf_at, deaf_at + 400) if abs(MOTIONS[name](number) - drive.held[-1]) > 1]
    waited = trip.t_ns * 1e-9 - (changes[0] - 1) / rate
    swing = 21 / rate if "each" in name or "fast" in name else 0.0
    assert max(0.035, 3 / rate) - 1.5 / rate <= waited <= stated(rate) + 1 / rate + swing
    assert plan.axes[0].limits.echo == pytest.approx(stated(rate))


@pytest.mark.parametrize("rate", RATES)
def test_answers_that_stay_away_are_a_trip_in_the_stated_time(rate: float) -> None:
    quiet_at = round(1.5 * rate)
    drive = Drive(rate, answers=lambda number: 1 if number < quiet_at else None)
    plan = plan_with(constant, rate, ASKED)
    trip = trip_of(plan, drive, 4.0)
    assert trip is not None
    waited = trip.t_ns * 1e-9 - quiet_at / rate
    assert stated(rate) - EVERY - 2 / rate <= waited <= stated(rate) + 1 / rate
    error = trip_error(trip, plan, 0)
    assert isinstance(error, DriveFaultError)
    assert "set-points not confirmed: node 1 has not returned its target torque for " in str(error)


def test_a_drive_that_never_answers_trips_after_enabling() -> None:
    trip = trip_of(plan_with(constant, 1000.0, ASKED), Drive(1000.0, answers=lambda number: None), 1.0)
    assert trip is not None
    assert trip.t_ns * 1e-9 == pytest.approx(stated(1000.0), abs=0.002)


@pytest.mark.thorough("3 cases of one rule", quick=2)
@pytest.mark.parametrize("every", [2, 3, 10])
def test_single_set_points_that_are_lost_all_the_time_are_no_reason_to_stop(every: int) -> None:
    drive = Drive(1000.0, lost=lambda number: number % every == 0)
    assert trip_of(plan_with(wave(40.0), 1000.0, ASKED), drive, 4.0) is None


def test_a_mechanism_that_turns_the_sign_around_is_followed() -> None:
    plan = plan_with(wave(50.0), 1000.0, ASKED, sign=-1)
    assert trip_of(plan, Drive(1000.0), 2.0) is None
    assert trip_of(plan, Drive(1000.0, deaf_at=800), 2.0) is not None


def test_torque_that_is_not_what_was_sent_is_told_with_both() -> None:
    plan = plan_with(lambda number: 200 if number > 700 else 60, 1000.0, ASKED)
    trip = trip_of(plan, Drive(1000.0, deaf_at=650), 2.0)
    assert trip is not None
    assert trip.value == pytest.approx(60 * UNIT)
    assert trip.limit == pytest.approx(200 * UNIT)
    assert "the target torque asked of node 1 is 3.02 N" in str(trip_error(trip, plan, 0))


@given(
    st.lists(st.integers(-150, 150), min_size=20, max_size=60),
    st.lists(st.integers(1, 14), min_size=1, max_size=9),
    st.integers(2, 9),
    st.integers(0, 60),
)
@settings(max_examples=examples(20))
def test_whatever_is_asked_a_frozen_torque_trips_once_the_targets_stay_away_from_it(
    targets: list[int], answers: list[int], each: int, deaf_after: int
) -> None:
    deaf_at = 600 + deaf_after

    def steps(number: int) -> int:
        return targets[number // each % len(targets)] if number < 1200 else 210

    def answer(number: int) -> int:
        return answers[number % len(answers)]

    assert trip_of(plan_with(steps, 1000.0, ASKED), Drive(1000.0, answers=answer), 1.3) is None
    trip = trip_of(plan_with(steps, 1000.0, ASKED), Drive(1000.0, deaf_at, answers=answer), 1.4)
    assert trip is not None
    assert trip.t_ns * 1e-9 <= 1.2 + stated(1000.0) + 0.002

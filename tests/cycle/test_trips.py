"""Every trip becomes one exception with a sentence."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest

from haptic_fieldbus.cycle.safety import LINK_TRIPS, Trip, TripKind
from haptic_fieldbus.cycle.trips import CAUSES, CONSEQUENCES, TRIP_ERRORS, explained, failed_in, trip_error
from haptic_fieldbus.errors import BusError, BusTimeoutError, DriveFaultError, PlanError, SafetyTripError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import LinkFlag, Signal
from tests.builders import PROFILE, VELOCITY_ONLY, WALL, plan_of, rig_of, scene_of
from tests.cases import every


@every("kind", TripKind)
def test_every_kind_of_trip_has_an_exception_and_a_cause(kind: TripKind) -> None:
    plan = plan_of(profile=VELOCITY_ONLY if kind is TripKind.DRIFT else PROFILE)
    plan = replace(plan, rig=replace(plan.rig, source="rig.toml"))
    error = trip_error(Trip(kind, "handle", 2_500_000_000, 5.0, 2.0, "fault"), plan, 1_000_000_000)
    assert isinstance(error, TRIP_ERRORS[kind])
    cause, advice = CAUSES[kind](Trip(kind, "handle", 2_500_000_000, 5.0, 2.0, "fault"), plan.axes[0])
    told = f"{cause}; no torque was applied. {advice}"
    if kind is not TripKind.START_FORCE:
        told = f"Tripped 1.500 s after enabling: {cause}; torque is off. {advice}"
    assert str(error) == told
    assert advice[:1].isupper() or advice.startswith("`")
    assert advice.endswith(".")


@pytest.mark.parametrize("table", [CAUSES, TRIP_ERRORS])
def test_the_tables_are_complete(table: dict[TripKind, object]) -> None:
    assert set(table) == set(TripKind)


def test_only_our_own_limits_are_safety_trips() -> None:
    ours = {kind for kind, error in TRIP_ERRORS.items() if error is SafetyTripError}
    assert ours == {
        TripKind.FOREIGN_MASTER,
        TripKind.SET_POINTS_FOREIGN,
        TripKind.DUPLICATE_NODE,
        TripKind.PERIODS_MISSED,
        TripKind.SIGN,
        TripKind.NOT_FINITE,
        TripKind.ELEMENT_FAILED,
        TripKind.SPEED,
        TripKind.ACCELERATION,
        TripKind.POWER,
        TripKind.ENERGY,
        TripKind.FORGIVEN,
        TripKind.HELD,
        TripKind.POSITION,
        TripKind.DRIFT,
        TripKind.ENCODER_STILL,
    }
    refusals = {kind for kind, error in TRIP_ERRORS.items() if error is PlanError}
    assert refusals == {TripKind.START_FORCE, TripKind.SIGN_HIDDEN}
    others = {error for kind, error in TRIP_ERRORS.items() if kind not in ours | refusals}
    assert all(issubclass(error, (BusError, DriveFaultError)) for error in others)


def test_limits_are_named_with_their_units_and_the_value_that_passed_them() -> None:
    trip = Trip(TripKind.POSITION, "handle", 0, 0.1234, 0.1)
    words = "Tripped before enabling: position 0.1234 m, beyond the limit of 0.1 m; torque is off. "
    advice = "Move the handle back. The travel is axis.handle.limits.position of the rig."
    advice += " Without a rig file it is that of the shipped bench; simulate --write-rig FILE writes one to widen it."
    assert str(trip_error(trip, plan_of(), None)) == words + advice


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        (TripKind.POSITION, -0.100003, "position -0.100003 m, beyond the limit of -0.1 m"),
        (TripKind.POSITION, -0.1023456, "position -0.1023 m, beyond the limit of -0.1 m"),
        (TripKind.SPEED, 2.003, "speed 2.003 m/s, above the limit of 2 m/s"),
        (TripKind.SPEED, 2.443, "speed 2.44 m/s, above the limit of 2 m/s"),
        (TripKind.POWER, 2.0004, "power 2.0004 W, above the limit of 2 W"),
    ],
)
def test_a_value_just_past_its_limit_reads_differently(kind: TripKind, value: float, words: str) -> None:
    limit = -0.1 if kind is TripKind.POSITION else 2.0
    assert words in str(trip_error(Trip(kind, "handle", 0, value, limit), plan_of(), None))


@every("flag", [LinkFlag.EMERGENCY, LinkFlag.BOOT_UP, LinkFlag.BUS_OFF])
@every("kind", TripKind)
def test_a_trip_that_turns_out_to_come_of_another_fault_of_the_link_names_that(kind: TripKind, flag: LinkFlag) -> None:
    trip = Trip(kind, "handle", 0, 0.0)
    assert explained(trip, {"other": (flag, 0x8130)}) == trip
    cause = explained(trip, {"handle": (flag, 0x8130)})
    expected = (LINK_TRIPS[flag], 0x8130) if kind in CONSEQUENCES else (kind, 0.0)
    assert (cause.kind, cause.value) == expected


def test_a_limit_of_ours_is_never_explained_away() -> None:
    """Nor is a fault that is a cause itself."""
    assert {TRIP_ERRORS[kind] for kind in CONSEQUENCES} == {BusError, BusTimeoutError, DriveFaultError}
    assert not {TripKind.BUS_OFF, TripKind.EMERGENCY, TripKind.FOREIGN_MASTER, TripKind.CLOCK} & set(CONSEQUENCES)


@pytest.mark.parametrize("kind", [TripKind.POSITION, TripKind.SPEED])
def test_a_handle_that_goes_too_far_with_a_capped_force_is_told_of_the_cap(kind: TripKind) -> None:
    capped = plan_of(rig=rig_of(WALL, inertia=None))
    told = str(trip_error(Trip(kind, "handle", 0, 0.1234, 0.1), capped, None))
    assert f" ({capped.axes[0].cap}; the hand can push through walls); torque is off." in told
    assert "push through" not in str(trip_error(Trip(kind, "handle", 0, 0.1234, 0.1), plan_of(), None))


@dataclass(frozen=True)
class Own:
    """An element of one's own on the axis `other`, whose law is a closure that fails."""

    axis: str = "other"
    name: str = "own"
    needs: ClassVar = (Signal.POSITION,)

    def begin(self, period: float) -> Callable[[float], float]:
        def law(position: float) -> float:
            raise ValueError("no such force")

        return law

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


FAILED = Trip(TripKind.ELEMENT_FAILED, "handle", 0, 0.0, detail="ValueError: no such force")


def raised(call: Callable[[], object]) -> Exception:
    """Exception of a call."""
    with pytest.raises(Exception) as caught:  # noqa: PT011 - whatever it is
        call()
    return caught.value


def test_the_failure_of_an_own_element_is_told_with_its_axis_name_file_and_line() -> None:
    scene = scene_of(Wall("handle", 100.0), Own())
    law = Own().begin(0.001)
    found = failed_in(FAILED, raised(lambda: law(0.0)), scene)
    line = Own.begin.__code__.co_firstlineno + 2
    words = "element own: Own.begin.<locals>.law raised ValueError: no such force"
    assert found == replace(FAILED, axis="other", detail=f"{words} ({__file__} line {line})")


def test_a_law_that_does_not_fit_its_call_is_told_with_the_file_of_its_class() -> None:
    scene = scene_of(Wall("handle", 100.0), Own())
    found = failed_in(FAILED, TypeError("takes 1 positional argument"), scene)
    assert found.detail == f"element own: a call of Own raised TypeError: takes 1 positional argument ({__file__})"


def test_an_error_that_no_own_element_raised_stays_as_it_is() -> None:
    error = raised(lambda: Own().begin(0.001)(0.0))
    assert failed_in(FAILED, TypeError("ours"), WALL) == FAILED
    other = replace(FAILED, kind=TripKind.SPEED)
    assert failed_in(other, error, scene_of(Own())) == other

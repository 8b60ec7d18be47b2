"""Every trip becomes one exception with a sentence."""

import pytest

from haptic_fieldbus.cycle.safety import LINK_TRIPS, Trip, TripKind
from haptic_fieldbus.cycle.trips import CAUSES, CONSEQUENCES, TRIP_ERRORS, explained, trip_error
from haptic_fieldbus.errors import BusError, BusTimeoutError, DriveFaultError, PlanError, SafetyTripError
from haptic_fieldbus.signals import LinkFlag
from tests.builders import PROFILE, VELOCITY_ONLY, plan_of
from tests.cases import every


@every("kind", TripKind)
def test_every_kind_of_trip_has_an_exception_and_a_cause(kind: TripKind) -> None:
    plan = plan_of(profile=VELOCITY_ONLY if kind is TripKind.DRIFT else PROFILE)
    taken = ", 1.500 s after operation enabled. Torque was taken away"
    error = trip_error(Trip(kind, "handle", 2_500_000_000, 5.0, 2.0, "fault"), plan, 1_000_000_000)
    assert isinstance(error, TRIP_ERRORS[kind])
    assert str(error).startswith("axis handle: ")
    assert str(error).endswith(". No torque was given" if kind is TripKind.START_FORCE else taken)


@pytest.mark.parametrize("table", [CAUSES, TRIP_ERRORS])
def test_the_tables_are_complete(table: dict[TripKind, object]) -> None:
    assert set(table) == set(TripKind)


def test_only_our_own_limits_are_safety_trips() -> None:
    ours = {kind for kind, error in TRIP_ERRORS.items() if error is SafetyTripError}
    assert ours == {
        TripKind.FOREIGN_MASTER,
        TripKind.DUPLICATE_NODE,
        TripKind.PERIODS_MISSED,
        TripKind.SIGN,
        TripKind.NOT_FINITE,
        TripKind.ELEMENT_FAILED,
        TripKind.SPEED,
        TripKind.ACCELERATION,
        TripKind.POWER,
        TripKind.ENERGY,
        TripKind.POSITION,
        TripKind.DRIFT,
    }
    refusals = {kind for kind, error in TRIP_ERRORS.items() if error is PlanError}
    assert refusals == {TripKind.START_FORCE, TripKind.SIGN_HIDDEN}
    others = {error for kind, error in TRIP_ERRORS.items() if kind not in ours | refusals}
    assert all(issubclass(error, (BusError, DriveFaultError)) for error in others)


def test_limits_are_named_with_their_units_and_the_value_that_passed_them() -> None:
    trip = Trip(TripKind.POSITION, "handle", 0, 0.1234, 0.1)
    words = "axis handle: position 0.1234 m, the limit is 0.1 m, before operation enabled. Torque was taken away"
    assert str(trip_error(trip, plan_of(), None)) == words


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

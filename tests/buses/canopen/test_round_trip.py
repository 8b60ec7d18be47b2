"""The round trip to a simulated drive, against what the wire and the drive take; and its verdicts."""

from collections.abc import Iterator

import pytest

from haptic_fieldbus.buses.canopen.access import round_trip_checks, round_trips
from tests.buses.canopen.two_programs import TwoPrograms, assert_uploads_alone


@pytest.fixture
def two() -> Iterator[TwoPrograms]:
    made = TwoPrograms()
    yield made
    made.close()


def test_a_round_trip_is_no_shorter_than_two_frames_on_the_wire(two: TwoPrograms) -> None:
    begun_ns = two.wire.clock.now_ns()
    times = round_trips(two.wire, 99, 20)
    assert len(times) == 20
    assert sum(times) <= (two.wire.clock.now_ns() - begun_ns) * 1e-9
    # Eight octets at 1 Mbit/s: 111 bits without stuffing, 135 with the most, and as many back.
    assert all(2 * 108e-6 <= each <= 2 * 135e-6 + 5e-3 for each in times)
    assert_uploads_alone(two.sent())


def test_a_node_that_is_not_there_is_asked_once(two: TwoPrograms) -> None:
    assert round_trips(two.wire, 33) == []
    assert len(two.sent()) == 1
    trip, jitter = round_trip_checks(33, [], 200, 1000.0)
    assert (trip.ok, jitter.ok) == (False, None)
    assert "haptic-fieldbus scan" in trip.advice


@pytest.mark.parametrize(
    ("times", "rate", "expected"),
    [
        ([1e-3] * 100, 1000.0, (True, True)),
        ([1e-3] * 90 + [1.6e-3] * 10, 1000.0, (True, False)),
        ([1e-3] * 90 + [1.6e-3] * 10, 500.0, (True, True)),
        ([16e-3] * 100, 1000.0, (False, True)),
        ([1e-3] * 99, 1000.0, (False, True)),
    ],
    ids=["well", "jitter", "jitter at a lower rate", "16 ms of a serial port", "one lost"],
)
def test_what_is_too_slow_or_too_uneven_is_told(times: list[float], rate: float, expected: tuple[bool, bool]) -> None:
    checks = round_trip_checks(5, times, 100, rate)
    assert tuple(check.ok for check in checks) == expected
    assert all(bool(check.advice) is not check.ok for check in checks)


def test_the_advice_names_a_rate_that_would_do() -> None:
    times = [1e-3] * 90 + [2e-3] * 10
    _, jitter = round_trip_checks(5, times, 100, 1000.0)
    assert "--rate 500" in jitter.advice
    assert round_trip_checks(5, times, 100, 500.0)[1].ok

"""A wall on a drive under life guarding: it renders, and lets go within the stated time whatever happens."""

from pathlib import Path

import can
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.errors import BusTimeoutError, SafetyTripError
from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.sim import faults
from tests.system.zero_torque import MEASURED, RATES, Bench, measured, planned

GUARDED = str(Path(__file__).parent / "profiles" / "life_guarded.toml")
REQUEST = 0x701


def test_a_wall_renders_and_ends_without_a_fault() -> None:
    result = run("wall", drive=GUARDED, duration=2.0)
    assert result.trips == ()
    assert result.warnings == ()


@pytest.mark.thorough("30 rows of a table", quick=1)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("cause", MEASURED, ids=lambda cause: cause.name.lower())
def test_torque_is_zero_within_the_stated_time(cause: EndCause, rate: float) -> None:
    stated = {each.cause: each.seconds for each in planned(GUARDED, rate).deadlines}
    assert 0.0 < measured(GUARDED, rate, cause) < stated[cause]


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("cause", [EndCause.DISCONNECTED, EndCause.KILLED])
def test_the_life_time_alone_leaves_little_to_spare(cause: EndCause) -> None:
    at = next(each.seconds for each in planned(GUARDED, 1000.0).deadlines if each.cause is cause)
    assert 0.9 * at < measured(GUARDED, 1000.0, cause, (0.05,)) < at


def test_a_master_that_stops_asking_is_lost_to_the_drive_by_its_own_emergency() -> None:
    """8130h, and 6007h = 2 leaves *operation enabled* (CiA 301 7.2.7.1, CiA 402-2)."""
    with Bench(GUARDED, 1000.0) as bench:
        told: list[tuple[int, bytes]] = []
        bench.world.tap(lambda t_ns, can_id, data: told.append((t_ns, data)) if can_id == 0x081 else None)

        def die() -> None:
            bench.bus.dead = True

        bench.event = die
        bench.run(2.0)
        emergencies = [t_ns for t_ns, data in told if data[:2] == b"\x30\x81"]
    assert [round((t_ns - bench.event_ns) * 1e-6) for t_ns in emergencies] == [pytest.approx(45, abs=6)]


def test_a_drive_whose_answers_stay_away_is_a_trip_of_its_own() -> None:
    with Bench(GUARDED, 1000.0, 0.05, lambda at: (faults.HeartbeatLost("heartbeat_lost", at),)) as bench:
        bench.run()
        assert isinstance(bench.error, BusTimeoutError)
        assert "answered no request of node guarding within its life time" in str(bench.error)


def test_a_request_of_somebody_else_takes_the_torque_away() -> None:
    """It would feed the guard of the drive when we are dead."""
    with Bench(GUARDED, 1000.0) as bench:
        request = can.Message(arbitration_id=REQUEST, dlc=1, is_remote_frame=True, is_extended_id=False)
        bench.event = lambda: bench.other.send(request)
        assert bench.run() < 0.01
        assert isinstance(bench.error, SafetyTripError)
        assert "received node guarding request to node 1 (701h), which we did not send" in str(bench.error)

"""Somebody else who writes to a drive while force is rendered is noticed by what no longer acts, in a stated time.

On a serial line the requests of somebody else are heard, too: `tests/buses/modbus`.
"""

from pathlib import Path

import pytest

from haptic_fieldbus import api
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.defaults import DEFAULT_MODBUS_DRIVE
from haptic_fieldbus.errors import DriveFaultError, HapticFieldbusError, SafetyTripError, UsageError
from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.modbus.line import SIMULATION, SimulatedLine
from haptic_fieldbus.sim.modbus.registers import Refusal
from haptic_fieldbus.sim.modbus.unit import Unit
from tests.builders import endless_rig
from tests.buses.modbus.servers import Drive, tcp_server
from tests.invariants.attach import Findings, watched
from tests.sim.modbus.units import MODE, TARGET
from tests.whole_loop import run_loop

TCP, RTU = "sim-modbus-tcp", "sim-modbus-rtu@115200"
AFTER_NS = 1_000_000_000
"""[ns] from enabling, when the hand taps the wall."""


class Meddler:
    """Somebody who writes a register of unit 1, once or again and again."""

    def __init__(self, line: SimulatedLine, register: int, value: int, *, again: bool) -> None:
        self._unit, self._register, self._value, self._again = line.unit(1), register, value, again
        self._enabled_ns: int | None = None
        self.wrote_ns: int | None = None
        line.tap(self._frame)

    def _frame(self, t_ns: int, ours: bool, octets: bytes) -> None:
        if self._enabled_ns is None and self._unit.drive.power.state is State.OPERATION_ENABLED:
            self._enabled_ns = t_ns
        if self._enabled_ns is None or t_ns < self._enabled_ns + AFTER_NS or (self.wrote_ns and not self._again):
            return
        assert self._unit.write(self._register, self._value.to_bytes(2, "big"), t_ns) is None
        self.wrote_ns = self.wrote_ns or t_ns


@pytest.mark.thorough("a run for each", quick=1)
@pytest.mark.parametrize(
    ("bus", "register", "value", "again"),
    [
        *((bus, MODE, mode, False) for bus in (TCP, RTU) for mode in (1, 3, 8, 9)),
        (TCP, TARGET, 100, True),
    ],
)
def test_it_ends_the_run_in_the_stated_time(bus: str, register: int, value: int, again: bool) -> None:
    """Modes of position and of velocity, and set-points between ours."""
    plan = api.plan("wall", bus=bus, settings={"wall.stiffness": "max/2", "wall.position": 0.001})
    (axis,), clock, hand = plan.axes, VirtualClock(), hand_named("tap")
    assert hand is not None
    slot = DriveOnBus(axis.node, axis.profile, axis.rig, hand.after(axis.limits.fade_in))
    master, line = SIMULATION.simulate(plan.rig.bus[plan.buses[0].name], "", [slot], clock, 0, None)
    assert line is not None
    meddler = Meddler(line, register, value, again=again)
    try:
        master.open(plan)
        with pytest.raises((DriveFaultError, SafetyTripError), match=r"set-points do not act|another master on sim-"):
            run_loop(plan, Cycle(plan), master, clock, cycles=round(3.0 * plan.rate))
    finally:
        master.close()
    stated = next(each.seconds for each in plan.deadlines if each.cause is EndCause.NO_EFFECT)
    assert meddler.wrote_ns is not None
    assert clock.now_ns() - meddler.wrote_ns <= 1e9 * stated


BEFORE = 1.00312
"""[s] at which the other master begins: also at 1 kHz sooner after our set-point than the next question comes."""
WALL: dict[str, float | str | bool] = {"wall.stiffness": "max/3", "wall.position": 0.001}


def ran(bus: str, rate: float | None, *these: faults.Fault, drive: str | None = None) -> tuple[list[str], Findings]:
    """The trips of a run with these faults, and what the checker of runs has found: above all how long theirs acted."""
    with watched(keep=True) as found:
        try:
            rig = endless_rig("wall", drive or DEFAULT_MODBUS_DRIVE, bus)
            api.run("wall", rig, rate=rate, hand="tap", duration=5.0, settings=WALL, faults=these)
        except HapticFieldbusError as error:
            result = error.result
            assert isinstance(result, Result)
            return [trip.name for trip in result.trips], found
    return [], found


@pytest.mark.thorough("a run for each", quick=2)
@pytest.mark.parametrize(
    ("bus", "rate"), [(RTU, 100.0), (TCP, 50.0), (TCP, 1000.0), (RTU, 50.0), (TCP, None), (RTU, None)]
)
def test_80_percent_of_rated_every_50_ms_beside_our_loop_ends_the_run(bus: str, rate: float | None) -> None:
    """By function 23 (RTU at 100 Hz and its own rate), and by functions 3 and 16."""
    trips, found = ran(bus, rate, faults.ForeignSetPoints("foreign_set_points", BEFORE, 0.8, 0.05))
    assert trips in (["set-points of another master"], ["set-points do not act"])
    assert found.broken == []


@pytest.mark.thorough("a run for each", quick=1)
@pytest.mark.parametrize("interval", [0.0011, 0.0073, 0.02, 0.0503, 0.17, 0.9])
@pytest.mark.parametrize("share", [-0.6, 1.0])
@pytest.mark.parametrize(("bus", "rate"), [(RTU, 100.0), (TCP, 50.0), (TCP, 1000.0), (RTU, 50.0)])
def test_they_act_no_longer_than_stated_at_any_rate(bus: str, rate: float, share: float, interval: float) -> None:
    trips, found = ran(bus, rate, faults.ForeignSetPoints("foreign_set_points", BEFORE, share, interval))
    assert trips
    assert found.broken == []


@pytest.mark.thorough("a run for each", quick=1)
@pytest.mark.parametrize("drive", ["simplex_motion", "ezmotion_mms", "iris_orca"])
def test_a_drive_that_is_held_to_5_percent_gives_no_more_to_another_master(drive: str) -> None:
    """Its own torque limit is that of the run."""
    _, found = ran(
        "sim-modbus-rtu", None, faults.ForeignSetPoints("foreign_set_points", BEFORE, 0.8, 0.05), drive=drive
    )
    assert found.broken == []
    (witness,) = found.witnesses
    (shaft,) = witness.shafts.values()
    largest = max(abs(torque) for _, torque in shaft.targets)
    assert largest <= 51.0 * shaft.permille


@pytest.mark.thorough("a run for each", quick=1)
@pytest.mark.parametrize(("bus", "rate"), [(RTU, 100.0), (TCP, 50.0), (TCP, 1000.0), (RTU, None)])
@pytest.mark.parametrize("theirs", [False, True], ids=["alone", "another master"])
def test_a_gateway_whose_answers_are_a_period_old_neither_trips_nor_hides(
    bus: str, rate: float | None, theirs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A soft wall, for the position is a period old too."""
    read = Unit.read
    before: dict[tuple[int, int], bytes] = {}

    def old(self: Unit, function: int, address: int, count: int, t_ns: int) -> bytes | Refusal:
        octets = read(self, function, address, count, t_ns)
        if isinstance(octets, Refusal) or self.drive.power.state is not State.OPERATION_ENABLED:
            return octets
        answer, before[address, count] = before.get((address, count), octets), octets
        return answer

    monkeypatch.setattr(Unit, "read", old)
    monkeypatch.setitem(WALL, "wall.stiffness", "max/10")
    these = (faults.ForeignSetPoints("foreign_set_points", BEFORE, 0.8, 0.05),) if theirs else ()
    trips, found = ran(bus, rate, *these)
    assert bool(trips) is theirs
    assert found.broken == []


@pytest.mark.thorough("waits in real time")
def test_the_question_tells_what_is_not_seen(tmp_path: Path) -> None:
    """Before anything is written."""
    questions: list[str] = []

    def refuse(question: str) -> bool:
        questions.append(question)
        return False

    with tcp_server(Drive()) as server:
        host, _, port = server.name.removeprefix("modbus-tcp:").rpartition(":")
        rig = tmp_path / "rig.toml"
        rig.write_text(RIG.format(host=host, port=port), encoding="utf-8")
        with pytest.raises(UsageError, match="not enabled"):
            api.run("wall", rig=rig, rate=50.0, settings={"wall.stiffness": 60.0}, confirm=refuse)
        assert server.drive.written == []
    (question,) = questions
    assert f"Not detected: set-points of another master on {server.name}: those that act for less than" in question


RIG = """
[bus.line]
interface = "modbus-tcp"
channel = "{host}:{port}"

[axis.handle]
bus = "line"
node = 1
profile = "generic_cia402_modbus"
encoder_counts_per_revolution = 4096
rated_torque = 0.4
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
mechanism = {{ kind = "linear", metres_per_revolution = 0.05 }}
limits = {{ speed = 10.0 }}
"""

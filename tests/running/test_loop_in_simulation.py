"""Master, loop and simulated drive together: every fault of the simulation ends torque-free and with its exception."""

import struct
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus import api
from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.buses.canopen.frames import CandumpWriter, FrameWriter
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError, DriveFaultError, SafetyTripError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from tests.builders import PROFILE, can_traffic, plan_of, scene_of
from tests.whole_loop import run_loop

RPDO = 0x201
TORQUE_FREE = bytes(4)
PERIOD_NS = 1_000_000
CONTACT = 0.6
"""[s]; the pushing hand is in the wall by then."""


class Frames:
    """Frames on the wire, by the end of each frame."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, int, bytes]] = []

    def __call__(self, t_ns: int, can_id: int, data: bytes | bytearray) -> None:
        self.frames.append((t_ns, can_id, bytes(data)))

    def torques(self) -> list[tuple[int, int]]:
        """(t_ns, target torque) of every RPDO."""
        return [(t_ns, struct.unpack("<Hh", data)[1]) for t_ns, can_id, data in self.frames if can_id == RPDO]


def _run(
    these: Sequence[faults.Fault],
    wire: Frames | None = None,
    *,
    log: FrameWriter | None = None,
    cycles: int = 1000,
    report: LoopReport | None = None,
    plan: Plan | None = None,
) -> LoopReport:
    plan = plan or plan_of()
    clock = VirtualClock()
    world = World(clock, can_traffic(plan).bitrate)
    for axis in plan.axes:
        world.add(DriveOnBus(axis.node, axis.profile, axis.rig, hand_named("push"), faults=tuple(these)))
    if wire is not None:
        world.tap(wire)
    bus = CanopenBus(SimulatedBus(world=world), clock, log, owned=True)
    try:
        bus.open(plan)
        return run_loop(plan, Cycle(plan), bus, clock, cycles=cycles, report=report)
    finally:
        bus.close()


def test_a_healthy_drive_runs_to_the_end_without_a_missed_period() -> None:
    wire = Frames()
    report = _run((), wire)
    assert report.cycles == 1000
    assert report.missed == 0
    assert report.released
    assert min(torque for _, torque in wire.torques()) < 0
    assert report.sample("period_ns").max() == PERIOD_NS
    emergencies = [frame for frame in wire.frames if frame[1] == 0x081 and frame[2][:2] != b"\0\0"]
    assert emergencies == []


TRIPS: dict[str, tuple[faults.Fault, type[Exception], str]] = {
    "emergency": (faults.Emergency("emergency", CONTACT, 0x3210), DriveFaultError, "3210h.*over-voltage"),
    "drive fault": (faults.DriveFault("drive_fault", CONTACT), DriveFaultError, "2310h|fault"),
    "node reset": (faults.NodeReset("node_reset", CONTACT), DriveFaultError, "restarted"),
    "missing TPDOs": (faults.MissingTpdos("missing_tpdos", CONTACT, 40), BusTimeoutError, "feedback lost"),
    "cable off": (faults.Silence("silence", CONTACT), BusTimeoutError, "feedback lost"),
    "heartbeat lost": (faults.HeartbeatLost("heartbeat_lost", CONTACT), BusTimeoutError, "heartbeat"),
    "bus-off": (faults.BusOff("bus_off", CONTACT), BusError, "bus-off"),
    "encoder jump": (faults.EncoderJump("encoder_jump", CONTACT, 2000), SafetyTripError, "speed"),
}


@pytest.mark.thorough("a run for each of 8 faults", quick=2)
@pytest.mark.parametrize("name", TRIPS)
def test_a_fault_ends_torque_free_on_the_wire_before_its_exception(name: str) -> None:
    fault, error, words = TRIPS[name]
    wire, report = Frames(), LoopReport()
    with pytest.raises(error, match=words):
        _run((fault,), wire, report=report)
    torques = wire.torques()
    tripped = next(at for at in range(len(torques) - 1, -1, -1) if torques[at][1] != 0)
    assert torques[tripped][1] < 0, "the wall pushed back until then"
    assert report.enabled_at_ns is not None
    limit_ns = {"heartbeat lost": 320, "missing TPDOs": 15, "cable off": 15}.get(name, 5) * PERIOD_NS
    if name != "bus-off":
        assert len(torques) - tripped > 2
    assert torques[tripped][0] - report.enabled_at_ns < CONTACT * 1e9 + limit_ns
    assert [data for _, can_id, data in wire.frames if can_id == RPDO][-1] == TORQUE_FREE or name == "bus-off"


def test_a_contact_at_50_hz_in_which_the_fade_in_ends_does_not_trip() -> None:
    """The force is held on the way on which the account goes over from the law to what is sent.

    That way is 9.4 mm, so a wall of 600 N/m leaks ½·600·0.0094² = 26 mJ on it; the limit is 5.6 mJ.
    """
    assert _run((), plan=plan_of(rate=50.0), cycles=200).cycles == 200


def test_two_missing_tpdos_are_held_and_faded_through() -> None:
    report = _run((faults.MissingTpdos("missing_tpdos", CONTACT, 2),))
    assert report.cycles == 1000


def test_a_disturbed_frame_is_no_reason_to_stop() -> None:
    assert _run((faults.ErrorFrame("error_frame", CONTACT),)).cycles == 1000


@pytest.mark.thorough("a run for each of 16 rates and instants", quick=1)
@pytest.mark.parametrize("after", [0.0, 13.7e-3, 50.3e-3, 91.1e-3])
@pytest.mark.parametrize("rate", [333.0, 1000.0, 170.0, 50.0])
def test_a_lost_heartbeat_is_noticed_within_its_time_give_or_take_a_period(rate: float, after: float) -> None:
    """Counted from the end of the last heartbeat on the wire, which the master does not see before its next period."""
    wire, plan = Frames(), plan_of(rate=rate)
    with pytest.raises(BusTimeoutError, match="the heartbeat of node 1 was lost"):
        _run((faults.HeartbeatLost("heartbeat_lost", CONTACT + after),), wire, plan=plan, cycles=10_000)
    noticed_ns = next(
        t_ns
        for t_ns, can_id, data in wire.frames
        if can_id == RPDO and t_ns > _enabled_ns(wire) and data == TORQUE_FREE
    )
    last_ns = max(t_ns for t_ns, can_id, _ in wire.frames if can_id == 0x701 and t_ns < noticed_ns)
    traffic = can_traffic(plan)
    noticed_ns -= plan.compute_ns + round(traffic.sending_ns)
    assert abs(noticed_ns - last_ns - 300_000_000) <= plan.period_ns


def _enabled_ns(wire: Frames) -> int:
    return next(t_ns for t_ns, can_id, data in wire.frames if can_id == RPDO and data[:2] == b"\x0f\x00")


LASTING: dict[str, tuple[faults.Fault, type[Exception], str]] = {
    "missing node": (faults.MissingNode("missing_node"), BusTimeoutError, "node 1 .*does not answer"),
    "wrong vendor": (faults.WrongIdentity("wrong_identity", vendor_id=0x9A), BusConfigurationError, "0000009Ah"),
    "refused guard": (faults.SdoRefusal("sdo_abort", 0x1016, 1), BusConfigurationError, "1016h:01.*read only"),
    "refused reaction": (faults.SdoRefusal("sdo_abort", 0x6007), BusConfigurationError, "6007h:00 abort connection"),
    "refused mode": (faults.SdoRefusal("sdo_abort", 0x6060), BusConfigurationError, "6060h:00 modes of operation"),
    "refused mapping": (faults.SdoRefusal("sdo_abort", 0x1A00, 1), BusConfigurationError, "1A00h:01 TPDO mapping"),
}


@pytest.mark.parametrize("name", LASTING)
def test_a_drive_that_cannot_be_set_up_is_never_enabled(name: str) -> None:
    fault, error, words = LASTING[name]
    wire = Frames()
    with pytest.raises(error, match=words):
        _run((fault,), wire)
    assert {torque for _, torque in wire.torques()} <= {0}


@pytest.mark.thorough("renders the same twice")
def test_two_runs_write_the_same_log_octet_by_octet(tmp_path: Path) -> None:
    logs = []
    for name in ("first.log", "second.log"):
        with closing(CandumpWriter(tmp_path / name)) as writer:
            _run((), log=writer, cycles=700)
        logs.append((tmp_path / name).read_bytes())
    assert logs[0] == logs[1]
    assert logs[0].count(b"\n") > 2100


def test_a_drive_can_be_used_again_after_a_run_without_being_reset() -> None:
    plan, clock = plan_of(), VirtualClock()
    world = World(clock, can_traffic(plan).bitrate)
    world.add(DriveOnBus(1, plan.axes[0].profile, plan.axes[0].rig, hand_named("none")))
    for _ in range(2):
        bus = CanopenBus(SimulatedBus(world=world), clock, owned=True)
        bus.open(plan)
        assert run_loop(plan, Cycle(plan), bus, clock, cycles=100).released
        bus.close()
        clock.sleep_until(clock.now_ns() + 500 * PERIOD_NS)


def test_the_drive_releases_its_shaft_by_itself_when_the_master_falls_silent() -> None:
    plan, clock = plan_of(), VirtualClock()
    world = World(clock, can_traffic(plan).bitrate)
    world.add(DriveOnBus(1, plan.axes[0].profile, plan.axes[0].rig, hand_named("push")))
    can_bus = SimulatedBus(world=world)
    bus = CanopenBus(can_bus, clock)
    bus.open(plan)
    cycle = Cycle(plan)
    deadline_ns = clock.now_ns()
    enabled_periods = 0
    while enabled_periods < CONTACT * 1000:
        clock.sleep_until(deadline_ns)
        bus.write(cycle(bus.read(deadline_ns + PERIOD_NS // 2)))
        enabled_periods += cycle.enabled
        deadline_ns += PERIOD_NS
    silent_ns = clock.now_ns()
    while can_bus.recv(0.01) is not None or clock.now_ns() < silent_ns + 100 * PERIOD_NS:
        pass
    times = np.array([silent_ns, silent_ns + 61 * PERIOD_NS])
    _, _, torque = world.trajectory(1).sample(times)
    can_bus.shutdown()
    assert torque[0] < -0.01
    assert torque[1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.thorough("four runs", quick=("2-next_sync",))
@pytest.mark.parametrize("acts", ["reception", "next_sync"])
@pytest.mark.parametrize("axes", [1, 2])
def test_synchronous_and_event_driven_set_points_work_on_one_and_several_axes(acts: str, axes: int) -> None:
    walls = [Wall(f"axis{k}", stiffness=300.0, position=0.005, name=f"wall{k}") for k in range(axes)]
    pdo = replace(PROFILE.pdo, rpdo_types=(1,) if acts == "next_sync" else (255,), rpdo_acts=acts)  # type: ignore[arg-type]
    plan = plan_of(scene_of(*walls), profile=replace(PROFILE, pdo=pdo))
    report = _run((), plan=plan, cycles=500)
    assert (report.cycles, report.missed, report.released) == (500, 0, True)


@pytest.mark.parametrize(
    ("rate", "drive"), [(2.0, "generic_cia402"), (0.2, "generic_cia402"), (0.2, "generic_cia402_modbus")]
)
def test_a_loop_of_some_seconds_a_period_is_slow_and_nothing_else(rate: float, drive: str) -> None:
    """Heartbeats are heard as late as a period, and a drive needs some periods on its way to *operation enabled*."""
    settings = {"damper.damping": 0.01}
    bus = "sim-modbus-tcp" if drive.endswith("modbus") else "sim"
    result = api.run("damper", drive=drive, bus=bus, rate=rate, duration=6.0 / rate, hand="none", settings=settings)
    assert result.cycles == 6

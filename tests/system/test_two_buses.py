"""Two axes on two simulated buses, end to end: they run together, and together they become torque-free."""

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.buses.bus import BusGroup
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import BusError, DriveFaultError, HapticFieldbusError, UsageError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from tests.builders import PROFILE, can_traffic, plan_of, scene_of
from tests.several_buses import rig_on
from tests.whole_loop import run_loop

Array = NDArray[np.float64]
MS = 1_000_000
CONTACT = 1.5
"""[s] after operation enabled; the pushing hands are in their walls by then."""
SCENE = scene_of(
    Wall("left", stiffness=600.0, position=0.02, name="a"), Wall("right", stiffness=400.0, position=0.01, name="b")
)
FREEING = 10
"""Most set-points of one way to zero."""
BUSES = {"left": "can_left", "right": "can_right"}


def rig(bitrates: Sequence[int] = (1_000_000, 1_000_000), **changes: Any) -> Rig:
    """The bench of the scene, each axis on a bus of its own."""
    rates = dict(zip(BUSES.values(), bitrates, strict=True))
    return rig_on(SCENE, BUSES, rates, **{"profile": "maxon_epos4", **changes})


@dataclass
class TwoWorlds:
    """A simulated bus for each of the plan's buses, in one virtual time, and what was on their wires."""

    plan: Plan
    struck: dict[str, tuple[faults.Fault, ...]] = field(default_factory=dict)
    clock: VirtualClock = field(default_factory=VirtualClock)
    report: LoopReport = field(default_factory=LoopReport)

    def __post_init__(self) -> None:
        self.worlds = {bus.name: World(self.clock, can_traffic(self.plan.on(bus)).bitrate) for bus in self.plan.buses}
        self.frames: dict[str, list[tuple[int, int, bytes]]] = {name: [] for name in self.worlds}
        for bus in self.plan.buses:
            world = self.worlds[bus.name]
            world.tap(self._listener(bus.name))
            for axis in self.plan.on(bus).axes:
                these = self.struck.get(bus.name, ())
                world.add(DriveOnBus(axis.node, axis.profile, axis.rig, hand_named("push"), faults=these))

    def _listener(self, bus: str) -> Callable[[int, int, bytes], None]:
        return lambda t_ns, can_id, data: self.frames[bus].append((t_ns, can_id, data))

    def run(self, cycles: int = 2000) -> LoopReport:
        group = BusGroup(
            {
                name: CanopenBus(SimulatedBus(name, world=world), self.clock, owned=True)
                for name, world in self.worlds.items()
            }
        )
        try:
            group.open(self.plan)
            return run_loop(self.plan, Cycle(self.plan), group, self.clock, cycles=cycles, report=self.report)
        finally:
            group.close()

    def torques(self, bus: str, node: int = 1) -> list[int]:
        """Target torque of every RPDO [‰ of rated]."""
        return [struct.unpack("<Hh", data)[1] for _, can_id, data in self.frames[bus] if can_id == 0x200 + node]

    def motor_torque(self, bus: str, t_ns: int) -> float:
        """Torque that the motor truly gave at an instant [N·m]."""
        _, _, torque = self.worlds[bus].trajectory(1).sample(np.array([t_ns]))
        return float(torque[0])

    def syncs(self, bus: str) -> list[int]:
        return [t_ns for t_ns, can_id, _ in self.frames[bus] if can_id == 0x080]


def bench(
    bitrates: Sequence[int] = (1_000_000, 1_000_000), these: Mapping[str, faults.Fault] | None = None
) -> TwoWorlds:
    found = rig(bitrates, node=1, profile="test_drive")
    return TwoWorlds(plan_of(SCENE, rig=found), {BUSES[axis]: (fault,) for axis, fault in (these or {}).items()})


def test_two_axes_on_two_buses_run_to_the_end_without_a_missed_period() -> None:
    both = bench()
    report = both.run()
    assert (report.cycles, report.missed, report.released) == (2000, 0, True)
    for bus in both.worlds:
        assert min(both.torques(bus)) < -50, f"the wall on {bus} pushed back"
        emergencies = [frame for frame in both.frames[bus] if frame[1] == 0x081 and frame[2][:2] != b"\0\0"]
        assert emergencies == []


TRIPS: dict[str, tuple[faults.Fault, type[HapticFieldbusError], int]] = {
    "cable off": (faults.Silence("silence", CONTACT), BusError, 60),
    "drive fault": (faults.DriveFault("drive_fault", CONTACT), DriveFaultError, 5),
    "emergency": (faults.Emergency("emergency", CONTACT, 0x3210), DriveFaultError, 5),
    "node reset": (faults.NodeReset("node_reset", CONTACT), DriveFaultError, 5),
    "bus-off": (faults.BusOff("bus_off", CONTACT), BusError, 60),
    "heartbeat lost": (faults.HeartbeatLost("heartbeat_lost", CONTACT), BusError, 320),
}
"""Fault, its exception, and the periods until the torque of the drive that it struck is off: over a bus that is lost
nobody can tell it, its own guard of 50 ms must find out."""
OTHERS = {"cable off": 35, "heartbeat lost": 320}
"""Periods until the torque of the other drive is off, where they are more than five; feedback is too old at 30 ms."""


@pytest.mark.thorough("12 runs that end in a fault", quick=1)
@pytest.mark.parametrize("struck", ["left", "right"])
@pytest.mark.parametrize("name", TRIPS)
def test_losing_one_drive_or_one_bus_takes_the_torque_of_both(name: str, struck: str) -> None:
    fault, error, periods = TRIPS[name]
    both = bench(these={struck: fault})
    with pytest.raises(error, match=f"axis {struck}|can_{struck}"):
        both.run()
    assert both.report.enabled_at_ns is not None
    lost_ns = both.report.enabled_at_ns + round(CONTACT * 1e9)
    both.clock.sleep_until(lost_ns + 500 * MS)
    for axis, bus in BUSES.items():
        assert both.motor_torque(bus, lost_ns - MS) < -0.01, f"{axis} was in its wall"
        until = periods if axis == struck else OTHERS.get(name, 5)
        for later in (until, until + 50, 500):
            assert both.motor_torque(bus, lost_ns + later * MS) == pytest.approx(0.0, abs=1e-6), (axis, later)
        if (name, axis) != ("bus-off", struck):
            assert both.torques(bus)[-1] == 0


@pytest.mark.thorough("a run that ends in a fault")
def test_the_drive_on_the_healthy_bus_is_left_without_an_error() -> None:
    both = bench(these={"left": faults.Silence("silence", CONTACT)})
    with pytest.raises(BusError, match="axis left"):
        both.run()
    both.clock.sleep_until(both.clock.now_ns() + 500 * MS)
    both.worlds["can_right"].run()
    emergencies = [data for _, can_id, data in both.frames["can_right"] if can_id == 0x081]
    assert emergencies == []


@pytest.mark.thorough("a long run of two drives")
def test_sync_is_at_one_instant_on_buses_of_one_bit_rate_but_for_a_frame_that_must_end_first() -> None:
    """A heartbeat is at most 65 bits; nothing else is on the wire when a period begins."""
    both = bench()
    both.run()
    syncs = [np.array(both.syncs(bus)[:2000]) for bus in both.worlds]
    skew = np.abs(syncs[0] - syncs[1])
    assert np.median(skew) == 0
    assert skew.max() <= 65_000


def test_the_sync_of_a_slower_bus_ends_later_by_its_longer_bits() -> None:
    both = bench((1_000_000, 500_000))
    both.run(300)
    syncs = [np.array(both.syncs(bus)[:300]) for bus in both.worlds]
    assert np.median(syncs[1] - syncs[0]) == 48_000
    assert (syncs[1] - syncs[0]).max() <= 48_000 + 2 * 65_000
    assert (syncs[1] - syncs[0]).min() >= 48_000 - 65_000


@pytest.mark.thorough("long runs of two drives")
def test_where_the_delay_is_the_same_so_are_the_forces_of_every_period() -> None:
    """Set-points that act at the next SYNC are one period late on any bus; the encoders' zeros are drawn alike."""
    profile = replace(PROFILE, pdo=replace(PROFILE.pdo, rpdo_types=(1,), rpdo_acts="next_sync"))
    soft = scene_of(
        Wall("left", stiffness=200.0, position=0.02, name="a"), Wall("right", stiffness=150.0, position=0.01, name="b")
    )
    apart, together = (
        TwoWorlds(plan_of(soft, rig=rig_on(soft, buses), profile=profile))
        for buses in (BUSES, {"left": "can", "right": "can"})
    )
    apart.run()
    together.run()
    for node, bus in enumerate(BUSES.values(), start=1):
        two, one = np.array(apart.torques(bus, node)), np.array(together.torques("can", node))
        assert one.min() < -100, "the wall pushed back"
        # Two buses are freed one after the other, which takes a set-point or two more or less.
        rendered = min(len(two), len(one)) - FREEING
        assert rendered >= 1990
        assert np.abs(two[:rendered] - one[:rendered]).max() <= 1, "in steps of torque"


def forces_of(result: Result, times: Array) -> list[Array]:
    return [np.interp(times, trace.times, trace.force) for trace in result.traces]


@pytest.mark.thorough("long runs of two drives")
def test_the_same_drives_give_the_same_forces_on_two_buses_as_on_one() -> None:
    """Two buses are faster, so their delay is shorter by one PDO each way; the hands come to rest in the same place.

    Within Coulomb friction (0.2514 N) and one step of torque (0.051 N): where in that band a hand comes to rest, the
    last swing decides.
    """
    two = run(SCENE, rig(), duration=3.0)
    one = run(SCENE, rig_on(SCENE, {"left": "can", "right": "can"}, profile="maxon_epos4"), duration=3.0)
    times = np.linspace(0.6, 2.9, 2000)
    assert [trace.axis for trace in two.traces] == ["left", "right"]
    for apart, together in zip(forces_of(two, times), forces_of(one, times), strict=True):
        assert together.min() < -5.0
        assert np.abs(apart - together).max() < 0.2514 + 0.051


@pytest.mark.thorough("a long run of two drives")
def test_the_result_knows_the_error_of_both_axes_and_the_fullest_bus() -> None:
    result = run(SCENE, rig((1_000_000, 500_000)), duration=1.5)
    assert (result.cycles, result.missed_cycles, result.trips) == (1500, 0, ())
    assert result.bus == "haptic_sim:can_left@1000000, haptic_sim:can_right@500000"
    assert result.bus_load == pytest.approx(0.5843, abs=1e-4)
    assert all(trace.ideal is not None for trace in result.traces)
    assert result.torque_error is not None
    assert sum(result.torque_error.by_source.values()) == pytest.approx(1.0, abs=1e-9)


def test_node_ids_may_repeat_and_such_drives_are_no_twins(tmp_path: Path) -> None:
    run(SCENE, rig(node=5), duration=0.3, record=tmp_path / "frames.log")
    serial = re.compile(r"(can_\w+) 585#43181004([0-9A-F]{8})")
    serials = dict(serial.findall((tmp_path / "frames.log").read_text()))
    assert set(serials) == set(BUSES.values())
    assert len(set(serials.values())) == 2


def recorded(path: Path, **options: object) -> bytes:
    run(SCENE, rig(), duration=0.3, record=path, **options)  # type: ignore[arg-type]
    return path.read_bytes()


@pytest.mark.thorough("renders the same twice")
def test_the_same_seed_gives_the_same_frames_of_both_buses_byte_for_byte(tmp_path: Path) -> None:
    first = recorded(tmp_path / "first.log")
    assert first == recorded(tmp_path / "second.log")
    assert first != recorded(tmp_path / "other.log", seed=1)


@pytest.mark.thorough("a run of two drives")
def test_candump_text_names_the_bus_of_every_frame_in_the_order_of_time(tmp_path: Path) -> None:
    lines = [line.split() for line in recorded(tmp_path / "frames.log").decode().splitlines()]
    by_bus = {bus: [frame for _, channel, frame in lines if channel == bus] for bus in BUSES.values()}
    assert sum(map(len, by_bus.values())) == len(lines)
    for bus, node in zip(BUSES.values(), (1, 2), strict=True):
        cob_ids = {frame.partition("#")[0] for frame in by_bus[bus]}
        assert {"080", f"18{node}", f"20{node}", "77F", f"70{node}"} <= cob_ids
        assert not cob_ids & {f"18{3 - node}", f"20{3 - node}"}
    stamps = [float(stamp.strip("()")) for stamp, _, _ in lines]
    assert stamps == sorted(stamps)


@pytest.mark.thorough("a run of two drives that others record as text")
def test_blf_numbers_the_buses(tmp_path: Path) -> None:
    recorded(tmp_path / "frames.blf")
    recorded(tmp_path / "frames.log")
    with can.LogReader(tmp_path / "frames.blf") as reader:
        frames = [(message.channel, message.arbitration_id, bytes(message.data)) for message in reader]
    text = re.findall(r" (can_\w+) ([0-9A-F]+)#([0-9A-F]*)", (tmp_path / "frames.log").read_text())
    number = {bus: position for position, bus in enumerate(BUSES.values())}
    assert frames == [(number[bus], int(can_id, 16), bytes.fromhex(data)) for bus, can_id, data in text]


FAULT_ON_ONE = '[[fault]]\nkind = "silence"\nat = 0.2\nnode = 1\nbus = "can_right"\n'


@pytest.mark.thorough("a run that ends in a fault, twice")
def test_a_file_of_faults_names_the_bus_where_node_ids_repeat(tmp_path: Path) -> None:
    file = tmp_path / "faults.toml"
    file.write_text(FAULT_ON_ONE, encoding="utf-8")
    with pytest.raises(BusError, match="axis right: feedback lost"):
        run(SCENE, rig(node=1), duration=1.0, faults=file)
    everywhere = faults.Silence("silence", 0.2, node=1)
    with pytest.raises(BusError, match="axis left: feedback lost"):
        run(SCENE, rig(node=1), duration=1.0, faults=[everywhere])


def test_a_fault_on_a_bus_that_is_not_there_is_refused() -> None:
    with pytest.raises(UsageError, match='"silence" names the bus "can_up"; this run has: can_left, can_right'):
        run(SCENE, rig(), faults=[faults.Silence("silence", 0.2, bus="can_up")])

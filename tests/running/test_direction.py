"""The direction that a person shows: a handle that moves while the drives are off, over the simulated bus."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.rig import Seen
from haptic_fieldbus.errors import BusTimeoutError, DriveFaultError, RigError, UsageError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.loop import UNCONFIRMED
from haptic_fieldbus.running.proofs import confirm_direction
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from tests.builders import PROFILE, VELOCITY_ONLY, WALL, can_traffic, plan_of, rig_of
from tests.buses.canopen.benches import Bench

RIG = """# my bench
[bus.can]
interface = "haptic_sim"
channel = "sim"

[axis.handle]
bus = "can"
node = 1
profile = "generic_cia402"
encoder_counts_per_revolution = 4096
rated_torque = 0.4   # N·m

[axis.handle.mechanism]
kind = "linear"
metres_per_revolution = 0.05
"""


def planned(source: str = "", *, rate: float = 1000.0, velocity_only: bool = False) -> Plan:
    rig = replace(rig_of(WALL, seen=Seen()), source=source)
    return plan_of(rate=rate, rig=rig, profile=VELOCITY_ONLY if velocity_only else PROFILE)


def shown(
    plan: Plan, speed: float, ending: EndSignals | None = None, worlds: list[World] | None = None
) -> tuple[list[str], list[str]]:
    """Let the handle roll at `speed` [m/s] while the drives are off; (what is to be told, what the person read)."""
    clock = VirtualClock()
    world = World(clock, can_traffic(plan).bitrate)
    (axis,) = plan.axes
    rolling = replace(axis.rig, coulomb_friction=0.0, viscous_damping=0.0)
    if worlds is not None:
        worlds.append(world)
    drive = world.add(DriveOnBus(1, axis.profile, rolling, velocity=speed / axis.rig.mechanism.ratio)).drive
    bus, read = CanopenBus(SimulatedBus(world=world), clock, owned=True), list[str]()
    try:
        bus.inspect(plan, bytearray(plan.image.input_size))
        told = confirm_direction(plan, bus, clock, read.append, ending or EndSignals())
    finally:
        bus.close()
    assert not list(filter(None, world.trajectory(1).targets()[1])), "no torque"
    assert drive.power.state.name != "OPERATION_ENABLED"
    return told, read


@pytest.mark.parametrize("velocity_only", [False, True])
def test_a_handle_that_goes_up_confirms_the_direction_and_the_rig_keeps_it(tmp_path: Path, velocity_only: bool) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    told, read = shown(planned(str(path), velocity_only=velocity_only), 0.05)
    assert told == []
    assert read[0].startswith("axis handle is off: move the handle 10 mm to the positive side; it is at ")
    kept = load_rig(path)
    assert kept.axis["handle"].seen.direction == "confirmed"
    assert path.read_text(encoding="utf-8").startswith(RIG), "every octet stays"


def test_the_rig_is_written_when_no_guard_waits_for_us_any_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk may take seconds."""
    path, guards = tmp_path / "rig.toml", list[object]()
    path.write_text(RIG, encoding="utf-8")

    def written(*_: object) -> None:
        (world,) = worlds
        guards.append(world.slave(1).drive.dictionary.find(0x1016, 1).value)

    worlds: list[World] = []
    monkeypatch.setattr("haptic_fieldbus.documents.edits.edit_file", written)
    shown(planned(str(path)), 0.05, worlds=worlds)
    assert guards == [0]


def test_a_handle_that_goes_down_is_refused_with_the_key_to_change(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    with pytest.raises(RigError, match=r"axis\.handle\.mechanism\.sign.*write sign = -1"):
        shown(planned(str(path)), -0.05)
    assert path.read_text(encoding="utf-8") == RIG


def test_a_handle_that_nobody_moves_is_not_enabled(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    with pytest.raises(UsageError, match="the handle of axis handle did not move within 60 s"):
        shown(planned(str(path), rate=50.0), 0.0)


def test_a_drive_that_enables_itself_meanwhile_ends_the_waiting(tmp_path: Path) -> None:
    """The person at the handle was told that it is off, and its motion may be that of the motor."""
    bench, read = Bench(planned(str(tmp_path / "rig.toml"))), list[str]()
    bench.bus.inspect(bench.plan, bytearray(bench.plan.image.input_size))

    def instruct(text: str) -> None:
        read.append(text)
        bench.drive.power_stays = 0x27

    with pytest.raises(DriveFaultError, match="node 1 changed to operation enabled by itself") as ended:
        confirm_direction(bench.plan, bench.bus, bench.clock, instruct, EndSignals())
    assert len(read) == 2
    assert read[-1] == "\n", "the error begins a line"
    assert ended.value.__notes__ == [UNCONFIRMED]


def test_a_drive_whose_feedback_stays_away_ends_the_waiting_though_its_heartbeat_comes(tmp_path: Path) -> None:
    bench, read = Bench(planned(str(tmp_path / "rig.toml"))), list[str]()
    bench.bus.inspect(bench.plan, bytearray(bench.plan.image.input_size))

    def instruct(text: str) -> None:
        read.append(text)
        bench.drive.mute_tpdos = True

    begin_ns = bench.clock.now_ns()
    with pytest.raises(BusTimeoutError, match="no position came for 1 s while the handle was to be moved"):
        confirm_direction(bench.plan, bench.bus, bench.clock, instruct, EndSignals())
    assert bench.clock.now_ns() - begin_ns < 4_000_000_000
    assert read[-1] == "\n"


def test_a_signal_ends_the_waiting(tmp_path: Path) -> None:
    ending = EndSignals()
    ending.hold()
    ending.receive(15)
    with pytest.raises(KeyboardInterrupt):
        shown(planned(str(tmp_path / "rig.toml")), 0.0, ending)


def test_a_direction_that_was_confirmed_is_not_asked_for_again(tmp_path: Path) -> None:
    plan = planned(str(tmp_path / "rig.toml"))
    (axis,) = plan.axes
    known = replace(axis, rig=replace(axis.rig, seen=Seen(direction="confirmed")))
    assert shown(replace(plan, axes=(known,)), math.pi) == ([], [])


def test_a_rig_file_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    told, _ = shown(planned(str(tmp_path / "gone.toml")), 0.05)
    (warning,) = told
    assert "was not saved in" in warning


def test_without_a_person_the_direction_is_told_to_be_unconfirmed() -> None:
    plan, clock = planned("rig.toml"), VirtualClock()
    bus = CanopenBus(SimulatedBus(world=World(clock, can_traffic(plan).bitrate)), clock, owned=True)
    (warning,) = confirm_direction(plan, bus, clock, None, EndSignals())
    bus.close()
    assert warning.startswith("axis handle: positive direction not confirmed by a person")

"""Drives whose PDOs cannot be mapped, only switched on: force is rendered over the PDOs that they have."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.buses.canopen.access import fit_to_drive
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import BusConfigurationError, ImageTooLargeError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.protocols.canopen.from_eds import draft_of
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive.dictionary import AbortCode
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import HANDS
from tests.builders import WALL, can_traffic, canopen, rig_of
from tests.eds.fixed_mapping import CONTROLWORD, MODE, RPDOS, TARGET_TORQUE, Mappings, fixed_profile, written
from tests.sim.bench import DriveBench, Refusal
from tests.whole_loop import run_loop

GENERIC = "generic_cia402"
Frames = list[tuple[int, bytes]]


def force_on(profile: CanopenProfile, drive: CanopenProfile, seconds: float) -> tuple[Frames, float]:
    """All frames of the wall on a drive of this kind, and the largest force that its motor was told [N]."""
    rig = rig_of(WALL, profile=profile.name, raise_max_torque=True, emergency_stop="power")
    plan = compile_plan(WALL, rig, {profile.name: profile}, 1000.0)
    clock, frames = VirtualClock(), Frames()
    world = World(clock, can_traffic(plan).bitrate)
    (axis,) = plan.axes
    world.add(DriveOnBus(axis.node, drive, axis.rig, HANDS["push"]))
    bus = CanopenBus(
        SimulatedBus(world=world), clock, lambda t_ns, can_id, data: frames.append((can_id, bytes(data))), owned=True
    )
    try:
        bus.open(plan)
        run_loop(plan, Cycle(plan), bus, clock, cycles=round(seconds * plan.rate))
    finally:
        bus.close()
    return frames, float(np.abs(world.trajectory(axis.node).targets()[1]).max() / axis.rig.mechanism.ratio)


@pytest.mark.parametrize("suffix", [".eds", ".toml"])
def test_a_sufficient_fixed_mapping_renders_the_wall(suffix: str, tmp_path: Path) -> None:
    """The hand pushes with 6 N, which a wall of 600 N/m takes at rest at 10 mm; it comes with a swing."""
    path = written(tmp_path)
    if suffix == ".toml":
        path = tmp_path / "drafted.toml"
        path.write_text(draft_of(fixed_profile(), "own.eds").text, encoding="utf-8")
    result = run("wall", drive=str(path), duration=1.5)
    assert result.trips == ()
    assert result.torque_error is not None
    assert result.torque_error.rms < 0.2
    (travel,) = result.travel
    assert 0.010 < travel.depth["wall"] < 0.020


def test_nothing_of_a_fixed_mapping_is_written() -> None:
    frames, force = force_on(fixed_profile(), fixed_profile(), 1.0)
    downloads = {
        int.from_bytes(data[1:3], "little") for can_id, data in frames if can_id == 0x601 and data[0] >> 5 == 1
    }
    assert {0x1404, 0x1802, 0x1804} <= downloads
    assert not [index for index in downloads if 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00]
    assert 5.0 < force < 15.0


@pytest.mark.parametrize("drive", ["file", "draft"])
def test_the_simulated_drive_refuses_to_write_its_fixed_mapping(drive: str, tmp_path: Path) -> None:
    path = tmp_path / "drafted.toml"
    path.write_text(draft_of(fixed_profile(), "own.eds").text, encoding="utf-8")
    bench = DriveBench(fixed_profile() if drive == "file" else canopen(path))
    assert bench.write(0x1404, 1, 0x8000_0201, "I") is None
    for index, subindex, code in ((0x1604, 0, "B"), (0x1604, 1, "I"), (0x1A02, 0, "B")):
        assert bench.write(index, subindex, 0, code) == Refusal(AbortCode.READ_ONLY.value)


def test_objects_that_nobody_asked_for_keep_what_they_hold() -> None:
    """RPDO5 has the mode of operation between controlword and torque: it is sent as it was read, at the end too."""
    rpdos: Mappings = {**RPDOS, 5: (CONTROLWORD, MODE, TARGET_TORQUE)}
    frames, force = force_on(fixed_profile(rpdos), fixed_profile(rpdos), 1.0)
    set_points = [data for can_id, data in frames if can_id == 0x201]
    assert {(len(data), data[2]) for data in set_points} == {(5, 10)}
    assert set_points[-1] == bytes((0, 0, 10, 0, 0))
    assert 5.0 < force < 15.0


def test_the_generic_profile_uses_the_fixed_mapping_of_the_drive_that_it_meets() -> None:
    clock = VirtualClock()
    world = World(clock, 1_000_000)
    world.add(DriveOnBus(1, fixed_profile(), rig_of(WALL).axis["handle"], None))
    with SimulatedBus(world=world) as bus:
        profile = fit_to_drive(canopen(GENERIC), Node(Wire(bus, clock, "sim"), 1, "node 1"))
    assert profile.pdo.rpdo_fixed == fixed_profile().pdo.rpdo_fixed
    frames, force = force_on(profile, fixed_profile(), 1.0)
    assert {0x201, 0x181, 0x381} <= {can_id for can_id, _ in frames}
    assert 5.0 < force < 15.0


def test_an_object_that_no_fixed_mapping_carries_is_named() -> None:
    profile = fixed_profile()
    kept = tuple(each for each in profile.pdo.tpdo_fixed if each.number == 3)
    with pytest.raises(ImageTooLargeError, match="carries 6077h:00 torque actual value, and the mapping is fixed"):
        force_on(replace(profile, pdo=replace(profile.pdo, tpdo_fixed=kept)), profile, 0.0)


def test_a_drive_that_maps_otherwise_than_its_profile_says_is_not_enabled() -> None:
    other = fixed_profile({**RPDOS, 5: (TARGET_TORQUE, CONTROLWORD)})
    with pytest.raises(BusConfigurationError) as refused:
        force_on(fixed_profile(), other, 0.1)
    assert "1604h maps 60710010h, 60400010h into RPDO5, but the profile says 60400010h, 60710010h" in str(refused.value)

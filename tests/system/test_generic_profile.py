"""The generic profile on the simulated drive of every file: as it stands, mended by `check`, and made anew.

No drive has all of the standard and nothing else. A run therefore asks the drive what it has. And what `profiles check
generic_cia402 --eds FILE` says is all that a person needs to turn the generic profile into one of this drive.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.buses.canopen.access import fit_to_drive
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.errors import HapticFieldbusError, PlanError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
from haptic_fieldbus.protocols.canopen.profile import NO_SUCH, CanopenProfile
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.eds_proof import proof_of
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import HANDS
from tests.builders import WALL, can_traffic, canopen, endless_rig, rig_of
from tests.cli.test_beside_guide import TOO_SLOW
from tests.eds.peculiar import DRIVES, FORCE
from tests.eds.vendor_files import both, eds_of, path_of
from tests.peers.hosts import GROUP, STARTS_WITHIN, free_port, line_of, require_multicast, start
from tests.protocols.canopen.test_from_eds import NO_DRIVE, UNUSABLE, USABLE, of_vendors
from tests.whole_loop import run_loop

GENERIC = "generic_cia402"
WITHOUT_GUARD = ["no_option_codes.eds", "ingenia_everest_xcr.eds"]
"""Files of drives that have neither 6007h nor 605Eh, so nothing says that they let go of the shaft."""
TOGETHER = {"torque.demand": ("torque.echo",), "torque.mode_of_operation": ("torque.slope", "torque.echo")}
"""Keys that a person changes with another one: what comes back, and the slope of profile torque mode."""
ROUNDS = 3
SECONDS = 1.5
EVERY = both(FORCE, of_vendors(USABLE))
"""Files whose drive takes torque."""


def mended(profile: CanopenProfile, eds: Eds) -> CanopenProfile:
    """The profile with each key in which `check` finds a fault as the file has it; another mode asks for other keys."""
    made = profile_from_eds(eds)
    for _ in range(ROUNDS):
        keys = {fault.key for fault in proof_of(profile, eds).faults}
        for key in (each for fault in sorted(keys) for each in (fault, *TOGETHER.get(fault, ()))):
            section, name = key.split(".")[:2]
            table: Any = getattr(profile, section)
            change: Any = {section: replace(table, **{name: getattr(getattr(made, section), name)})}
            why = {key: made.sources[key]} if key in made.sources else {}
            profile = replace(profile, sources={**profile.sources, **why}, **change)
    return profile


def force_on(profile: CanopenProfile, eds: Eds, seconds: float) -> tuple[Plan, np.ndarray[Any, Any]]:
    """The plan of the wall with a profile, and the force that the motor of the file's drive got [N]."""
    rig = rig_of(WALL, profile=GENERIC, raise_max_torque=True, emergency_stop="power")
    plan = compile_plan(WALL, rig, {GENERIC: profile}, 1000.0)
    clock = VirtualClock()
    world = World(clock, can_traffic(plan).bitrate)
    (axis,) = plan.axes
    world.add(DriveOnBus(axis.node, profile_from_eds(eds), axis.rig, HANDS["push"]))
    bus = CanopenBus(SimulatedBus(world=world), clock, owned=True)
    try:
        bus.open(plan)
        run_loop(plan, Cycle(plan), bus, clock, cycles=round(seconds * plan.rate))
    finally:
        bus.close()
    return plan, world.trajectory(axis.node).targets()[1] / axis.rig.mechanism.ratio


def asked(eds: Eds) -> CanopenProfile:
    """The generic profile as it stands, after the drive of a file was asked what it has; nothing was written."""
    rig, clock = rig_of(WALL, profile=GENERIC), VirtualClock()
    world = World(clock, 1_000_000)
    world.add(DriveOnBus(1, profile_from_eds(eds), rig.axis["handle"], None))
    frames: list[tuple[int, bytes]] = []
    with SimulatedBus(world=world) as bus:
        wire = Wire(bus, clock, "sim", lambda t_ns, can_id, data: frames.append((can_id, bytes(data))))
        profile = fit_to_drive(canopen(GENERIC), Node(wire, 1, "node 1"))
    # All that it sent are SDO uploads (CiA 301 7.2.4.3).
    sent = [(can_id, data[0] >> 5) for can_id, data in frames if can_id != 0x581]
    assert set(sent) == {(0x601, 2)}
    return profile


@pytest.mark.thorough("a run on every drive", quick=("capitals.eds",))
@pytest.mark.parametrize("file", EVERY)
def test_the_generic_profile_as_it_stands_runs_the_wall(file: str) -> None:
    eds = eds_of(file)
    profile = asked(eds)
    plan, force = force_on(profile, eds, SECONDS)
    limits = plan.axes[0].limits
    assert (limits.effort < 6.0) is (file in WITHOUT_GUARD), "without a guard it is capped, else it is not"
    assert 0.9 * min(6.0, limits.effort) < np.abs(force).max() < 2.5 * min(6.0, limits.effort)
    # What is missing is told, with the object; what the drive has is used.
    lacking = {source for source in profile.sources.values() if source.startswith(NO_SUCH)}
    assert lacking == {
        f"{NO_SUCH}{ObjectEntry(index, DataType.UINT8, subindex)}"
        for index, subindex in ((0x6074, 0), (0x6076, 0), (0x6077, 0), (0x1016, 1), (0x6007, 0), (0x605E, 0))
        if eds.find(index, subindex) is None
    }


@pytest.mark.parametrize("file", both(WITHOUT_GUARD[:1], WITHOUT_GUARD[1:]))
def test_a_drive_without_a_guard_is_refused_unless_its_power_can_be_cut(file: str) -> None:
    profile = asked(eds_of(file))
    with pytest.raises(PlanError, match=r"has no watchdog that.*emergency_stop"):
        compile_plan(WALL, rig_of(WALL, profile=GENERIC), {GENERIC: profile}, 1000.0)
    rig = rig_of(WALL, profile=GENERIC, emergency_stop="power")
    plan = compile_plan(WALL, rig, {GENERIC: profile}, 1000.0)
    assert "limited to 5 % of rated" in next(left.why for left in plan.left_out if left.what == "guard")


@pytest.mark.thorough("a run on every drive", quick=("profile_torque.eds",))
@pytest.mark.parametrize("file", EVERY)
def test_mended_by_what_check_says_it_runs_the_wall(file: str) -> None:
    eds = eds_of(file)
    profile = mended(canopen(GENERIC), eds)
    assert [str(fault) for fault in proof_of(profile, eds).faults] == []
    plan, force = force_on(profile, eds, SECONDS)
    # A watch whose end is assumed to take torque away is not proved here, and permits a twentieth of rated torque.
    expected = 6.0 if plan.axes[0].limits.effort > 6.0 else plan.axes[0].limits.effort
    assert 0.9 * expected < np.abs(force).max() < 2.5 * expected


@pytest.mark.thorough("a run on every drive", quick=("cyclic_torque.dcf",))
@pytest.mark.parametrize("file", EVERY)
def test_the_profile_that_is_made_from_a_file_runs_the_wall_too(file: str) -> None:
    rig = endless_rig("wall", str(path_of(file)))
    # A drive without a watch that is known to let go is refused, unless a person can cut the power of its motor.
    axes = {name: replace(axis, emergency_stop="power") for name, axis in rig.axis.items()}
    settings: dict[str, float | str | bool] = {"wall.stiffness": "max/2", "wall.position": 0.01}
    result = run("wall", replace(rig, axis=axes), settings=settings, duration=SECONDS)
    assert result.trips == ()
    assert np.abs(result.traces[0].force).max() > 2.0


@pytest.mark.parametrize(
    "file",
    both([name for name in DRIVES if name not in FORCE], sorted(of_vendors(UNUSABLE.keys() - NO_DRIVE))),
)
def test_a_drive_without_torque_is_refused_before_torque(file: str) -> None:
    with pytest.raises(HapticFieldbusError):
        force_on(canopen(GENERIC), eds_of(file), SECONDS)
    with pytest.raises(PlanError, match=r"not usable for force: "):
        compile_plan(WALL, rig_of(WALL, profile=GENERIC), {GENERIC: asked(eds_of(file))}, 1000.0)


@pytest.mark.xdist_group("peers")
@pytest.mark.thorough("real time beside a drive in another process")
@pytest.mark.parametrize(
    "file", both(["profile_torque.eds", WITHOUT_GUARD[0]], ["zeroerr_erob_v1_5.eds", WITHOUT_GUARD[1]])
)
def test_beside_the_drive_of_a_file_a_run_says_what_the_drive_lacks(file: str, tmp_path: Path) -> None:
    port, rig = free_port(), tmp_path / "rig.toml"
    require_multicast(port)
    bus = f"udp_multicast:{GROUP}@1000000"
    words = ("--drive", f"{path_of(file)}@5", "--hand", "tap", "--bus", bus, "--write-rig", str(rig))
    hosting = start("simulate", *words, port=port)
    try:
        line_of(hosting)
        text = re.sub('profile = ".*"', f'profile = "{GENERIC}"\nemergency_stop = "power"', rig.read_text())
        rig.write_text(text)
        run = start("run", "wall", "--rig", str(rig), "--yes", "--rate", "200", "--duration", "1",
                    "--set", "wall.stiffness=100", port=port)  # fmt: skip
        _, err = run.communicate(timeout=2 * STARTS_WITHIN)
    finally:
        hosting.kill()
        hosting.communicate()
    assert run.returncode == 0 or TOO_SLOW.search(err), err
    assert "is a generic profile, and this drive lacks" in err
    assert "6007h:00 abort connection option code" in err
    assert ("at most 5 % of rated torque" in err) is (file in WITHOUT_GUARD)

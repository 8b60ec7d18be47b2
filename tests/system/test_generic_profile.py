"""The generic profile on the simulated drive of every vendor's file: refused with the reason, then mended by `check`.

No drive has all of the standard and nothing else. What `profiles check generic_cia402 --eds FILE` says is all that a
person needs to turn the generic profile into one with which the wall of the library is felt.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.errors import BusConfigurationError, HapticFieldbusError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.running.loop import run_loop
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.proof import proof_of
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.hand import HANDS
from tests.builders import WALL, can_traffic, canopen, endless_rig, rig_of
from tests.eds.vendor_files import FILES, FOLDER, needs_files, vendor_eds

GENERIC = "generic_cia402"
WITHOUT_CHANGE = {"elmo_gold_drive.dcf"}
"""Files of drives that have all that the generic profile names."""
TOGETHER = {"torque.demand": ("torque.echo",), "torque.mode_of_operation": ("torque.slope", "torque.echo")}
"""Keys that a person changes with another one: what comes back, and the slope of profile torque mode."""
ROUNDS = 3
SECONDS = 1.5


USABLE = [name for name in FILES if name != "roboteq_v60.eds" and profile_from_eds(vendor_eds(name)).drive.usable]
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
    world.add_drive(axis.node, profile_from_eds(eds), axis.rig, HANDS["push"])
    bus = CanopenBus(SimulatedBus(world=world), clock, owned=True)
    try:
        bus.open(plan)
        run_loop(plan, Cycle(plan), bus, clock, cycles=round(seconds * plan.rate))
    finally:
        bus.close()
    return plan, world.trajectory(axis.node).targets()[1] / axis.rig.mechanism.ratio


@needs_files
def test_there_are_files_of_fourteen_drives_that_take_torque() -> None:
    assert len(USABLE) == 14
    assert set(USABLE) >= WITHOUT_CHANGE


@needs_files
@pytest.mark.thorough("a run on every drive", quick=1)
@pytest.mark.parametrize("file", USABLE)
def test_the_generic_profile_as_it_is_runs_or_is_refused_before_torque_with_an_object(file: str) -> None:
    eds = vendor_eds(file)
    if file in WITHOUT_CHANGE:
        _, force = force_on(canopen(GENERIC), eds, SECONDS)
        assert np.abs(force).max() > 1.0
        return
    with pytest.raises(BusConfigurationError, match=r"(reading|writing) .*[0-9A-F]{4}h:[0-9A-F]{2}"):
        force_on(canopen(GENERIC), eds, SECONDS)


@needs_files
@pytest.mark.thorough("a run on every drive", quick=1)
@pytest.mark.parametrize("file", USABLE)
def test_mended_by_what_check_says_it_runs_the_wall(file: str) -> None:
    eds = vendor_eds(file)
    profile = mended(canopen(GENERIC), eds)
    assert [str(fault) for fault in proof_of(profile, eds).faults] == []
    plan, force = force_on(profile, eds, SECONDS)
    # A watch whose end is assumed to take torque away is not proved here, and permits a twentieth of rated torque.
    expected = 6.0 if plan.axes[0].limits.effort > 6.0 else plan.axes[0].limits.effort
    assert 0.9 * expected < np.abs(force).max() < 2.5 * expected


@needs_files
@pytest.mark.thorough("a run on every drive", quick=1)
@pytest.mark.parametrize("file", USABLE)
def test_the_profile_that_is_made_from_a_file_runs_the_wall_too(file: str) -> None:
    rig = endless_rig("wall", str(FOLDER / file))
    # A drive without a watch that is known to let go is refused, unless a person can cut the power of its motor.
    axes = {name: replace(axis, emergency_stop="power") for name, axis in rig.axis.items()}
    settings: dict[str, float | str | bool] = {"wall.stiffness": "max/2", "wall.position": 0.01}
    result = run("wall", replace(rig, axis=axes), settings=settings, duration=SECONDS)
    assert result.trips == ()
    assert np.abs(result.traces[0].force).max() > 2.0


@needs_files
@pytest.mark.thorough("a plan for every other file", quick=2)
@pytest.mark.parametrize("file", [name for name in FILES if name not in (*USABLE, "roboteq_v60.eds")])
def test_a_drive_without_torque_is_refused_before_torque(file: str) -> None:
    with pytest.raises(HapticFieldbusError):
        force_on(canopen(GENERIC), vendor_eds(file), SECONDS)

"""A drive that is asked for its objects, and answers as drives do."""

from dataclasses import replace

import pytest

from haptic_fieldbus.buses.canopen.access import fit_to_drive
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, SimulatedObject
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from tests.builders import PROFILE, WALL, canopen, plan_of, rig_of

GENERIC = canopen("generic_cia402")


def asked(drive: CanopenProfile) -> CanopenProfile:
    clock = VirtualClock()
    world = World(clock, 1_000_000)
    world.add(DriveOnBus(1, drive, rig_of(WALL).axis["handle"], None))
    with SimulatedBus(world=world) as bus:
        return fit_to_drive(GENERIC, Node(Wire(bus, clock, "sim"), 1, "node 1 (axis handle)"))


def with_objects(**objects: SimulatedObject) -> CanopenProfile:
    named = {name.removeprefix("x"): each for name, each in objects.items()}
    return replace(GENERIC, simulation=replace(GENERIC.simulation, objects=named))


def test_an_object_that_can_only_be_written_is_there() -> None:
    profile = asked(with_objects(x6071=SimulatedObject(access="wo"), x6074=SimulatedObject(absent=True)))
    assert (profile.drive.usable, profile.torque.demand, profile.torque.echo) == (True, None, "actual")


def test_a_node_without_a_statusword_is_refused_by_its_name() -> None:
    nothing = SimulatedObject(value=0)
    mappings = {f"{index:04X}:00": nothing for index in range(0x1A00, 0x1A04)}
    drive = with_objects(**mappings, x6041=SimulatedObject(absent=True))
    with pytest.raises(BusConfigurationError, match=r"node 1 \(axis handle\): not a CiA 402 drive: there is no 6041h"):
        asked(drive)


READ_ONLY = SimulatedObject(access="ro")
FAULT_REACTION = "605Eh:00 fault reaction option code"


def opened(profile: CanopenProfile, drive: CanopenProfile) -> list[str]:
    """The warnings of a bus that was opened on such a drive; raises BusError."""
    plan = plan_of(rig=rig_of(WALL, profile=PROFILE.name), profile=profile)
    clock = VirtualClock()
    world = World(clock, 1_000_000)
    world.add(DriveOnBus(1, drive, plan.axes[0].rig, None))
    bus = CanopenBus(SimulatedBus(world=world), clock, owned=True)
    try:
        bus.open(plan)
        return bus.warnings
    finally:
        bus.close()


def test_a_fault_reaction_that_can_only_be_read_is_left_out_and_told() -> None:
    told = opened(GENERIC, with_objects(x605E=READ_ONLY))
    assert [each for each in told if FAULT_REACTION in each] == [
        f"node 1 (axis handle): {FAULT_REACTION} is read-only and stays 2"
    ]
    assert not any(FAULT_REACTION in each for each in opened(GENERIC, GENERIC))


@pytest.mark.parametrize("name", ["the only reaction", "a profile of this drive", "the reaction to a lost link"])
def test_a_reaction_that_is_relied_on_is_not_left_out(name: str) -> None:
    profile, drive = GENERIC, with_objects(x605E=READ_ONLY)
    if name == "the only reaction":
        profile = replace(GENERIC, link_loss=replace(GENERIC.link_loss, abort_connection_option=None))
    elif name == "a profile of this drive":
        profile = replace(GENERIC, drive=replace(GENERIC.drive, evidence="vendor-data"))
    else:
        drive = with_objects(x6007=READ_ONLY)
    with pytest.raises(BusConfigurationError, match=r"60(5E|07)h:00"):
        opened(profile, drive)


def test_an_answer_that_is_neither_a_value_nor_an_absence_ends_the_questions() -> None:
    """A node-ID that nobody has stays silent, which is no absence."""
    clock = VirtualClock()
    with SimulatedBus(world=World(clock, 1_000_000)) as bus, pytest.raises(TimeoutError, match="6041h"):
        fit_to_drive(GENERIC, Node(Wire(bus, clock, "sim"), 9, "node 9"))

"""Set-points that no longer act, over the simulated bus: lost, or by the hand of another tool."""

import math
import struct
from collections.abc import Callable

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import DriveFaultError, HapticFieldbusError, UnstableSceneError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import Hand, Piece
from tests.builders import PROFILE, can_traffic, canopen, endless_rig, rig_of, scene_of, shipped
from tests.invariants.attach import watched
from tests.softened import softened
from tests.whole_loop import run_loop

RATES = (1000.0, 250.0, 50.0)
CONTACT = 1.0
"""[s] after operation enabled; the hand is deepest in the wall then, and leaves it within half a second."""
TURN = math.pi
"""Of the hand, which goes to and fro every two seconds [rad/s]."""
STROKE, ARM = 0.03, 1e6
"""[m], [kg]"""
LED = Hand("led", (Piece(0.0, 0.5 * ARM * STROKE * TURN**2),), angular_frequency=TURN, mass=ARM, stiffness=1e7,
           damping=2e3)  # fmt: skip
"""Leads the handle over the stroke and back, ½·STROKE·(1 − cos TURN·t), whatever the motor does."""
SHIPPED = [name for name in shipped() if canopen(name).drive.usable]
SOFT = scene_of(Wall("handle", stiffness=300.0, position=0.01))
"""120 ‰ of rated torque where the hand is deepest."""
LONGEST = 0.4
"""[s]; in it the hand has left so far that the target is 3 % of rated torque lower, and the deadline has passed."""


def written(index: int, subindex: int, value: int, size: int) -> Frame:
    """An expedited download to node 1, as another tool would write it (CiA 301 7.2.4.3.3)."""
    command = 0x23 | (4 - size) << 2
    return Frame(0x601, struct.pack("<BHB", command, index, subindex) + value.to_bytes(size, "little").ljust(4, b"\0"))


TOOLS = {
    "RPDO switched off": written(0x1400, 1, 0x8000_0201, 4),
    "torque limit lowered": written(0x6072, 0, 10, 2),
    "profile velocity mode": written(0x6060, 0, 3, 1),
    "no mode": written(0x6060, 0, 0, 1),
}


class SimulatedDrives:
    """A loop on a simulated bus, and another tool of the drive."""

    def __init__(self, drive: str, rate: float, these: tuple[faults.Fault, ...] = ()) -> None:
        self.plan: Plan = compile_plan(SOFT, rig_of(SOFT), {PROFILE.name: canopen(drive)}, rate)
        self.clock, self.report = VirtualClock(), LoopReport()
        self.world = World(self.clock, can_traffic(self.plan).bitrate)
        (axis,) = self.plan.axes
        self.drive = self.world.add(DriveOnBus(1, axis.profile, axis.rig, LED, faults=these))

    def run(self, seconds: float, act: Callable[[], object] = lambda: None) -> LoopReport:
        """Run; the tool acts at CONTACT."""
        bus = CanopenBus(SimulatedBus(world=self.world), self.clock, owned=True)
        acting_at = round(CONTACT * self.plan.rate)

        def progress(done: int) -> None:
            # Called every tenth of a second.
            if done == acting_at:
                act()

        try:
            bus.open(self.plan)
            return run_loop(
                self.plan, Cycle(self.plan), bus, self.clock,
                cycles=round(seconds * self.plan.rate), progress=progress, report=self.report,
            )  # fmt: skip
        finally:
            bus.close()

    def tool(self, frame: Frame) -> None:
        """Write to the drive behind the master's back: on the wire it would be heard, and be a trip of its own."""
        self.drive.receive(frame, self.clock.now_ns())

    @property
    def ended(self) -> float:
        """[s] after operation enabled."""
        assert self.report.enabled_at_ns is not None
        assert self.report.last_ns is not None
        return (self.report.last_ns - self.report.enabled_at_ns) * 1e-9


@pytest.mark.thorough("every tool at every rate with every drive", quick=4)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("drive", SHIPPED)
@pytest.mark.parametrize("name", TOOLS)
def test_what_another_tool_does_to_the_set_points_takes_the_torque_away(name: str, drive: str, rate: float) -> None:
    if name == "torque limit lowered" and 0x6072 in canopen(drive).simulation.absent:
        return  # a drive without 6072h refuses that
    if name == "profile velocity mode" and 3 not in (canopen(drive).simulation.modes or (3,)):
        return
    rack = SimulatedDrives(drive, rate)
    with pytest.raises(DriveFaultError, match="set-points do not act"):
        rack.run(6.0, lambda: rack.tool(TOOLS[name]))
    assert CONTACT <= rack.ended <= CONTACT + LONGEST


@pytest.mark.thorough("every drive at every rate", quick=2)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("drive", SHIPPED)
def test_rpdos_that_are_lost_take_the_torque_away(drive: str, rate: float) -> None:
    rack = SimulatedDrives(drive, rate, (faults.MissingRpdos("missing_rpdos", CONTACT),))
    with pytest.raises(DriveFaultError, match="set-points do not act"):
        rack.run(6.0)
    assert CONTACT <= rack.ended <= CONTACT + LONGEST


@pytest.mark.thorough("every drive", quick=1)
@pytest.mark.parametrize("drive", SHIPPED)
def test_a_few_rpdos_that_are_lost_are_no_reason_to_stop(drive: str) -> None:
    rack = SimulatedDrives(
        drive, 1000.0, tuple(faults.MissingRpdos("missing_rpdos", 0.05 * each, 3) for each in range(1, 50))
    )
    assert rack.run(3.0).cycles == 3000


def test_a_torque_limit_above_what_is_asked_for_is_no_reason_to_stop() -> None:
    rack = SimulatedDrives("generic_cia402", 1000.0)
    assert rack.run(3.0, lambda: rack.tool(written(0x6072, 0, 900, 2))).cycles == 3000


@pytest.mark.thorough("every scene of the library with every shipped drive for five seconds", quick=1)
@pytest.mark.parametrize("drive", SHIPPED)
@pytest.mark.parametrize("scene", scene_names())
def test_no_scene_of_the_library_trips(scene: str, drive: str) -> None:
    # A scene that is unstable on a slow drive is refused, and runs with its stiffest element at half of its limit.
    played = softened(scene, drive)
    if played != scene:
        with pytest.raises(UnstableSceneError) as refused:
            run(scene, drive=drive, duration=5.0)
        assert isinstance(refused.value.result, Result)
        assert refused.value.result.cycles is None  # no period began
    assert run(played, drive=drive, duration=5.0).trips == ()


@pytest.mark.thorough("every drive at every rate", quick=1)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("drive", SHIPPED)
@pytest.mark.parametrize("hand", ["push", "tap"])
def test_no_wall_at_half_its_limit_trips(drive: str, rate: float, hand: str) -> None:
    rig = endless_rig("wall", drive)
    result = run("wall", rig, rate=rate, hand=hand, duration=5.0, settings={"wall.stiffness": "max/2"})
    assert result.trips == ()
    assert np.abs(result.traces[0].force).max() > 0.0


@pytest.mark.thorough("two runs of 12 s")
@pytest.mark.parametrize("lost_at", [6.0, 7.3])
def test_rpdos_lost_under_constant_torque_take_it_away_by_the_next_pulses_that_ask_the_encoder(lost_at: float) -> None:
    """A hand leans still, so that the torque that is held is the one that is asked for, and no echo can differ from it.

    Counts that stand still are asked by pulses after 2 s, which the drive does not hear: five pairs end the run.
    """
    fault = faults.MissingRpdos("missing_rpdos", lost_at)
    with watched() as found, pytest.raises(HapticFieldbusError, match="torque is off") as ended:
        run("wall", endless_rig("wall"), hand="push", duration=lost_at + 10.0, faults=[fault])
    assert isinstance(ended.value.result, Result)
    (trip,) = ended.value.result.trips
    assert trip.name in ("encoder stands still", "set-points do not act")
    assert found.broken == []

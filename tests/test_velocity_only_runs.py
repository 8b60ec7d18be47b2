"""Scenes rendered on a simulated drive that offers velocity only, held against the true motion of the handle."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus import plan, run
from haptic_fieldbus.assessing.loop_report import Record
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle, columns
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.drive.cia402 import VelocitySection
from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import Hand, Piece, hand_named
from tests.builders import VELOCITY_ONLY, can_traffic, plan_of, rig_of, scene_of
from tests.cycle.test_cycle import Constant
from tests.velocity_only import velocity_only
from tests.whole_loop import run_loop

Array = NDArray[np.float64]
SCENES = ["wall", "damped_wall", "sprung_mass"]
RATIO = 0.05 / (2 * math.pi)
WHOLE = 0.05 / 60
"""1 r/min of the motor at the handle [m/s]."""
ARM = 1e6
"""[kg]; no handle deflects it."""


def in_unit(unit: str) -> CanopenProfile:
    assert VELOCITY_ONLY.velocity is not None
    return replace(VELOCITY_ONLY, velocity=VelocitySection(replace(VELOCITY_ONLY.velocity.actual, unit=unit)))


def led(stroke: float, frequency: float) -> Hand:
    """Leads the handle over a stroke and back, x = ½·stroke·(1 − cos ωt), with a grip that hardly gives way."""
    force = Piece(0.0, 0.5 * ARM * stroke * frequency**2)
    return Hand("led", (force,), angular_frequency=frequency, mass=ARM, stiffness=1e7, damping=2e3)


@dataclass(frozen=True, eq=False)
class Motion:
    """From *operation enabled* on: what the loop took for the position, where the handle was, and how fast it was."""

    times: Array
    position: Array
    true: Array
    speed: Array
    cycle: Cycle

    @property
    def error(self) -> Array:
        return np.abs(self.position - self.true)


def moved(compiled: Plan, hand: Hand | None, duration: float, these: tuple[faults.Fault, ...] = ()) -> Motion:
    """A run in simulation, to its end or its drift trip."""
    clock = VirtualClock()
    world, cycle = World(clock, can_traffic(compiled).bitrate), Cycle(compiled)
    world.add(DriveOnBus(1, compiled.axes[0].profile, compiled.axes[0].rig, hand, faults=these))
    bus = CanopenBus(SimulatedBus(world=world), clock, None, owned=True)
    cycles = round(duration * compiled.rate)
    record = Record(columns(compiled), cycles + 4000)
    try:
        bus.open(compiled)
        report = run_loop(compiled, cycle, bus, clock, cycles=cycles, record=record)
        enabled_ns = report.enabled_at_ns
    finally:
        bus.close()
    rows = record.rows()
    assert enabled_ns is not None
    rows = rows[rows[:, 0] >= enabled_ns]
    angle, speed, _ = world.trajectory(1).sample(rows[:, 0].astype(np.int64))
    position = rows[:, columns(compiled).index("handle.position")]
    true = RATIO * (angle - angle[0])
    return Motion((rows[:, 0] - rows[0, 0]) * 1e-9, position, true, RATIO * speed, cycle)


def planned(unit: str, scene: Scene | None = None, rate: float = 1000.0, drift: float = 1.0) -> Plan:
    free = scene or scene_of(Constant("handle", 0.0))
    return plan_of(free, rate, rig=rig_of(free, limits=Limits(speed=10.0, drift=drift)), profile=in_unit(unit))


@pytest.mark.thorough("three runs", quick=1)
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_feels_like_the_ideal_one(name: str, tmp_path: Path) -> None:
    result = run(name, drive=str(velocity_only(tmp_path)), duration=3.0)
    assert str(result.verdict).startswith("Feels right: ")
    assert result.torque_error is not None
    sources = result.torque_error.by_source
    assert "tachometer" in sources
    assert not {"encoder", "estimator"} & sources.keys()
    assert sum(sources.values()) == pytest.approx(1.0)
    assert result.traces[0].sensor == "tachometer"


def test_the_report_of_a_drive_with_an_encoder_is_as_before() -> None:
    result = run("damped_wall", duration=1.5)
    assert result.torque_error is not None
    assert {"encoder", "estimator"} <= result.torque_error.by_source.keys()
    assert result.traces[0].sensor == "encoder"


@pytest.mark.thorough("ten runs", quick=1)
@pytest.mark.parametrize(
    ("unit", "hand"),
    [("rpm", "push"), ("rpm", "guide"), ("0.1 rpm", "sine"), ("counts/s", "tap"), ("counts/s", "push")],
)
@pytest.mark.parametrize(
    "scene", [Wall("handle", 600.0, 0.02, 2.0), SprungMass("handle", 200.0, 0.5)], ids=["wall", "mass"]
)
def test_the_position_is_never_further_off_than_the_drift_that_trips(
    unit: str, hand: str, scene: Wall | SprungMass
) -> None:
    found = moved(planned(unit, scene_of(scene)), hand_named(hand), 4.0)
    step = found.cycle.axes["handle"].axis.velocity_unit
    assert np.ptp(found.true) > 2e-3
    truncation = 1e-5 * (np.abs(np.diff(found.speed)).max() / 1e-3) / 80.0
    assert (found.error <= 0.5 * step * found.times + truncation).all()
    assert found.cycle.axes["handle"].state.drift == pytest.approx(0.5 * step * found.times[-1])


@pytest.mark.thorough("a long run")
def test_readings_that_stay_away_make_the_position_uncertain_and_no_more_wrong_than_that() -> None:
    lost = tuple(faults.MissingTpdos("missing_tpdos", at, 2) for at in (0.55, 0.6, 0.65, 0.7))
    scene = scene_of(Wall("handle", 600.0, 0.02))
    whole, holed = (moved(planned("0.1 rpm", scene), hand_named("push"), 1.0, these) for these in ((), lost))
    assert holed.cycle.axes["handle"].state.drift > whole.cycle.axes["handle"].state.drift
    assert holed.error[-1] < holed.cycle.axes["handle"].state.drift
    assert holed.cycle.trip is None


@pytest.mark.thorough("runs until half steps have added up")
def test_the_run_ends_in_a_drift_trip_when_half_steps_have_added_up(tmp_path: Path) -> None:
    path = velocity_only(tmp_path)
    position = next(step for step in plan("wall", drive=str(path)).steps if step.startswith("position"))
    assert position.endswith("trips when uncertain by 5 mm, after 12 s")
    with pytest.raises(
        SafetyTripError, match=r"12\.0\d\d s after enabling: position uncertain by 0\.005.*limits\.drift"
    ) as caught:
        run("wall", drive=str(path), duration=13.0)
    assert isinstance(caught.value.result, Result)
    assert [trip.name for trip in caught.value.result.trips] == [TripKind.DRIFT.value]


@pytest.mark.thorough("a long run")
def test_first_issue_a_motion_slower_than_half_a_step_is_lost_in_a_run() -> None:
    """2 mm in ten seconds: every reading is zero; the drift knows that this may be so."""
    found = moved(planned("rpm"), led(2e-3, 0.3), 10.0)
    assert np.abs(found.speed).max() < 0.5 * WHOLE
    assert found.true[-1] == pytest.approx(1.9e-3, rel=0.1)
    assert not found.position.any()
    assert (found.error <= found.times * 0.5 * WHOLE).all()


def test_second_issue_a_motion_at_the_rate_of_the_loop_runs_away_in_a_run() -> None:
    """The handle vibrates by 0.2 mm at 100 Hz and so does the loop: each reading is the same, nothing tells of it."""
    found = moved(planned("0.1 rpm", rate=100.0), led(2e-4, 2 * math.pi * 100.0), 2.0)
    settled = found.times > 0.5
    assert np.ptp(found.true[settled]) < 1e-4
    steady = found.speed[settled].mean()
    assert abs(steady) > 10 * WHOLE
    assert np.polyfit(found.times[settled], found.position[settled], 1)[0] == pytest.approx(steady, rel=1e-2)
    assert found.error[-1] > 100 * found.cycle.axes["handle"].state.drift

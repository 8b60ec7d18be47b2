"""How far a handle went and how deep: closed forms of a hand that leans, real drives, changes, trips, long runs."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing import summary
from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.assessing.result import Result, known_before
from haptic_fieldbus.assessing.summary import Assessment, Run
from haptic_fieldbus.assessing.travel import Reach, Travel
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.magnet import Magnet
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.builders import endless_rig, scene_of

RTU = "sim-modbus-rtu@115200"
PUSH = 6.0
"""[N] of the hand that pushes; on a rotary axis a twentieth of it in N·m."""
FRICTION = 2.0e-3
"""[N·m] of the shipped motor; a handle with 0.05 m to the turn feels 0.25 N."""
LINEAR = 2.0 * math.pi / 0.05
OVERSHOOT = 0.05
"""[N] by which the ramp of the push is left behind."""


def told(result: Result, axis: int = 0) -> Travel:
    return result.travel[axis]


def of(*elements: AnyElement, hand: str = "push") -> Result:
    return run(scene_of(*elements), duration=1.5, hand=hand)


@pytest.mark.thorough("whole runs", quick=1)
@pytest.mark.parametrize("stiffness", [600.0, 1000.0])
def test_a_hand_that_leans_on_a_wall_is_its_push_over_the_stiffness_deep(stiffness: float) -> None:
    """From the surface on, as the push grows in half a second: nothing is hit."""
    found = told(of(Wall("handle", stiffness)))
    tolerance = (FRICTION * LINEAR + OVERSHOOT) / stiffness
    assert found.depth["wall"] == pytest.approx(PUSH / stiffness, abs=tolerance)
    assert found.highest == found.depth["wall"]
    assert found.lowest == pytest.approx(0.0, abs=1e-6)


class Unsure(Wall):
    """A wall of one's own whose depth is a bug."""

    def penetration(self, position: float) -> float:
        return 1.0 / (self.damping - self.damping)


def test_an_element_that_fails_to_tell_its_depth_hides_neither_a_trip_nor_a_result() -> None:
    sentence = "depth of element wall: ZeroDivisionError: float division by zero"
    found = run(scene_of(Unsure("handle", 600.0)), duration=0.02, hand="none")
    assert told(found).depth == {}
    assert found.warnings.count(sentence) == 1
    with pytest.raises(SafetyTripError) as tripped:
        run(scene_of(Unsure("handle", 600.0, 0.0999)), duration=2.0)
    assert "position" in str(tripped.value)
    assert sentence in tripped.value.result.warnings  # type: ignore[attr-defined]


@pytest.mark.thorough("a whole run")
def test_on_a_rotary_axis_it_is_told_in_radians() -> None:
    scene = scene_of(Wall("knob", 0.08, 0.2), workspace=Workspace.ROTARY)
    found = told(run(scene, endless_rig(scene), duration=2.0))
    assert (found.workspace, found.axis) == (Workspace.ROTARY, "knob")
    assert found.depth["wall"] == pytest.approx(found.highest - 0.2)
    at_rest = 0.05 * PUSH / 0.08
    assert at_rest - FRICTION / 0.08 < found.depth["wall"] < 2.0 * at_rest


def test_true_extremes_are_those_of_the_trace_and_no_encoder_count_off() -> None:
    """Values of the true motion, which the trace has 16 times a period, and not those of the decoded samples."""
    result = run("wall", duration=1.2)
    trace, found = result.traces[0], told(result)
    assert trace.samples is not None
    assert found.highest == pytest.approx(trace.position.max(), abs=1e-7)
    assert found.highest == pytest.approx(trace.samples.max(), abs=0.05 / 4096)
    assert found.depth == {"wall": pytest.approx(found.highest - 0.02)}


@pytest.mark.thorough("whole runs at 140 Hz")
def test_at_half_the_limit_of_a_serial_line_a_push_goes_on_to_the_end_of_the_bench() -> None:
    """6 N over some 70 N/m are 86 mm, of which the bench has 80."""
    with pytest.raises(SafetyTripError, match=r"the limit of 0\.1 m") as tripped:
        run("wall", bus=RTU, settings={"wall.stiffness": "max/2"})
    result = tripped.value.result
    assert isinstance(result, Result)
    assert told(result).highest == pytest.approx(0.1, abs=5e-3)
    assert told(result).highest > 0.1 - 0.05 / 4096
    assert told(result).depth == {"wall": pytest.approx(told(result).highest - 0.02)}
    endless = told(
        run(
            "wall",
            endless_rig("wall", "generic_cia402_modbus", RTU),
            settings={"wall.stiffness": "max/2"},
            duration=3.0,
        )
    )
    assert result.plan is not None
    wall = result.plan.scene.elements[0]
    assert isinstance(wall, Wall)
    assert PUSH / wall.stiffness > 0.08
    assert endless.depth["wall"] > PUSH / wall.stiffness - FRICTION * LINEAR / wall.stiffness


@pytest.mark.thorough("a whole run at 140 Hz")
def test_between_the_samples_of_a_slow_line_nothing_is_missed() -> None:
    result = run("wall", bus=RTU, settings={"wall.stiffness": "max/2"}, hand="tap", duration=2.0)
    trace, found = result.traces[0], told(result)
    assert 0.0 < found.depth["wall"] < 0.08
    # Of four points a period the nearest is an eighth of a period off: a·t²/2 at 10 N on 0.1 kg.
    assert found.highest == pytest.approx(trace.position.max(), abs=100.0 * (1.0 / 140.0 / 8.0) ** 2 / 2.0)


@pytest.mark.thorough("whole runs")
def test_each_wall_is_told_of_by_itself_and_a_stop_on_both_sides() -> None:
    behind = Wall("handle", 100.0, 0.005, side="negative", name="behind")
    found = told(of(Wall("handle", 600.0, 0.02), behind, Magnet("handle", 1.0, 0.01, -0.09)))
    assert set(found.depth) == {"wall", "behind"}
    assert found.depth["wall"] == pytest.approx(found.highest - 0.02)
    assert found.depth["behind"] == pytest.approx(0.005 - found.lowest)
    stops = told(of(EndStop("handle", 600.0, -0.004, 0.02), hand="sine"))
    assert stops.depth["end_stop"] == pytest.approx(max(-0.004 - stops.lowest, stops.highest - 0.02))


@pytest.mark.thorough("a whole run")
def test_each_axis_has_its_own_way() -> None:
    result = of(Wall("x", 600.0, name="in_x"), Wall("y", 300.0, name="in_y"))
    assert [(each.axis, set(each.depth)) for each in result.travel] == [("x", {"in_x"}), ("y", {"in_y"})]
    assert told(result, 1).depth["in_y"] > told(result, 0).depth["in_x"] > 0.0


def test_a_hand_that_meets_nothing_is_told_of_no_depth() -> None:
    found = told(run("wall", duration=0.05))
    assert found.depth == {"wall": 0.0}
    assert json.loads(json.dumps(found.to_json())) == {
        "axis": "handle", "lowest": found.lowest, "highest": found.highest, "depth": {"wall": 0.0},
    }  # fmt: skip
    assert found.highest < 0.02


@pytest.mark.thorough("a whole run twice")
def test_a_run_in_parts_went_as_far_as_a_whole_one(monkeypatch: pytest.MonkeyPatch) -> None:
    change = [(0.9, {"wall.position": 0.03})]
    whole = told(run("wall", duration=1.6, changes=change))
    monkeypatch.setattr(summary, "PART", 217)
    monkeypatch.setattr(summary, "BEHIND", 100)
    parts = told(run("wall", duration=1.6, changes=change))
    assert (parts.lowest, parts.highest) == pytest.approx((whole.lowest, whole.highest), abs=1e-7)
    assert parts.depth == pytest.approx(whole.depth, abs=1e-7)


MOVED = Wall("handle", 600.0, 0.05)


@pytest.mark.parametrize(
    ("changed_ns", "acted", "depth"),
    [
        ([], [Wall("handle", 600.0, 0.02)], 0.03),
        # The new wall stands further on than the handle goes afterwards, or acts where it is deepest.
        ([40], [Wall("handle", 600.0, 0.02), MOVED], 0.03),
        ([5], [Wall("handle", 600.0, 0.0), Wall("handle", 600.0, 0.045)], 0.01),
        ([0, 20], [MOVED, MOVED, Wall("handle", 600.0, 0.035)], 0.0),
        ([], [Wall("handle", 600.0, 0.02, sides="bilateral")], None),
        ([], [Magnet("handle", 1.0, 0.01, 0.5, name="wall")], None),
    ],
)
def test_the_depth_is_that_in_the_element_that_acted(
    changed_ns: list[int], acted: list[AnyElement], depth: float | None
) -> None:
    reach = Reach()
    assert reach.travel("handle", Workspace.LINEAR, []) is None
    times_ns = np.arange(0, 50, 10)
    positions = np.array([0.01, 0.05, 0.02, 0.03, -0.01])
    for rows in (slice(0, 2), slice(2, 5)):
        reach.add(times_ns[rows], positions[rows], changed_ns)
    found = reach.travel("handle", Workspace.LINEAR, [[each] for each in acted])  # type: ignore[list-item]
    assert found is not None
    assert (found.lowest, found.highest) == (-0.01, 0.05)
    assert found.depth == ({} if depth is None else {"wall": pytest.approx(depth, abs=1e-15)})


def test_of_real_drives_the_decoded_positions_count_also_those_that_the_record_has_lost() -> None:
    """From operation enabled on: what a handle did before is not of the run."""
    plan = load(Task("wall")).plan
    cycle, report = Cycle(plan), LoopReport()
    record = Record(cycle.columns, 50)
    assessment = Assessment(Run(plan, "sim", cycle, record, report, {}, "monotonic", 400, ""))
    row = dict.fromkeys(cycle.columns, 0.0)
    assert assessment.with_travel(known_before(plan, "sim")).travel == ()
    for number in range(400):
        row["t_ns"] = 1e6 * number
        # The deepest place, 0.031, is passed at row 110 only; before operation enabled the handle was further still.
        row["handle.position"] = 0.5 if number < 10 else 0.031 if number == 110 else 1e-5 * number
        record.push(tuple(row.values()))
        report.enabled_at_ns = 10_000_000 if number >= 10 else None
        if number % 20 == 0:
            assessment.advance()
    (found,) = assessment.with_travel(known_before(plan, "sim")).travel
    assert (found.lowest, found.highest) == (1e-4, 0.031)
    assert found.depth == {"wall": pytest.approx(0.011)}
    assert replace(found) == found

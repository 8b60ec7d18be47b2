"""What a plan knows of a guard: the proof that counts, the reason for a new one, and the cap without one."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.drive.rig import Limits, Proved, Rig
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.guards import to_prove
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.plan_json import plan_json
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.profile import LinkLossSection
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import PROFILE, WALL, plan_of, rig_of, scene_of
from tests.running.guard_bench import rig_text

GOOD = Proved("proved", PROFILE.name, 50.0, "2026-11-22T12:00:00+01:00", 48.9, 0xC17B76A7)
FAILED = replace(GOOD, guard="none", guard_ms=None)
UNGUARDED = replace(PROFILE, link_loss=LinkLossSection())
TWO = scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b"))


def planned(proved: Proved | None = None, *, source: str = "rig.toml", real: bool = True, **changes: object) -> Plan:
    rig = rig_of(WALL, proved=proved, **changes)
    section = CanSection("socketcan", "can0") if real else rig.bus["bus"]
    return plan_of(rig=replace(rig, source=source, bus={"bus": section}))


def due(plan: Plan, serial: int | None = GOOD.serial) -> Mapping[str, str]:
    recorded = {axis.name: axis.rig.proved for axis in plan.axes}
    return to_prove(plan.guards, recorded, dict.fromkeys(recorded, serial))


def told(plan: Plan) -> dict[str, Any]:
    """The only guard of a plan as JSON."""
    guards: Any = plan_json(plan)["guards"]
    (only,) = guards
    assert isinstance(only, dict)
    return only


@pytest.mark.parametrize(
    ("proved", "source", "serial", "why"),
    [
        (GOOD, "rig.toml", GOOD.serial, ""),
        (None, "rig.toml", GOOD.serial, "the rig file has no proof of it yet"),
        (None, "", GOOD.serial, "without a rig file no proof is kept"),
        (GOOD, "rig.toml", 7, "that of the drive 0xc17b76a7, this one is 0x00000007"),
        (GOOD, "rig.toml", None, "the drive tells no serial number"),
        (replace(GOOD, serial=None), "rig.toml", 7, "names no drive"),
        (replace(GOOD, profile="another"), "rig.toml", GOOD.serial, "made with the profile another"),
        (replace(GOOD, asked_ms=100.0), "rig.toml", GOOD.serial, "one of 100 ms"),
    ],
)
def test_a_proof_counts_for_one_drive_one_profile_and_one_time(
    proved: Proved | None, source: str, serial: int | None, why: str
) -> None:
    found = due(planned(proved, source=source), serial)
    assert (why in found["handle"]) if why else not found


@pytest.mark.parametrize("serial", [GOOD.serial, None])
def test_a_known_failure_is_not_tried_again_on_the_same_drive(serial: int | None) -> None:
    assert not due(planned(FAILED, emergency_stop="power"), serial)
    assert due(planned(FAILED, emergency_stop="power"), 7)


@pytest.mark.parametrize(
    "proved", [FAILED, replace(FAILED, guard_ms=500.0), replace(FAILED, serial=None), replace(FAILED, asked_ms=100.0)]
)
def test_a_known_failure_is_refused_without_an_emergency_stop_and_capped_with_one(proved: Proved) -> None:
    with pytest.raises(PlanError, match=r'2026-11-22.*axis\.handle\.emergency_stop = "power".*run --prove'):
        planned(proved)
    capped, free = planned(proved, emergency_stop="power"), planned(GOOD)
    assert capped.axes[0].limits.effort == pytest.approx(0.05 * free.axes[0].rated_effort)
    assert capped.axes[0].limits.slew == pytest.approx(0.05 * free.axes[0].limits.slew)
    assert free.axes[0].limits.effort == free.axes[0].rated_effort


def test_an_emergency_stop_alone_changes_nothing() -> None:
    assert planned(GOOD, emergency_stop="power").axes[0].limits == planned(GOOD).axes[0].limits


def test_a_failure_of_another_profile_says_nothing_of_this_one() -> None:
    assert planned(replace(FAILED, profile="another")).axes[0].limits.effort == planned().axes[0].limits.effort


def test_where_one_guard_is_due_all_others_are_proved_with_it_but_those_that_do_not_exist() -> None:
    rig = rig_of(TWO)
    assert isinstance(rig, Rig)
    axes = {**rig.axis, "left": replace(rig.axis["left"], proved=GOOD)}
    both = plan_of(TWO, rig=replace(rig, axis=axes, source="rig.toml"))
    assert list(due(both)) == ["left", "right"]
    known = {**axes, "left": replace(axes["left"], proved=FAILED, emergency_stop="power")}
    assert list(due(plan_of(TWO, rig=replace(rig, axis=known, source="rig.toml")))) == ["right"]


def test_a_profile_without_a_guard_has_nothing_to_prove_and_deadlines_without_end() -> None:
    plan = plan_of(rig=rig_of(WALL, emergency_stop="power"), profile=UNGUARDED)
    assert not due(plan)
    assert "guard      test drive offers no watch on its master" in explain(plan)
    assert "guard: test drive offers no watch" in explain(plan)
    assert "master killed: without end, a person who cuts the power" in explain(plan)
    assert "drive fault or emergency: without end, the drive by itself, nobody knows how soon" in explain(plan)
    assert told(plan)["capped"].startswith("test drive offers no watch")


@pytest.mark.parametrize(
    ("proved", "real", "text"),
    [
        (GOOD, True, "50 ms; 48.9 ms measured on 2026-11-22T12:00:00+01:00, drive with serial number 0xc17b76a7"),
        (None, True, "50 ms; is proved at zero torque before force is given: the rig file has no proof of it yet"),
        (None, False, "50 ms; taken on trust in a simulation, and proved with run --prove"),
    ],
)
def test_a_plan_says_what_it_knows(proved: Proved | None, real: bool, text: str) -> None:
    plan = planned(proved, real=real)
    assert f"\nguard      {text}\n" in explain(plan)
    assert told(plan) == {
        "axis": "handle",
        "guard_ms": 50.0,
        "proved": None
        if proved is None
        else {"guard_ms": 48.9, "date": "2026-11-22T12:00:00+01:00", "serial": 0xC17B76A7},
        "unproved": None if proved else "the rig file has no proof of it yet",
        "capped": None,
        "emergency_stop": None,
    }


def test_a_rig_file_holds_a_proof_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    table = 'serial = 0xC17B76A7\nguard = "proved"\nguard_ms = 48.9\nasked_ms = 50.0\nprofile = "test_drive"\n'
    path.write_text(rig_text() + f'[axis.handle.proved]\n{table}date = "{GOOD.date}"\n', encoding="utf-8")
    assert load_rig(path).axis["handle"].proved == GOOD
    assert load_rig(path).unproved().axis["handle"].proved is None


def test_a_cap_of_the_force_is_told_with_its_value_and_its_reason() -> None:
    stopped = rig_of(WALL, emergency_stop="power")
    axis = plan_of(rig=stopped, profile=UNGUARDED).axes[0]
    assert axis.limits.effort == pytest.approx(0.05 * axis.rated_effort)
    told = "force limited to 2.51 N, 5 % of rated torque: test drive offers no watch on its master that takes the "
    assert axis.cap == f"{told}torque away (profile)"
    mute = replace(PROFILE, torque=replace(PROFILE.torque, echo="none"))
    why = "test drive does not show what it was sent (torque.echo of its profile)"
    assert plan_of(profile=mute).axes[0].cap.endswith(why)
    unknown = plan_of(rig=rig_of(WALL, inertia=None)).axes[0]
    assert unknown.cap.endswith("rated torque: inertia and viscous_damping of the axis are not known")


def test_a_limit_of_the_rig_below_the_cap_is_no_cap() -> None:
    assert plan_of().axes[0].cap == ""
    low = rig_of(WALL, emergency_stop="power", limits=Limits(effort=1.0))
    assert plan_of(rig=low, profile=UNGUARDED).axes[0].cap == ""

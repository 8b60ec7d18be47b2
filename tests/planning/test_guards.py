"""Knowledge of a plan about a guard: the proof that counts, the reason for a new one, and the cap without one."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.drive.cia402 import OptionCode, WrittenObject
from haptic_fieldbus.drive.profile import DataType, Identity
from haptic_fieldbus.drive.rig import Limits, Proved, Rig
from haptic_fieldbus.errors import PlanError, RigError
from haptic_fieldbus.planning.explain import explain, plan_json
from haptic_fieldbus.planning.guards import to_prove
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, LinkLossSection, SetupSection
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import PROFILE, WALL, plan_of, rig_of, scene_of
from tests.running.guard_bench import rig_text

UNSEALED = Proved("proved", PROFILE.name, 50.0, "2026-11-22T12:00:00+01:00", 48.9, 0xC17B76A7, 0xFB, 0x6050, 7)
DRIVE = UNSEALED.drive
UNGUARDED = replace(PROFILE, link_loss=LinkLossSection())
TWO = scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b"))


def planned(
    proved: Proved | None = None,
    *,
    source: str = "rig.toml",
    real: bool = True,
    channel: str = "can0",
    profile: CanopenProfile = PROFILE,
    rate: float = 1000.0,
    **changes: object,
) -> Plan:
    rig = rig_of(WALL, proved=proved, **changes)
    section = CanSection("socketcan", channel) if real else rig.bus["bus"]
    return plan_of(rig=replace(rig, source=source, bus={"bus": section}), profile=profile, rate=rate)


def sealed(proved: Proved) -> Proved:
    """The proof with the digest that a run of this plan would have given it."""
    (guard,) = planned().guards
    return replace(proved, digest=proved.digest_with(guard.set_to.written))


GOOD = sealed(UNSEALED)
FAILED = replace(GOOD, guard="none", guard_ms=None)


def due(plan: Plan, drive: Identity = DRIVE) -> Mapping[str, str]:
    recorded = {axis.name: axis.rig.proved for axis in plan.axes}
    return to_prove(plan.guards, recorded, dict.fromkeys(recorded, drive))


def told(plan: Plan) -> dict[str, Any]:
    """The only guard of a plan as JSON."""
    guards: Any = plan_json(plan)["guards"]
    (only,) = guards
    assert isinstance(only, dict)
    return only


@pytest.mark.parametrize(
    ("proved", "source", "drive", "why"),
    [
        (GOOD, "rig.toml", DRIVE, ""),
        (None, "rig.toml", DRIVE, "the rig file has no watchdog proof yet"),
        (None, "", DRIVE, "without a rig file no proof is saved"),
        (GOOD, "rig.toml", replace(DRIVE, serial=7), "another drive: serial 0xc17b76a7, this drive has 0x00000007"),
        (GOOD, "rig.toml", replace(DRIVE, vendor=7), "another drive: vendor 0x000000fb, this drive has 0x00000007"),
        (GOOD, "rig.toml", replace(DRIVE, product=None), "another drive: product 0x00006050, this drive has unknown"),
        (GOOD, "rig.toml", replace(DRIVE, revision=8), "another drive: revision 0x00000007, this drive has 0x00000008"),
        (GOOD, "rig.toml", replace(DRIVE, serial=None), "the drive reports no serial number"),
        (sealed(replace(UNSEALED, serial=None)), "rig.toml", DRIVE, "names no drive"),
        (sealed(replace(UNSEALED, serial=None)), "rig.toml", replace(DRIVE, serial=None), "no serial number"),
        (sealed(replace(UNSEALED, serial=0)), "rig.toml", DRIVE, "names no drive"),
        (sealed(replace(UNSEALED, serial=0xFFFF_FFFF)), "rig.toml", replace(DRIVE, serial=None), "no serial number"),
        (replace(GOOD, profile="another"), "rig.toml", DRIVE, "for the profile another"),
        (replace(GOOD, asked_ms=100.0), "rig.toml", DRIVE, "for 100 ms"),
        (replace(GOOD, asked_ms=50.6), "rig.toml", DRIVE, "for 50.6 ms"),
        (UNSEALED, "rig.toml", DRIVE, "by an earlier version and has no digest; run --prove makes a new one"),
    ],
)
def test_a_proof_counts_for_one_drive_one_profile_and_one_time(
    proved: Proved | None, source: str, drive: Identity, why: str
) -> None:
    found = due(planned(proved, source=source), drive)
    assert (why in found["handle"]) if why else not found


def edited(**link_loss: Any) -> CanopenProfile:
    """The profile with other options for a lost master."""
    return replace(PROFILE, link_loss=replace(PROFILE.link_loss, **link_loss))


@pytest.mark.parametrize(
    "changes",
    [
        {"on_link_loss": "brake"},
        {"node": 2},
        {"channel": "can1"},
        {"profile": edited(abort_connection_option=OptionCode(0x6007, 1))},
        {"profile": edited(abort_connection_option=None)},
        {"profile": edited(fault_reaction_option=OptionCode(0x605E, 2))},
        {"profile": edited(fault_reaction_option=None)},
        {"profile": edited(heartbeat_consumer=None, life_guarding=True)},
        {"profile": replace(PROFILE, torque=replace(PROFILE.torque, mode_of_operation=4))},
        {"profile": replace(PROFILE, setup=SetupSection((WrittenObject(0x1029, DataType.UINT8, 1, 1),)))},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_proof_does_not_outlive_what_was_written_for_it_nor_its_place(changes: dict[str, Any]) -> None:
    assert "changed after the proof was saved" in due(planned(GOOD, **changes))["handle"]


@pytest.mark.parametrize(
    "edit", [{"guard_ms": 50.1}, {"serial": 7}, {"vendor": 7}, {"revision": None}, {"asked_ms": 50.4}, {"digest": "0"}]
)
def test_a_proof_that_was_edited_by_hand_does_not_count(edit: dict[str, Any]) -> None:
    proved = replace(GOOD, **edit)
    assert "changed after the proof was saved" in due(planned(proved), proved.drive)["handle"]


def test_a_failure_that_was_made_a_proof_by_hand_does_not_count() -> None:
    assert due(planned(replace(sealed(FAILED), guard="proved", guard_ms=48.9)))


def test_a_proof_counts_at_each_rate_with_the_same_guard_and_what_is_written_for_it() -> None:
    for rate in (1000.0, 500.0, 100.0):
        assert not due(planned(GOOD, rate=rate))
    assert "is for 50 ms" in due(planned(GOOD, rate=50.0))["handle"]


@pytest.mark.parametrize(
    ("rate", "passes"),
    [(1000.0, (38.0, 72.8)), (100.0, (20.0, 90.8))],
)
def test_a_measured_time_counts_where_a_proof_at_this_rate_would_have_passed(
    rate: float, passes: tuple[float, float]
) -> None:
    """A fifth of 50 ms and two periods less; two periods, 0.4 ms of delay, a tick of 0.4 ms and a question of 20 ms
    more."""
    low, high = passes
    for measured in (low + 0.1, high - 0.1):
        assert not due(planned(sealed(replace(UNSEALED, guard_ms=measured)), rate=rate))
    for beyond in (low - 0.1, high + 0.1):
        assert (
            "are accepted at this rate" in due(planned(sealed(replace(UNSEALED, guard_ms=beyond)), rate=rate))["handle"]
        )
    assert "has no time" in due(planned(sealed(replace(UNSEALED, guard_ms=None)), rate=rate))["handle"]


@pytest.mark.parametrize("drive", [DRIVE, replace(DRIVE, serial=None)])
def test_a_known_failure_is_not_tried_again_on_the_same_drive(drive: Identity) -> None:
    assert not due(planned(FAILED, emergency_stop="power"), drive)
    assert due(planned(FAILED, emergency_stop="power"), replace(DRIVE, serial=7))
    assert due(planned(FAILED, emergency_stop="power"), replace(DRIVE, revision=8)), "its firmware is a new one"


def test_a_known_failure_holds_whatever_else_is_written_to_the_drive() -> None:
    """It permits less, so that nothing is lost by keeping it."""
    braking = planned(replace(FAILED, digest=None), emergency_stop="power", on_link_loss="brake", node=3)
    assert not due(braking)
    assert braking.guards[0].cap


def test_a_brake_is_refused_where_no_object_asks_for_it() -> None:
    planned(GOOD, on_link_loss="brake")
    with pytest.raises(PlanError, match=r'on_link_loss = "brake" needs a drive that can be told .*6007h'):
        planned(GOOD, profile=edited(abort_connection_option=None), on_link_loss="brake")


def test_how_long_a_drive_brakes_is_not_known() -> None:
    """Its ramp is in the drive; the times of causes that the loop answers stay as they are."""
    braking, free = planned(GOOD, on_link_loss="brake"), planned(GOOD)
    for ours, other in zip(braking.deadlines, free.deadlines, strict=True):
        by_guard = "drive watchdog" in other.how
        assert math.isinf(ours.seconds) if by_guard else ours == other
        assert not by_guard or ours.how.endswith("then the drive brakes for an unknown time")


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
    assert "watchdog   test drive has no watchdog that" in explain(plan)
    assert "guard: test drive has no watchdog" in explain(plan)
    words = " ".join(explain(plan).split())
    assert "master killed without end a person who cuts the power" in words
    assert "drive fault or emergency without end the drive by itself after an unknown time" in words
    assert told(plan)["capped"].startswith("test drive has no watchdog")


@pytest.mark.parametrize(
    ("proved", "real", "text"),
    [
        (GOOD, True, "50 ms; 48.9 ms measured on 2026-11-22T12:00:00+01:00, drive with serial number 0xc17b76a7"),
        (
            None,
            True,
            "50 ms (to be tested at zero torque before force is applied: the rig file has no watchdog proof yet)",
        ),
        (None, False, "50 ms (not tested; `run --prove` tests it)"),
    ],
)
def test_a_plan_says_what_it_knows(proved: Proved | None, real: bool, text: str) -> None:
    plan = planned(proved, real=real)
    assert f"\nwatchdog   {text}\n" in explain(plan)
    assert told(plan) == {
        "axis": "handle",
        "guard_ms": 50.0,
        "proved": None
        if proved is None
        else {"guard_ms": 48.9, "date": "2026-11-22T12:00:00+01:00", "serial": 0xC17B76A7},
        "unproved": None if proved else "the rig file has no watchdog proof yet",
        "capped": None,
        "emergency_stop": None,
    }


def test_a_rig_file_holds_a_proof_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    table = 'serial = 0xC17B76A7\nguard = "proved"\nguard_ms = 48.9\nasked_ms = 50.0\nprofile = "test_drive"\n'
    table += f'vendor = 0xFB\nproduct = 0x6050\nrevision = 7\ndigest = "{GOOD.digest}"\n'
    path.write_text(rig_text() + f'[axis.handle.proved]\n{table}date = "{GOOD.date}"\n', encoding="utf-8")
    assert load_rig(path).axis["handle"].proved == GOOD
    assert load_rig(path).unproved().axis["handle"].proved is None


def test_a_measured_time_that_no_proof_accepts_is_refused_with_file_key_value_and_what_is_expected(
    tmp_path: Path,
) -> None:
    path = tmp_path / "rig.toml"
    table = '[axis.handle.proved]\nguard = "proved"\n{}asked_ms = 50.0\nprofile = "test_drive"\ndate = "today"\n'
    for line, shown in (("guard_ms = 5000\n", "5000"), ("guard_ms = 19\n", "19"), ("", "missing")):
        path.write_text(rig_text() + table.format(line), encoding="utf-8")
        expected = f"axis.handle.proved.guard_ms.*: {shown}; expected from 20 to 150 ms for asked_ms = 50"
        with pytest.raises(RigError, match=expected) as refused:
            load_rig(path)
        assert str(path) in str(refused.value)
    for line in ("guard_ms = 20\n", "guard_ms = 150\n"):
        path.write_text(rig_text() + table.format(line), encoding="utf-8")
        assert load_rig(path).axis["handle"].proved is not None


@pytest.mark.parametrize("table", ['guard = "none"', 'guard = "proved"\nguard_ms = "soon"', "guard = 3"])
def test_other_faults_of_a_proof_are_those_of_the_schema(table: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    whole = f'[axis.handle.proved]\n{table}\nasked_ms = 50.0\nprofile = "test_drive"\ndate = "today"\n'
    path.write_text(rig_text() + whole, encoding="utf-8")
    if "none" in table:
        assert load_rig(path).axis["handle"].proved is not None
    else:
        with pytest.raises(RigError) as refused:
            load_rig(path)
        assert "for asked_ms" not in str(refused.value)


def test_a_cap_of_the_force_is_told_with_its_value_and_its_reason() -> None:
    stopped = rig_of(WALL, emergency_stop="power")
    axis = plan_of(rig=stopped, profile=UNGUARDED).axes[0]
    assert axis.limits.effort == pytest.approx(0.05 * axis.rated_effort)
    told = "force limited to 2.51 N (5 % of rated torque): test drive has no watchdog that switches the "
    assert axis.cap == f"{told}torque off (profile)"
    mute = replace(PROFILE, torque=replace(PROFILE.torque, echo="none"))
    why = "test drive does not return its set-points (torque.echo of its profile)"
    assert plan_of(profile=mute).axes[0].cap.endswith(why)
    unknown = plan_of(rig=rig_of(WALL, inertia=None)).axes[0]
    assert unknown.cap.endswith("rated torque): no limit is known, because the rig leaves out inertia")


def test_a_limit_of_the_rig_below_the_cap_is_no_cap() -> None:
    assert plan_of().axes[0].cap == ""
    low = rig_of(WALL, emergency_stop="power", limits=Limits(effort=1.0))
    assert plan_of(rig=low, profile=UNGUARDED).axes[0].cap == ""

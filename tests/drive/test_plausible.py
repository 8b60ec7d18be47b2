"""Values that no bench for a hand has are refused with their range, and with the unit that somebody may have meant."""

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

from haptic_fieldbus.drive.fields import Ranged
from haptic_fieldbus.drive.plausible import OF_HANDLE, RANGES, implausible
from haptic_fieldbus.drive.rig import Limits, Rig, RigAxis, RotaryMechanism, default_axis
from haptic_fieldbus.errors import RigError
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import check_rig, load_rig
from haptic_fieldbus.signals import Workspace

RIG = """\
[bus.can0]
interface = "socketcan"
channel = "can0"
[axis.handle]
bus = "can0"
node = 5
profile = "maxon_epos4"
{axis}
[axis.handle.mechanism]
{mechanism}
[axis.handle.limits]
{limits}
"""
AXIS = {
    "rated_torque": 0.4,
    "torque_constant": 0.05,
    "rated_current": 8.0,
    "peak_current": 20.0,
    "inertia": 4e-5,
    "viscous_damping": 1e-4,
    "coulomb_friction": 2e-3,
    "encoder_counts_per_revolution": 4096,
}
LINEAR = {"kind": '"linear"', "metres_per_revolution": 0.05}
ROTARY = {"kind": '"rotary"', "gear_ratio": 1.0}


def faults(tmp_path: Path, axis: Any = (), mechanism: Any = LINEAR, limits: Any = ()) -> list[str]:
    """The faults of a rig file with these keys."""
    parts = [AXIS | dict(axis), dict(mechanism), dict(limits)]
    tables = ["\n".join(f"{key} = {value}" for key, value in part.items()) for part in parts]
    path = tmp_path / "rig.toml"
    path.write_text(RIG.format(axis=tables[0], mechanism=tables[1], limits=tables[2]), encoding="utf-8")
    try:
        load_rig(path)
    except RigError as error:
        return [str(fault) for fault in error.faults]
    return []


def test_a_bench_that_exists_has_no_fault(tmp_path: Path) -> None:
    assert faults(tmp_path) == []
    assert faults(tmp_path, mechanism=ROTARY) == []


@pytest.mark.parametrize(
    ("axis", "mechanism", "limits", "key", "words"),
    [
        ({"rated_torque": 400}, LINEAR, {}, "rated_torque", "400; expected from 1e-5 to 50 N·m"),
        ({"rated_torque": 400}, LINEAR, {}, "rated_torque", "is this in mN·m? It would be 0.4 N·m"),
        ({"inertia": 1e-12}, LINEAR, {}, "inertia", "1e-12; expected from 1e-9 to 1 kg·m²"),
        ({"inertia": 400}, LINEAR, {}, "inertia", "is this in g·cm²? It would be 4e-5 kg·m²"),
        ({"torque_constant": 50}, LINEAR, {}, "torque_constant", "is this in mN·m/A? It would be 0.05 N·m/A"),
        ({"rated_current": 8000}, LINEAR, {}, "rated_current", "is this in mA? It would be 8 A"),
        ({"viscous_damping": 100}, LINEAR, {}, "viscous_damping", "is this in mN·m·s/rad? It would be 0.1 N·m·s/rad"),
        ({"coulomb_friction": 2.0}, LINEAR, {}, "coulomb_friction", "expected less than rated_torque, 0.4 N·m"),
        ({"coulomb_friction": 2.0}, LINEAR, {}, "coulomb_friction", "is this in mN·m?"),
        ({"coulomb_friction": '"2 N·m"'}, LINEAR, {}, "coulomb_friction", "is this in mN·m?"),
        ({"encoder_counts_per_revolution": 2}, LINEAR, {}, "encoder_counts", "is this in lines of four counts each?"),
        ({}, LINEAR | {"metres_per_revolution": 50}, {}, "metres_per_revolution", "in mm? It would be 0.05 m"),
        ({}, ROTARY | {"gear_ratio": 5000.0}, {}, "gear_ratio", "5000.0; expected from 0.01 to 1000 ("),
        ({}, LINEAR, {"position": "[-100.0, 100.0]"}, "position", "expected from -5 to 5 m"),
        ({}, ROTARY, {"position": "[-180.0, 180.0]"}, "position", "is this in degrees? It would be -3.14 rad"),
        ({}, LINEAR, {"effort": 20_000.0}, "effort", "is this in mN? It would be 20 N"),
        ({"torque_constant": 5.0}, LINEAR, {}, "torque_constant", "within a factor of 10 of rated_torque / rated_c"),
    ],
)  # fmt: skip
def test_a_value_that_no_bench_has_is_refused_with_its_range_and_unit(
    tmp_path: Path, axis: Any, mechanism: Any, limits: Any, key: str, words: str
) -> None:
    (fault,) = faults(tmp_path, axis, mechanism, limits)
    assert key in fault.partition(";")[0]
    assert fault.startswith("line ")
    assert words in fault


def test_a_torque_constant_that_is_a_thousand_times_too_large_is_asked_for_its_unit(tmp_path: Path) -> None:
    (fault,) = faults(tmp_path, {"rated_torque": 4e-3, "rated_current": 0.5, "torque_constant": 8.0})
    assert "is this in mN·m/A?" in fault


@pytest.mark.parametrize(
    ("axis", "known"),
    [
        ({"rated_torque": 400.0, "torque_constant": 0.5, "rated_current": 200.0}, "rated_torque"),
        ({"inertia": 30.0}, "inertia"),
        ({"torque_constant": 5.0}, "torque_constant"),
    ],
)
def test_who_knows_better_says_so(tmp_path: Path, axis: Any, known: str) -> None:
    assert len(faults(tmp_path, axis)) == 1, "and not a second one for what follows from it"
    assert faults(tmp_path, axis | {"i_know": f'["{known}"]'}) == []


def test_no_knowledge_excuses_friction_above_rated_torque(tmp_path: Path) -> None:
    (fault,) = faults(tmp_path, {"coulomb_friction": 0.5, "i_know": '["coulomb_friction"]'})
    assert "otherwise nothing moves" in fault
    assert "is this" not in faults(tmp_path, {"coulomb_friction": 0.5, "rated_torque": 1e-4, "rated_current": 2e-2})[0]


def test_an_unknown_key_in_i_know_is_a_fault(tmp_path: Path) -> None:
    (fault,) = faults(tmp_path, {"i_know": '["inertai"]'})
    assert '"inertia"' in fault


def test_all_values_out_of_range_are_told_at_once_and_those_of_a_wrong_type_once(tmp_path: Path) -> None:
    found = faults(tmp_path, {"rated_torque": 400, "inertia": "true"}, {"kind": '"linaer"'}, {"speed": 1e6})
    assert ["rated_torque" in fault for fault in found].count(True) == 1
    assert ["inertia" in fault for fault in found].count(True) == 1
    assert not any("limits.speed" in fault for fault in found), "its unit depends on the mechanism"


def test_each_key_with_a_range_can_be_excused_and_each_that_can_has_one() -> None:
    for ranges in OF_HANDLE.values():
        assert set(get_args(Ranged)) == {*RANGES, *ranges}


@pytest.mark.parametrize("workspace", Workspace)
def test_both_ends_of_each_range_are_in_it_and_what_lies_beyond_is_not(workspace: Workspace) -> None:
    for key, each in (RANGES | OF_HANDLE[workspace]).items():
        assert each.low < each.high
        assert list(implausible({key: each.low}, workspace)) == list(implausible({key: each.high}, workspace)) == []
        for beyond in (each.low - 1e-12, 1.001 * each.high):
            ((found, message),) = implausible({key: beyond}, workspace)
            assert found == key
            assert f'i_know = ["{key}"]' in message


def test_every_slip_leads_from_beyond_the_range_into_it() -> None:
    for each in (*RANGES.values(), *(one for ranges in OF_HANDLE.values() for one in ranges.values())):
        assert each.why
        for size, unit in each.slips:
            assert unit
            value = (0.9 * each.high if size < 1.0 else each.low) / size
            assert not each.has(value)
            assert each.has(size * value)


def bench(**changes: Any) -> RigAxis:
    return replace(default_axis(Workspace.LINEAR, bus="b", node=1, profile="maxon_epos4"), **changes)


def test_a_rig_that_was_made_in_python_is_judged_alike() -> None:
    rig = load(Task("wall")).rig
    wrong = replace(rig, axis={name: replace(axis, inertia=400.0) for name, axis in rig.axis.items()})
    with pytest.raises(RigError, match=r"the rig: axis.handle.inertia: 400.0; expected from 1e-9 to 1 kg·m²"):
        load(Task("wall", rig=wrong))
    known = replace(wrong, axis={name: replace(axis, i_know=("inertia",)) for name, axis in wrong.axis.items()})
    assert load(Task("wall", rig=known)).rig.axis["handle"].inertia == 400.0


def test_all_faults_of_a_rig_that_was_made_in_python_are_told_at_once() -> None:
    rig = load(Task("wall")).rig
    wrong = {name: replace(axis, inertia=400.0, limits=Limits(position=(0.1, -0.1))) for name, axis in rig.axis.items()}
    with pytest.raises(RigError) as refused:
        check_rig(replace(rig, axis=wrong))
    assert [fault.key for fault in refused.value.faults] == ["axis.handle.limits.position", "axis.handle.inertia"]


def test_what_is_unknown_has_no_range() -> None:
    unknown = bench(rated_torque=None, inertia=None, torque_constant=None, limits=Limits())
    for axis in (unknown, replace(unknown, mechanism=RotaryMechanism("rotary", 3.0))):
        check_rig(Rig({"b": CanSection("socketcan", "can0")}, {"handle": axis}))

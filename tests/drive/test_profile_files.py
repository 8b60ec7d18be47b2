"""Profile files: the shipped ones hold, and each way to be wrong is told."""

import copy
import math
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.drive.rig import RATED_TORQUE_UNITS, TORQUE_UNITS, VELOCITY_UNITS, velocity_step
from haptic_fieldbus.errors import DocumentError, ProfileError, UsageError
from haptic_fieldbus.protocols import catalogue
from haptic_fieldbus.protocols.catalogue import (
    load_profile,
    profile_folder,
    profile_names,
    profile_schema,
    profile_summaries,
)
from haptic_fieldbus.signals import Signal
from tests.builders import canopen, shipped
from tests.cases import every

CHECKOUT = Path(__file__).resolve().parents[2]

COMPLETE = """\
schema = 1
[drive]
vendor = "acme"
model = "Push 1"
protocol = "canopen"
evidence = "hardware"
[torque]
mode_of_operation = 10
target = { object = 0x6071, type = "int16", unit = "permille_of_rated_torque" }
[position]
actual = { object = 0x6064, type = "int32", unit = "counts" }
[pdo]
tpdo_types = [1]
rpdo_types = [255]
[link_loss]
abort_connection_option = { object = 0x6007, value = 2 }
[timing]
torque_bandwidth = 1000
control_period = 0.0
[sources]
torque = "measured"
position = "measured"
pdo = "measured"
link_loss = "measured"
timing = "measured"
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "push1.toml"
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(folder: Path, *replacements: tuple[str, str]) -> list[str]:
    """All faults of the complete profile after replacements."""
    text = COMPLETE
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    with pytest.raises(ProfileError) as caught:
        load_profile(write(folder, text))
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize("name", profile_names())
def test_a_shipped_profile_loads_by_name_and_by_path(name: str) -> None:
    by_name = load_profile(name)
    assert by_name == load_profile(profile_folder() / f"{name}.toml")
    assert by_name.name == name
    assert Path(by_name.source).is_file()


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_profile_offers_what_a_wall_needs(name: str) -> None:
    profile = canopen(name)
    needed = {Signal.STATUSWORD, Signal.POSITION, Signal.CONTROLWORD, Signal.TARGET_TORQUE}
    assert needed <= set(profile.offers())
    rated = profile.torque.rated
    assert rated is None or rated.unit in RATED_TORQUE_UNITS
    assert profile.torque.target.unit in TORQUE_UNITS


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_profile_leaves_the_shaft_free_when_the_link_is_lost(name: str) -> None:
    """6007h = 2 disable voltage, 605Eh = 0 disable without a ramp (CiA 402-2)."""
    profile = canopen(name)
    link_loss = profile.link_loss
    assert profile.guarded or not profile.drive.usable
    assert (link_loss.heartbeat_consumer == 0x1016) is not link_loss.life_guarding
    abort, fault = link_loss.abort_connection_option, link_loss.fault_reaction_option
    assert abort is None or (abort.object, abort.value) == (0x6007, 2)
    assert fault is None or (fault.object, fault.value) == (0x605E, 0)
    # Without either object, that it lets go is an assumption, which is told as one.
    assert link_loss.reacts is (abort is None and fault is None and profile.drive.usable)
    assert not link_loss.reacts or "link_loss.reacts" in profile.assumed


@pytest.mark.parametrize("name", profile_names())
def test_a_shipped_profile_says_plainly_what_is_assumed(name: str) -> None:
    sources = load_profile(name).sources
    assert "ASSUMED" in sources["timing.torque_bandwidth"]


def test_summaries_have_the_keys_of_the_command_line() -> None:
    summaries = profile_summaries()
    assert list(summaries) == profile_names()
    assert summaries["maxon_epos4"] == {
        "name": "maxon_epos4",
        "vendor": "maxon",
        "model": "EPOS4",
        "protocol": "canopen",
        "usable": True,
        "evidence": "vendor-data",
        "source": str(profile_folder() / "maxon_epos4.toml"),
    }


def test_an_unknown_name_is_answered_with_the_nearest_ones() -> None:
    with pytest.raises(UsageError) as caught:
        load_profile("maxon_epos5")
    assert str(caught.value).startswith('no profile "maxon_epos5"; nearest: maxon_epos4')
    assert str(caught.value).endswith(". To list them: haptic-fieldbus profiles list")


def test_profiles_inside_the_package_come_before_those_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "site" / "haptic_fieldbus"
    (package / "protocols").mkdir(parents=True)
    monkeypatch.setattr(catalogue, "__file__", str(package / "protocols" / "folders.py"))
    assert profile_folder() == tmp_path / "site" / "profiles"
    (package / "profiles").mkdir()
    assert profile_folder() == package / "profiles"


def test_a_complete_profile_has_its_name_from_the_file_and_defaults(tmp_path: Path) -> None:
    path = write(tmp_path, COMPLETE)
    profile = canopen(str(path))
    assert (profile.name, profile.source, profile.title) == ("push1", str(path), "acme Push 1")
    assert profile.identity.vendor_id is None
    assert profile.timing.torque_bandwidth == 1000.0
    assert profile.pdo.tpdo_types == (1,)
    assert profile.torque.target.type is DataType.INT16


def test_five_different_faults_are_told_at_once_with_their_lines(tmp_path: Path) -> None:
    faults = faults_of(
        tmp_path,
        ('protocol = "canopen"', 'protocol = "canopn"'),
        ("mode_of_operation = 10", "mode_of_operation = 10.0"),
        ('type = "int32"', 'type = "int23"'),
        ("tpdo_types = [1]", "tpdo_typs = [1]"),
        ("torque_bandwidth = 1000", "torque_bandwidth = -5"),
    )
    assert faults == [
        'line 5: drive.protocol: "canopn"; expected "canopen" or "modbus"',
        "line 8: torque.mode_of_operation: 10.0; expected a whole number from -128 to 127",
        'line 11: position.actual.type: "int23"; expected "int8", "int16", "int32", "uint8", "uint16" or "uint32"'
        "; nearest: int32, uint32, int8",
        "line 12: pdo.tpdo_types: missing; expected a list of at least 1, each a whole number from 0 to 255",
        "line 13: pdo.tpdo_typs: unknown key; nearest: tpdo_types, rpdo_types, tpdos",
        "line 18: timing.torque_bandwidth: -5; expected a number from 0.001 to 1e9",
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("schema = 1", "schema = 2", "line 1: schema: 2; expected 1"),
        ("schema = 1", "schema = true", "line 1: schema: true; expected a whole number"),
        ("schema = 1", "schema = 1.0", "line 1: schema: 1.0; expected a whole number"),
        (
            "schema = 1",
            'schema = 1\nname = "x"',
            "line 2: name: unknown key",
        ),
        (
            'type = "int16"',
            'type = "uint16"',
            'line 9: torque.target.type: "uint16"; expected "int16" or "int32"',
        ),
        ('type = "int16"', 'type = "int8"', 'line 9: torque.target.type: "int8"; expected "int16" or "int32"'),
        ('type = "int32"', 'type = "int16"', 'line 11: position.actual.type: "int16"; expected "int32"'),
        (', unit = "counts"', "", 'line 11: position.actual.unit: missing; expected "counts" or "0.1 deg"'),
        (
            'unit = "permille_of_rated_torque"',
            'unit = "A"',
            'line 9: torque.target.unit: "A"; expected "permille_of_rated_torque" or "mA" or '
            '"permille_of_rated_current" or "peak_current/32760" or "peak_current/32760/65536"',
        ),
        (
            "[position]",
            'rated = { object = 0x6076, type = "uint32", unit = "Nm" }\n[position]',
            'line 10: torque.rated.unit: "Nm"; expected "µN·m" or "mN·m" or "N·m"',
        ),
        (
            "[position]",
            'actual = { object = 0x6071, type = "int16", unit = "permille_of_rated_torque" }\n[position]',
            "line 10: torque.actual.object: 0x6071 is already used by torque.target; expected another object",
        ),
        (
            "[position]",
            'actual = { object = 0x6877, type = "int16", unit = "permille_of_rated_torque" }\n[position]',
            "line 10: torque.actual.object: 0x6877 is of a second axis; only the first can be driven",
        ),
        (
            "[timing]",
            "fault_reaction_option = { object = 0x6007, value = 0 }\n[timing]",
            "line 17: link_loss.fault_reaction_option.object: 0x6007 is already used by "
            "link_loss.abort_connection_option"
            "; expected another object",
        ),
        (
            'timing = "measured"',
            '"timing.control_period" = "measured"',
            'line 18: timing.torque_bandwidth: no source; expected an entry "timing.torque_bandwidth" in [sources]',
        ),
        (
            'torque = "measured"',
            '"torque.mode_of_operation" = "measured"',
            'line 9: torque.target: no source; expected an entry "torque.target" in [sources]',
        ),
        (
            'position = "measured"',
            '"position.actual.object" = "measured"\n"position.actual.type" = "measured"',
            'line 11: position.actual.unit: no source; expected an entry "position.actual.unit" in [sources]',
        ),
        (
            'pdo = "measured"',
            'pdo = "measured"\n"pdo.tpod_types" = "measured"',
            'line 24: sources."pdo.tpod_types": source of an unknown key; nearest: pdo.tpdo_types, pdo.rpdo_types',
        ),
        ('pdo = "measured"', 'pdo = ""', 'line 23: sources.pdo: ""; expected a non-empty string'),
        (
            'evidence = "hardware"',
            'evidence = "hardware"\nusable = false',
            'line 7: drive.usable: false without a reason; expected an entry "drive.usable" in [sources]',
        ),
    ],
)
def test_a_rule_across_keys_is_told(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert faults_of(tmp_path, (old, new)) == [message]


POSITION = '[position]\nactual = { object = 0x6064, type = "int32", unit = "counts" }\n'
VELOCITY = '[velocity]\nactual = { object = 0x606C, type = "int32", unit = "rpm" }\n'
SOURCE, OTHER_SOURCE = 'position = "measured"', 'velocity = "measured"'


def test_a_drive_may_offer_velocity_beside_its_position_or_alone(tmp_path: Path) -> None:
    alone = COMPLETE.replace(POSITION, VELOCITY).replace(SOURCE, OTHER_SOURCE)
    both = COMPLETE.replace(POSITION, POSITION + VELOCITY).replace(SOURCE, f"{SOURCE}\n{OTHER_SOURCE}")
    offered = {Signal.POSITION, Signal.VELOCITY}
    assert load_profile(write(tmp_path, alone)).offers().keys() & offered == {Signal.VELOCITY}
    found = canopen(write(tmp_path, both)).entries()
    assert found.keys() >= offered
    assert found[Signal.VELOCITY] == ObjectEntry(0x606C, DataType.INT32, unit="rpm")


def test_a_drive_that_offers_neither_is_refused_in_one_sentence(tmp_path: Path) -> None:
    assert faults_of(tmp_path, (POSITION, ""), (SOURCE, "")) == [
        "position: missing, like [velocity]; expected position.actual, velocity.actual or both"
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'unit = "rpm"',
            'unit = "rad/s"',
            'line 11: velocity.actual.unit: "rad/s"; expected '
            '"rpm" or "0.1 rpm" or "0.01 rpm" or "0.001 rpm" or "counts/s"',
        ),
        ('"int32", unit = "rpm"', '"int16", unit = "rpm"', 'line 11: velocity.actual.type: "int16"; expected "int32"'),
        (OTHER_SOURCE, "", 'line 11: velocity.actual: no source; expected an entry "velocity.actual" in [sources]'),
        (
            "0x606C",
            "0x6071",
            "line 11: velocity.actual.object: 0x6071 is already used by torque.target; expected another object",
        ),
    ],
)
def test_a_velocity_is_checked_as_a_position_is(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert faults_of(tmp_path, (POSITION, VELOCITY), (SOURCE, OTHER_SOURCE), (old, new)) == [message]


@pytest.mark.parametrize(
    ("unit", "turn"),
    [("rpm", 60), ("0.1 rpm", 600), ("0.01 rpm", 6_000), ("0.001 rpm", 60_000), ("counts/s", 4096)],
)
def test_a_turn_a_second_is_so_many_steps_of_velocity(unit: str, turn: int) -> None:
    assert turn * velocity_step(unit, 4096) == pytest.approx(2 * math.pi)


def test_every_unit_of_velocity_has_its_length() -> None:
    assert len({velocity_step(unit, 4096) for unit in VELOCITY_UNITS}) == len(VELOCITY_UNITS) == 5


def test_a_faulty_value_without_a_source_is_told_both(tmp_path: Path) -> None:
    assert faults_of(tmp_path, ("control_period = 0.0", "control_period = -1"), ('timing = "measured"', "")) == [
        'line 18: timing.torque_bandwidth: no source; expected an entry "timing.torque_bandwidth" in [sources]',
        "line 19: timing.control_period: -1; expected a number from 0 to 1e6",
        'line 19: timing.control_period: no source; expected an entry "timing.control_period" in [sources]',
    ]


def test_an_unknown_key_needs_no_source(tmp_path: Path) -> None:
    assert faults_of(
        tmp_path, ("control_period = 0.0", "control_period = 0.0\nx = 1"), ('timing = "measured"', "")
    ) == [
        'line 18: timing.torque_bandwidth: no source; expected an entry "timing.torque_bandwidth" in [sources]',
        'line 19: timing.control_period: no source; expected an entry "timing.control_period" in [sources]',
        "line 20: timing.x: unknown key; known: control_period, control_tick, enabling_timeout, "
        "encoder_latency, mode_change_timeout, torque_bandwidth",
    ]


def test_a_key_of_a_simulated_object_that_names_none_is_told(tmp_path: Path) -> None:
    table = '[simulation.objects]\n"60G7" = { absent = true }\n"1400-1403:05" = { absent = true }\n[sources]'
    assert faults_of(tmp_path, ("[sources]", table), ('torque = "measured"', 'torque = "m"\nsimulation = "m"')) == [
        'line 21: simulation.objects.60G7: no object; expected hexadecimal numbers or ranges as in "6007", "60C2:01" '
        'or "1400-1403:05"'
    ]


def test_a_section_that_is_missing_is_told_without_a_line(tmp_path: Path) -> None:
    assert faults_of(tmp_path, ("[timing]\ntorque_bandwidth = 1000\ncontrol_period = 0.0\n", "")) == [
        "timing: missing; expected a table with torque_bandwidth, control_period, mode_change_timeout, "
        "control_tick, encoder_latency and enabling_timeout"
    ]


def test_a_source_may_say_why_a_value_is_left_out(tmp_path: Path) -> None:
    text = COMPLETE + '"link_loss.heartbeat_consumer" = "the EDS has no 1016h"\n'
    assert canopen(write(tmp_path, text)).link_loss.heartbeat_consumer is None


def test_a_profile_that_is_not_usable_loads_whatever_its_units(tmp_path: Path) -> None:
    text = (
        COMPLETE.replace('evidence = "hardware"', 'evidence = "hardware"\nusable = false')
        .replace('"permille_of_rated_torque"', '"mA"')
        .replace("[sources]", '[sources]\n"drive.usable" = "torque in mA: no rated current known"')
    )
    assert not load_profile(write(tmp_path, text)).drive.usable


@every("old", ['type = "int16"', "object = 0x6071", "value = 2", "[1]", '"canopen"', '"measured"'])
@every("new", ["[[1]]", "{ x = 1 }", "true", "nan", "1979-05-27", "[]"])
def test_a_value_of_any_other_kind_is_a_fault(tmp_path: Path, old: str, new: str) -> None:
    key, equals, _ = old.rpartition("=")
    path = write(tmp_path, COMPLETE.replace(old, f"{key}{equals} {new}"))
    with pytest.raises(ProfileError):
        load_profile(path)


@given(
    st.text()
    | st.text(alphabet='drivetoqu_[]{}=".\n0x')
    | st.lists(st.sampled_from(COMPLETE.splitlines())).map("\n".join)
)
def test_garbage_raises_nothing_but_a_document_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = write(tmp_path_factory.getbasetemp(), text)
    with pytest.raises(DocumentError) as caught:
        load_profile(path)
    assert caught.value.faults


def test_every_key_of_the_schema_is_documented() -> None:
    readme = (CHECKOUT / "profiles" / "README.md").read_text(encoding="utf-8")
    schema = profile_schema()
    for section, node in schema["properties"].items():
        assert f"`{section}" in readme or f"[{section}]" in readme
        reference = str(node.get("$ref", "")).rpartition("/")[2]
        for key in schema["$defs"].get(reference, {}).get("properties", {}):
            assert f"`{section}.{key}`" in readme, f"{section}.{key}"


@pytest.mark.parametrize("name", profile_names())
def test_a_shipped_profile_is_plain_toml(name: str) -> None:
    data = tomllib.loads((profile_folder() / f"{name}.toml").read_text(encoding="utf-8"))
    assert data["schema"] == 1


def leaves(table: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    items = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    if not items:
        yield path
    for key, value in items:
        yield from leaves(value, (*path, key))


@pytest.mark.thorough("loads a profile for each value of a file", quick=("generic_cia402",))
@pytest.mark.parametrize("name", ["generic_cia402_modbus", "maxon_epos2", *profile_names()])
def test_a_value_of_any_wrong_type_is_a_fault_and_no_other_error(name: str, tmp_path: Path) -> None:
    whole = tomllib.loads((profile_folder() / f"{name}.toml").read_text(encoding="utf-8"))
    for path in [each for each in leaves(whole) if each[0] != "sources"]:
        for wrong in (lambda value: [value], lambda value: {"a": value}, lambda value: datetime(2026, 11, 1)):
            changed = copy.deepcopy(whole)
            table: Any = changed
            for step in path[:-1]:
                table = table[step]
            table[path[-1]] = wrong(table[path[-1]])
            with suppress(ProfileError):
                load_profile(write(tmp_path, tomlkit.dumps(changed)))

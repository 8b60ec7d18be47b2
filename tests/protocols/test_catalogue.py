"""Schemas of the files of each protocol, for editors."""

from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.drive.rig import Limits, Rig
from haptic_fieldbus.errors import ProfileError, RigError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import (
    bus_schema,
    check_rig,
    known_names,
    load_profile,
    load_rig,
    profile_file,
    profile_folder,
    profile_schema,
    profile_summaries,
    rig_schema,
)
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.protocols.registry import BUILT_IN, protocol_named
from haptic_fieldbus.signals import Signal
from tests.builders import PROFILE, WALL, rig_of


@pytest.mark.parametrize("protocol", BUILT_IN)
def test_a_profile_has_the_sections_of_its_protocol(protocol: str) -> None:
    schema = profile_schema(protocol)
    assert {"drive", "identity"} <= schema["properties"].keys()
    assert "name" not in schema["properties"], "a profile is named by its file"


def test_a_bus_of_a_rig_is_one_of_any_protocol_of_ours() -> None:
    assert rig_schema()["$defs"]["BusSection"] == {"anyOf": [bus_schema(protocol) for protocol in BUILT_IN]}
    assert "bitrate" in bus_schema("canopen")["properties"]


def test_a_protocol_that_nobody_knows_is_refused_with_the_nearest() -> None:
    with pytest.raises(UsageError, match='no protocol "canopne"; nearest: canopen'):
        protocol_named("canopne")


def test_the_summaries_hold_the_faults_of_a_broken_profile_beside_the_others(tmp_path: Path) -> None:
    (tmp_path / "broken.toml").write_text("schema = 1\n", encoding="utf-8")
    summaries = profile_summaries(tmp_path)
    assert isinstance(summaries["broken"], ProfileError)
    assert isinstance(summaries["maxon_epos4"], dict)


def test_a_proof_of_set_points_needs_the_object_that_it_names(tmp_path: Path) -> None:
    text = (profile_folder() / "maxon_epos4.toml").read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace('echo = "actual"', 'echo = "demand"'), encoding="utf-8")
    with pytest.raises(ProfileError, match=r'"demand" without torque\.demand'):
        load_profile(path)


def test_a_drive_has_one_guard_at_most(tmp_path: Path) -> None:
    text = (profile_folder() / "maxon_epos4.toml").read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("[link_loss]\n", "[link_loss]\nlife_guarding = true\n"), encoding="utf-8")
    line = text[: text.index("[link_loss]")].count("\n") + 2
    words = (
        rf"mine.toml: line {line}: link_loss\.life_guarding: true together with link_loss\.heartbeat_consumer; expected"
    )
    with pytest.raises(ProfileError, match=words):
        load_profile(path)


def test_an_echo_that_is_asked_needs_no_object_of_its_own(tmp_path: Path) -> None:
    text = (profile_folder() / "maxon_epos4.toml").read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(text.replace('echo = "actual"', 'echo = "asked"'), encoding="utf-8")
    assert load_profile(path).echo is Signal.TARGET_ASKED


def test_a_folder_of_profiles_must_be_there_and_have_a_name(tmp_path: Path) -> None:
    for folder, reason in ((tmp_path / "missing", "No such file"), ("", "no name")):
        with pytest.raises(UsageError, match=f"expected a folder of drive profiles: {reason}"):
            known_names(folder)


def test_an_own_profile_is_a_file_and_has_a_name_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(UsageError, match="is not a file"):
        profile_file("folder", tmp_path)
    (tmp_path / "maxon_epos4.toml").write_text("schema = 1\n", encoding="utf-8")
    with pytest.raises(UsageError, match=r"both .* and the shipped"):
        profile_file("maxon_epos4", tmp_path)


def test_a_shipped_profile_is_read_once_and_a_file_of_ones_own_each_time(tmp_path: Path) -> None:
    assert load_profile("maxon_epos4") is load_profile("maxon_epos4")
    own = tmp_path / "own.toml"
    own.write_bytes(profile_file("maxon_epos4").read_bytes())
    first = load_profile(own)
    own.write_text(own.read_text(encoding="utf-8").replace("[drive]", '[drive]\nfile = "changed"'), encoding="utf-8")
    with pytest.raises(ProfileError):
        load_profile(own)
    assert first.drive == load_profile("maxon_epos4").drive


MADE = rig_of(WALL)
CAN = CanSection("slcan", "/dev/ttyACM0", arguments={"ttyBaudrate": 115_200})


def test_a_rig_made_in_python_is_held_to_the_rules_of_its_file() -> None:
    handle = MADE.axis["handle"]
    check_rig(MADE)
    check_rig(Rig({"bus": CAN}, {"handle": replace(handle, profile=f"{PROFILE.name} of handle")}))
    check_rig(Rig({"bus": ModbusSection("modbus-tcp", "10.0.0.2")}, {"handle": replace(handle, node=255)}))
    wrong = replace(handle, inertia=-1.0, node=200, limits=Limits(position=(0.1, -0.1)))
    other = replace(handle, bus="nowhere", limits=None)  # type: ignore[arg-type]
    with pytest.raises(RigError) as refused:
        check_rig(Rig({"bus": replace(CAN, bitrate=1)}, {"handle": wrong, "other": other}))
    assert [fault.key for fault in refused.value.faults] == [
        "bus.bus.bitrate",
        "axis.handle.inertia",
        "axis.handle.node",
        "axis.handle.limits.position",
        "axis.other.limits",
        "axis.other.bus",
    ]


def test_a_rig_is_loaded_from_a_path() -> None:
    with pytest.raises(TypeError, match=r"^path: expected that of a rig file, not 3 \(int\)$"):
        load_rig(3)  # type: ignore[arg-type]

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.eds import EdsType, eds_text, load_eds
from haptic_fieldbus.protocols.catalogue import load_profile, profile_folder, profile_names
from tests.cli.command import Command
from tests.eds.sheets import changed

KEYS = {"name", "vendor", "model", "protocol", "usable", "evidence", "source"}


def test_the_list_names_every_shipped_profile(command: Command) -> None:
    finished = command("profiles", "list")
    assert finished.status == 0
    assert [line.split()[0] for line in finished.out.splitlines()] == ["name", *profile_names()]
    assert all(line == line.rstrip() for line in finished.out.splitlines())


def test_the_json_list_has_the_keys_of_the_contract(command: Command) -> None:
    profiles = json.loads(command("profiles", "list", "--json").out)["profiles"]
    assert [profile["name"] for profile in profiles] == profile_names()
    assert all(set(profile) == KEYS for profile in profiles)
    assert all(profile["protocol"] in ("canopen", "modbus") for profile in profiles)


@pytest.mark.parametrize("name", profile_names())
def test_a_profile_is_shown_with_the_source_of_each_value(name: str, command: Command) -> None:
    finished = command("profiles", "show", name)
    assert finished.status == 0
    profile = load_profile(name)
    assert profile.title in finished.out
    for source in profile.sources:
        section, _, key = source.partition(".")
        # A table that the drive does not have has sources that tell why.
        if key and getattr(getattr(profile, section), key.partition(".")[0], None) not in (None, ()):
            assert profile.sources[source] in finished.out
    assert "default" not in [line.strip() for line in finished.out.splitlines()]


def test_objects_are_shown_in_hexadecimal(command: Command) -> None:
    shown = command("profiles", "show", "maxon_epos4").out
    assert "6071h int16 permille_of_rated_torque" in shown
    assert "6007h = 2" in shown
    assert "1016h" in shown


def test_registers_are_shown_in_hexadecimal(command: Command) -> None:
    shown = command("profiles", "show", "simplex_motion").out
    assert "00C7h int32 counts" in shown
    assert "FFFFh 0028h operation enabled 0028h" in shown
    assert "setup  " in shown


def test_the_json_object_of_a_profile_is_the_profile(command: Command) -> None:
    shown = json.loads(command("profiles", "show", "maxon_epos4", "--json").out)
    assert shown["name"] == "maxon_epos4"
    assert shown["torque"]["target"] == {
        "object": 0x6071,
        "type": "int16",
        "subindex": 0,
        "unit": "permille_of_rated_torque",
    }
    assert shown["pdo"]["tpdo_types"] == [1, 254, 255]


def test_an_unknown_profile_is_answered_with_the_nearest_names(command: Command) -> None:
    finished = command("profiles", "show", "maxon_epos5")
    assert (finished.status, finished.out) == (2, "")
    assert "nearest: maxon_epos4" in finished.err
    assert "Traceback" not in finished.err


def test_all_shipped_profiles_are_checked_when_none_is_named(command: Command) -> None:
    finished = command("profiles", "check")
    assert finished.status == 0
    assert finished.out == "".join(f"{name}: no fault\n" for name in profile_names())
    assert json.loads(command("profiles", "check", "--json").out) == {"errors": []}


@pytest.fixture
def faulty(tmp_path: Path) -> Path:
    """A profile with five faults, each in a line of its own."""
    text = (profile_folder() / "maxon_epos4.toml").read_text()
    for good, bad in (
        ('protocol = "canopen"', 'protocol = "canopne"'),
        ("mode_of_operation = 10 ", "mode_of_operation = 1000 "),
        ("entries = 12", "entries = 0"),
        ("tpdos = 4", "tpdoes = 4"),
        ("torque_bandwidth = 1000 ", "torque_bandwidth = -1 "),
    ):
        assert good in text
        text = text.replace(good, bad)
    path = tmp_path / "faulty.toml"
    path.write_text(text)
    return path


def test_all_faults_of_a_profile_are_listed_with_key_and_line(faulty: Path, command: Command) -> None:
    lines = faulty.read_text().splitlines()
    finished = command("profiles", "check", str(faulty), "--json")
    assert finished.status == 2
    errors = json.loads(finished.out)["errors"]
    keys = {error["key"] for error in errors}
    assert keys >= {
        "drive.protocol",
        "torque.mode_of_operation",
        "pdo.entries",
        "pdo.tpdoes",
        "timing.torque_bandwidth",
    }
    for error in errors:
        assert error["source"] == str(faulty)
        assert error["message"]
        if error["key"].split(".")[0] != "sources":
            assert lines[error["line"] - 1].startswith(error["key"].split(".")[-1])


def test_faults_are_told_as_lines_beside_good_files(faulty: Path, command: Command) -> None:
    finished = command("profiles", "check", str(faulty), "maxon_epos4", "nope")
    assert finished.status == 2
    assert f"{faulty}: line " in finished.out
    assert "maxon_epos4: no fault" in finished.out
    assert 'no profile "nope"' in finished.out


def test_a_faulty_profile_cannot_be_shown(faulty: Path, command: Command) -> None:
    finished = command("profiles", "show", str(faulty))
    assert (finished.status, finished.out) == (2, "")
    assert "torque_bandwidth" in finished.err


def test_the_eds_of_the_simulated_drive_is_written(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "sim.eds"
    finished = command("profiles", "show", "generic_cia402", "--eds", str(path))
    assert (finished.status, finished.out) == (0, f"{path}: the EDS of the simulated generic CiA 402\n")
    text = path.read_bytes().decode()
    assert "\r\nFileName=sim.eds\r\n" not in text.splitlines()
    assert "FileName=sim.eds\r\n" in text
    assert "[6071]\r\nParameterName=Target torque\r\n" in text


def test_the_json_object_is_printed_beside_it(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "sim.eds"
    shown = json.loads(command("profiles", "show", "generic_cia402", "--eds", str(path), "--json").out)
    assert shown["name"] == "generic_cia402"
    assert path.exists()


def test_an_eds_that_is_there_is_not_overwritten(tmp_path: Path, command: Command) -> None:
    """It may be the vendor's: `profiles new` and `profiles check` read what the same option names."""
    path = tmp_path / "vendor.eds"
    path.write_text("precious", encoding="utf-8")
    finished = command("profiles", "show", "generic_cia402", "--eds", str(path))
    assert (finished.status, path.read_text(encoding="utf-8")) == (2, "precious")
    assert "exists; name another file" in finished.err


@pytest.mark.parametrize("name", profile_names())
def test_the_json_object_has_every_value_of_the_file(name: str, command: Command) -> None:
    def missing(stated: Any, shown: Any, path: str) -> list[str]:
        if isinstance(stated, dict):
            return [each for key, value in stated.items() for each in missing(value, shown.get(key), f"{path}.{key}")]
        if isinstance(stated, list):
            pairs = zip(stated, shown, strict=True)
            return [
                each for place, (one, other) in enumerate(pairs) for each in missing(one, other, f"{path}[{place}]")
            ]
        return [] if stated == shown else [f"{path}: {stated!r}, shown {shown!r}"]

    shown = json.loads(command("profiles", "show", name, "--json").out)
    stated = tomllib.loads((profile_folder() / f"{name}.toml").read_text(encoding="utf-8"))
    assert missing(stated, shown, name) == []


def test_an_eds_that_cannot_be_written_is_told(tmp_path: Path, command: Command) -> None:
    finished = command("profiles", "show", "generic_cia402", "--eds", str(tmp_path / "none" / "sim.eds"))
    assert finished.status == 2
    assert "cannot be written: No such file or directory" in finished.err


@pytest.fixture
def vendor_file(tmp_path: Path, command: Command) -> Path:
    path = tmp_path / "push1.eds"
    command("profiles", "show", "generic_cia402", "--eds", str(path))
    return path


def test_a_vendors_eds_is_shown_as_the_profile_that_it_makes(vendor_file: Path, command: Command) -> None:
    finished = command("profiles", "show", str(vendor_file))
    assert finished.status == 0
    assert "generic CiA 402 · canopen · usable for force" not in finished.out
    assert "ASSUMED: as CiA 402-2 has it; an EDS names no units" in finished.out
    shown = json.loads(command("profiles", "show", str(vendor_file), "--json").out)
    assert shown["torque"]["mode_of_operation"] == 10
    assert "eds" not in shown


def test_a_vendors_eds_is_checked_line_by_line(vendor_file: Path, command: Command) -> None:
    assert command("profiles", "check", str(vendor_file)).out == f"{vendor_file}: no fault\n"
    text = vendor_file.read_text(encoding="utf-8")
    vendor_file.write_text(text.replace("[6071]", "[6071]\nnonsense"), encoding="utf-8")
    line = vendor_file.read_text(encoding="utf-8").splitlines().index("nonsense") + 1
    finished = command("profiles", "check", str(vendor_file), "--json")
    assert finished.status == 2
    (error,) = json.loads(finished.out)["errors"]
    assert (error["source"], error["line"], error["key"]) == (str(vendor_file), line, "[6071]")


def test_a_vendors_eds_without_torque_is_shown_and_checked_with_what_is_missing(
    vendor_file: Path, command: Command
) -> None:
    text = vendor_file.read_text(encoding="utf-8")
    vendor_file.write_text(text.replace("[6071]", "[3071]").replace("=0x6071", "=0x3071"), encoding="utf-8")
    finished = command("profiles", "show", str(vendor_file))
    assert finished.status == 0
    assert "generic CiA 402 · canopen · not usable for force" in finished.out
    checked = command("profiles", "check", str(vendor_file))
    assert checked.status == 2
    assert "not usable for force: there is no 6071h target torque" in checked.out
    ran = command("run", "wall", "--drive", str(vendor_file))
    assert ran.status == 4
    assert "not usable for force: there is no 6071h target torque" in ran.err


class TestCheckedAgainstAFile:
    def test_what_agrees_is_a_table_and_nothing_is_a_fault(self, vendor_file: Path, command: Command) -> None:
        finished = command("profiles", "check", str(vendor_file), "--eds", str(vendor_file))
        assert finished.status == 0
        first, *rows = finished.out.splitlines()
        assert first.split() == ["key", "the", "file", "has", "line"]
        (row,) = (line for line in rows if line.startswith("torque.target "))
        assert row.split()[1:-1] == ["6071h:00", "INTEGER16", "rw,", "mappable"]
        assert vendor_file.read_text(encoding="utf-8").splitlines()[int(row.split()[-1]) - 1] == "[6071]"
        assert rows[-1].endswith(f"of {vendor_file} in push1.eds, no faults")

    def test_a_fault_is_a_sentence_with_key_expected_value_and_line(self, vendor_file: Path, command: Command) -> None:
        text = vendor_file.read_text(encoding="utf-8")
        vendor_file.write_text(text.replace("Target torque\nObjectType=0x7\nDataType=0x0003", "X\nDataType=0x0004"))
        line = vendor_file.read_text(encoding="utf-8").splitlines().index("[6071]") + 1
        finished = command("profiles", "check", "generic_cia402", "--eds", str(vendor_file))
        assert finished.status == 2
        message = '6071h:00 is INTEGER32, the profile says "int16"'
        assert f"{vendor_file}: line {line}: torque.target: {message}" in finished.out
        told = json.loads(command("profiles", "check", "generic_cia402", "--eds", str(vendor_file), "--json").out)
        assert {"source": str(vendor_file), "key": "torque.target", "line": line, "message": message} in told["errors"]
        assert {"key", "line", "shows"} == told["agreed"][0].keys()

    def test_a_difference_with_a_reason_is_told_and_no_fault(
        self, vendor_file: Path, tmp_path: Path, command: Command
    ) -> None:
        path = tmp_path / "own.toml"
        text = (profile_folder() / "generic_cia402.toml").read_text(encoding="utf-8")
        reasons = '"sync.interpolation_time" = "left out: it means nothing"\n"sync.cycle_period" = "left out: nor it"\n'
        path.write_text(text + reasons, encoding="utf-8")
        finished = command("profiles", "check", str(path), "--eds", str(vendor_file))
        assert finished.status == 0, finished.out
        assert "known difference: line " in finished.out
        assert "left out: it means nothing" in finished.out
        assert "2 differences with a reason, no faults" in finished.out
        told = json.loads(command("profiles", "check", str(path), "--eds", str(vendor_file), "--json").out)
        assert told["errors"] == []
        assert [each["reason"] for each in told["known"]] == ["left out: it means nothing", "left out: nor it"]

    @pytest.mark.parametrize("names", [(), ("generic_cia402", "maxon_epos4")])
    def test_one_profile_is_proved_at_a_time(self, names: tuple[str, ...], vendor_file: Path, command: Command) -> None:
        finished = command("profiles", "check", *names, "--eds", str(vendor_file))
        assert finished.status == 2
        assert "--eds FILE compares one profile" in finished.err

    def test_a_file_that_is_none_is_told(self, tmp_path: Path, command: Command) -> None:
        finished = command("profiles", "check", "generic_cia402", "--eds", str(tmp_path / "none.eds"))
        assert finished.status == 2
        assert "none.eds: cannot be read" in finished.err


class TestDrafted:
    def test_a_profile_is_written_and_what_is_assumed_is_listed(
        self, vendor_file: Path, tmp_path: Path, command: Command
    ) -> None:
        path = tmp_path / "push1.toml"
        finished = command("profiles", "new", "--eds", str(vendor_file), "--output", str(path))
        assert finished.status == 0
        assert finished.out.startswith(f"{path}: ")
        assert "torque.target.unit" in finished.out
        assert finished.out.splitlines()[-1].endswith(f"profiles check {path} --eds {vendor_file}")
        assert command("profiles", "check", str(path)).out == f"{path}: no fault\n"
        assert command("profiles", "check", str(path), "--eds", str(vendor_file)).status == 0

    def test_a_drive_with_positions_in_another_unit_is_scaled_right_in_a_run(
        self, vendor_file: Path, tmp_path: Path, command: Command
    ) -> None:
        code = {"type": EdsType.UNSIGNED32, "access": "rw", "default": 0xFF41_0000}
        vendor_file.write_text(eds_text(changed(load_eds(vendor_file), 0x60A8, **code)), encoding="utf-8")
        path = tmp_path / "push1.toml"
        assert command("profiles", "new", "--eds", str(vendor_file), "--output", str(path)).status == 0
        assert 'unit = "0.1 deg"' in path.read_text(encoding="utf-8")
        told = json.loads(command("run", "wall", "--drive", str(path), "--duration", "1", "--json").out)
        assert told["torque_error"]["contact"] < 0.08
        text = path.read_text(encoding="utf-8").replace("value = 0xFF410000", "value = 0x00B50000")
        path.write_text(text, encoding="utf-8")
        told = json.loads(command("run", "wall", "--drive", str(path), "--duration", "1", "--json").out)
        assert told["torque_error"]["contact"] > 0.4, "a drive set to counts is told apart"

    def test_the_name_is_that_of_the_drive_or_the_one_that_is_given(
        self, vendor_file: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.chdir(tmp_path)
        told = json.loads(command("profiles", "new", "--eds", str(vendor_file), "--json").out)
        assert (told["file"], told["name"], told["usable"]) == ("generic_cia_402.toml", "generic_cia_402", True)
        assert {"key", "value", "why"} == told["assumed"][0].keys()
        assert command("profiles", "new", "--eds", str(vendor_file), "--name", "push1").status == 0
        assert (tmp_path / "push1.toml").exists()

    def test_nothing_is_overwritten(self, vendor_file: Path, tmp_path: Path, command: Command) -> None:
        path = tmp_path / "push1.toml"
        path.write_text("mine")
        finished = command("profiles", "new", "--eds", str(vendor_file), "--output", str(path))
        assert (finished.status, finished.out) == (2, "")
        assert "exists; name another file" in finished.err
        assert path.read_text() == "mine"

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            (("--name", "a/b"), "expected a name such as generic_cia_402"),
            (("--name", ""), "expected a name such as generic_cia_402"),
            (
                ("--name", "a", "--output", "b.toml"),
                "expected a name such as generic_cia_402, equal to that of --output",
            ),
            (("--output", "push1.eds"), "expected the path of a .toml file"),
            (("--output", "none/push1.toml"), "cannot be written: No such file or directory"),
        ],
    )
    def test_a_name_that_is_none_is_refused(
        self, options: tuple[str, ...], message: str, vendor_file: Path, command: Command
    ) -> None:
        finished = command("profiles", "new", "--eds", str(vendor_file), *options)
        assert finished.status == 2
        assert message in finished.err

    def test_a_drive_without_torque_is_told_to_be_of_no_use_for_force(
        self, vendor_file: Path, tmp_path: Path, command: Command
    ) -> None:
        text = vendor_file.read_text(encoding="utf-8")
        vendor_file.write_text(text.replace("[6071]", "[3071]").replace("=0x6071", "=0x3071"), encoding="utf-8")
        path = tmp_path / "push1.toml"
        finished = command("profiles", "new", "--eds", str(vendor_file), "--output", str(path))
        assert finished.status == 4
        assert "not usable for force: there is no 6071h target torque" in finished.err
        assert command("profiles", "check", str(path)).out == f"{path}: no fault\n"
        path.unlink()
        told = command("profiles", "new", "--eds", str(vendor_file), "--output", str(path), "--json")
        assert (told.status, json.loads(told.out)["usable"], path.exists()) == (4, False, True)
        assert "not usable for force: there is no 6071h target torque" in told.err

    def test_a_name_may_repeat_that_of_the_file(self, vendor_file: Path, tmp_path: Path, command: Command) -> None:
        path = tmp_path / "push1.toml"
        done = command("profiles", "new", "--eds", str(vendor_file), "--output", str(path), "--name", "push1")
        assert (done.status, path.exists()) == (0, True)

    def test_a_node_with_several_axes_in_sub_indices_is_named(
        self, vendor_file: Path, tmp_path: Path, command: Command
    ) -> None:
        eds = load_eds(vendor_file)
        for index in (0x6064, 0x6071):
            entry = eds.objects[index].entries[0]
            eds = changed(eds, index, 1, type=entry.type)
            eds = changed(eds, index, 2, type=entry.type)
            eds = changed(eds, index, 0, type=EdsType.UNSIGNED8, default=2, access="const", mappable=False)
        vendor_file.write_text(eds_text(eds), encoding="utf-8", newline="")
        finished = command("profiles", "new", "--eds", str(vendor_file), "--output", str(tmp_path / "two.toml"))
        assert finished.status == 4
        assert "several axes share this node" in finished.err
        assert "6064h:01 and :02, 6071h:01 and :02" in finished.err
        assert "subindex = 1, 2 … in position.actual, torque.target and torque.actual" in finished.err


def test_quirks_are_shown_only_where_there_are_any(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "quirky.toml"
    text = (profile_folder() / "generic_cia402.toml").read_text(encoding="utf-8")
    path.write_text(text + 'simulation = "a test"\n\n[simulation]\nabsent = [0x6502]\n', encoding="utf-8")
    shown = command("profiles", "show", str(path)).out
    assert "simulation.absent" in shown
    assert "6502h" in shown
    assert "simulation.boot_time" not in shown
    assert "simulation" not in command("profiles", "show", "generic_cia402").out

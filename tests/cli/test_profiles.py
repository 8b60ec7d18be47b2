import json
from pathlib import Path

import pytest

from haptic_fieldbus.protocols.catalogue import load_profile, profile_folder, profile_names
from tests.cli.command import Command

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
        given = getattr(profile, section)
        if not key or getattr(given, key) not in (None, ()):
            assert profile.sources[source] in finished.out
    assert "default" not in [line.strip() for line in finished.out.splitlines()]


def test_objects_are_shown_in_hexadecimal(command: Command) -> None:
    shown = command("profiles", "show", "maxon_epos4").out
    assert "6071h int16 permille_of_rated_torque" in shown
    assert "6007h = 2" in shown
    assert "1016h" in shown


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
    assert "ASSUMED, an EDS names no units" in finished.out
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


def test_a_vendors_eds_without_torque_is_refused_with_what_is_missing(vendor_file: Path, command: Command) -> None:
    text = vendor_file.read_text(encoding="utf-8")
    vendor_file.write_text(text.replace("[6071]", "[3071]"), encoding="utf-8")
    finished = command("profiles", "show", str(vendor_file))
    assert (finished.status, finished.out) == (2, "")
    assert "not usable for force: there is no 6071h target torque" in finished.err


def test_quirks_are_shown_only_where_there_are_any(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "quirky.toml"
    text = (profile_folder() / "generic_cia402.toml").read_text(encoding="utf-8")
    path.write_text(text + 'simulation = "a test"\n\n[simulation]\nabsent = [0x6502]\n', encoding="utf-8")
    shown = command("profiles", "show", str(path)).out
    assert "simulation.absent" in shown
    assert "6502h" in shown
    assert "simulation.boot_time" not in shown
    assert "simulation" not in command("profiles", "show", "generic_cia402").out

"""A folder of one's own drive profiles: found by name wherever a profile can be named, and by no accident."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import pytest

import haptic_fieldbus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.errors import ProfileError, RigError, UsageError
from haptic_fieldbus.protocols.catalogue import (
    VARIABLE,
    known_names,
    load_profile,
    load_rig,
    own_files,
    own_profile,
    profile_file,
    profile_folder,
    profile_names,
    profile_summaries,
)
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.host_request import HostRequest, resolve
from tests.cli.command import Command
from tests.drive.test_profile_files import COMPLETE

NOBODY = 65534
"""A user who owns nothing."""
RIG = """\
[bus.can]
interface = "haptic_sim"
channel = "sim"
[axis.handle]
bus = "can"
node = 1
profile = "push1"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
mechanism = { kind = "linear", metres_per_revolution = 0.05 }
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with one profile, which is no copy of a shipped one."""
    path = tmp_path / "drives"
    path.mkdir()
    text = (profile_folder() / "generic_cia402.toml").read_text(encoding="utf-8")
    (path / "push1.toml").write_text(text.replace('vendor = "generic"', 'vendor = "acme"'), encoding="utf-8")
    return path


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    return path


@pytest.fixture(params=["option", "environment"])
def given(request: pytest.FixtureRequest, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path | None:
    """The folder as an argument, or None where the environment names it."""
    if request.param == "option":
        return folder
    monkeypatch.setenv(VARIABLE, str(folder))
    return None


class TestByName:
    def test_a_profile_is_loaded(self, given: Path | None, folder: Path) -> None:
        profile = load_profile("push1", given)
        assert (profile.name, profile.title, profile.source) == ("push1", "acme CiA 402", str(folder / "push1.toml"))
        assert load_profile("maxon_epos4", given) == load_profile(profile_folder() / "maxon_epos4.toml")

    def test_python_plans_judges_and_runs(self, given: Path | None) -> None:
        own = {"drive": "push1", "profiles": given}
        assert haptic_fieldbus.plan("wall", **own).axes[0].profile.drive.vendor == "acme"  # type: ignore[arg-type]
        assert haptic_fieldbus.stability("wall", **own).stiffness == 600.0  # type: ignore[arg-type]
        result = haptic_fieldbus.run("wall", duration=0.2, **own)  # type: ignore[arg-type]
        assert (result.drive, result.missed_cycles) == ("push1", 0)

    def test_a_rig_has_it(self, given: Path | None, folder: Path, rig: Path) -> None:
        assert load_rig(rig, given).axis["handle"].profile == str(folder / "push1.toml")
        plan = haptic_fieldbus.plan("wall", rig, profiles=given)
        assert plan.axes[0].profile.name == "push1"

    def test_a_rig_made_in_python_has_it(self, given: Path | None, rig: Path) -> None:
        made = load_rig(rig, given)
        named = replace(made, axis={"handle": replace(made.axis["handle"], profile="push1")})
        assert haptic_fieldbus.plan("wall", named, profiles=given).axes[0].profile.name == "push1"

    def test_drives_are_hosted(self, given: Path | None) -> None:
        _, slots = resolve(HostRequest(["push1@5", "maxon_epos4"], "virtual:own", profiles=given))
        assert [(slot.profile.name, slot.axis.profile, slot.node) for slot in slots] == [
            ("push1", "push1", 5),
            ("maxon_epos4", "maxon_epos4", 1),
        ]

    def test_a_channel_of_the_simulated_bus_names_it(self, given: Path | None) -> None:
        words: dict[str, Any] = {} if given is None else {"profiles": str(given)}
        bus = can.Bus(interface="haptic_sim", channel="push1@5", clock=VirtualClock(), **words)
        try:
            assert isinstance(bus, SimulatedBus)
            assert bus.channel_info == "haptic_sim push1@5"
        finally:
            bus.shutdown()

    def test_every_command_that_takes_a_drive_takes_it(self, given: Path | None, rig: Path, command: Command) -> None:
        option = () if given is None else ("--profiles", given)
        for words in (
            ("run", "wall", "--drive", "push1", "--duration", "0.1"),
            ("run", "wall", "--rig", rig, "--duration", "0.1"),
            ("plan", "wall", "--drive", "push1"),
            ("stability", "wall", "--rig", rig),
            ("profiles", "show", "push1"),
            ("profiles", "check", "push1"),
        ):
            assert command(*words, *option).status == 0, words

    def test_the_list_says_where_each_is_from(self, given: Path | None, folder: Path, command: Command) -> None:
        option = () if given is None else ("--profiles", given)
        rows = {line.split()[0]: line.split()[-1] for line in command("profiles", "list", *option).out.splitlines()}
        assert rows == {"name": "from", "push1": str(folder / "push1.toml")} | dict.fromkeys(profile_names(), "shipped")
        listed = json.loads(command("profiles", "list", "--json", *option).out)
        assert {each["name"]: each["source"] for each in listed["profiles"]}["push1"] == str(folder / "push1.toml")
        assert listed["errors"] == []
        checked = command("profiles", "check", *option)
        assert "push1: no fault" in checked.out

    def test_an_unknown_name_is_answered_with_the_nearest_of_all(self, given: Path | None, rig: Path) -> None:
        with pytest.raises(UsageError, match='no profile "pusch1"; nearest: push1'):
            load_profile("pusch1", given)
        rig.write_text(RIG.replace("push1", "pusch1"), encoding="utf-8")
        with pytest.raises(RigError, match=r'axis\.handle\.profile: no profile "pusch1"; nearest: push1'):
            load_rig(rig, given)


def test_without_a_folder_no_own_name_is_known(rig: Path) -> None:
    assert own_files() == {}
    assert known_names() == profile_names()
    with pytest.raises(UsageError, match='no profile "push1"'):
        haptic_fieldbus.plan("wall", drive="push1")


def test_the_folder_that_is_given_comes_in_the_place_of_that_of_the_environment(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    assert list(own_files(folder)) == ["push1"]
    monkeypatch.setenv(VARIABLE, "")
    assert own_files() == {}


def test_a_name_stays_what_it_was_when_the_working_folder_changes(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder.parent)
    found = own_profile("push1", "drives")
    monkeypatch.chdir(tmp_path.parent)
    assert load_profile(found).name == "push1"


class TestRefused:
    @pytest.mark.thorough("5 cases of one rule", quick=2)
    @pytest.mark.parametrize(
        ("name", "why"),
        [
            ("nowhere", "No such file or directory"),
            ("drives/push1.toml", "Not a directory"),
            ("x" * 300, "File name too long"),
            ("loop", "Too many levels of symbolic links"),
            ("a\0b", "invalid file name"),
        ],
        ids=["missing", "a file", "too long", "a circle", "no name at all"],
    )
    def test_what_is_no_folder(self, name: str, why: str, folder: Path, command: Command) -> None:
        (folder.parent / "loop").symlink_to(folder.parent / "loop")
        path = folder.parent / name
        for words in (
            ("run", "wall"),
            ("plan", "wall", "--drive", folder / "push1.toml"),
            ("stability", "wall"),
            ("simulate", "--bus", "virtual:a"),
            ("profiles", "list"),
            ("profiles", "show", "maxon_epos4"),
            ("profiles", "check"),
        ):
            finished = command(*words, "--profiles", path)
            assert finished.status == 2
            assert f'profiles "{path}": expected a folder of drive profiles: {why}' in finished.err
            assert finished.out == ""

    def test_what_the_environment_names_by_its_variable(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv(VARIABLE, "/nowhere/at/all")
        with pytest.raises(UsageError, match=f'{VARIABLE} "/nowhere/at/all": expected a folder of drive profiles'):
            haptic_fieldbus.plan("wall")

    def test_an_empty_word(self, command: Command) -> None:
        finished = command("plan", "wall", "--profiles", "")
        assert finished.status == 2
        assert 'profiles "": expected a folder of drive profiles' in finished.err

    def test_a_folder_that_may_not_be_read(self, folder: Path) -> None:
        assert own_files(folder)  # all that this imports is imported before any right is given up
        user = os.geteuid()
        folder.chmod(0)
        if user == 0:  # root may read every folder
            os.seteuid(NOBODY)
        try:
            with pytest.raises(UsageError, match="Permission denied"):
                own_files(folder)
        finally:
            os.seteuid(user)
            folder.chmod(0o700)

    def test_a_name_that_is_also_a_shipped_one(self, folder: Path, rig: Path, command: Command) -> None:
        own, shipped = folder / "maxon_epos4.toml", profile_folder() / "maxon_epos4.toml"
        own.write_text((folder / "push1.toml").read_text())
        told = f'profile "maxon_epos4": both {own} and the shipped {shipped} have this name; rename yours'
        finished = command("run", "wall", "--profiles", folder)
        assert (finished.status, " ".join(finished.err.split())) == (2, told)
        rig.write_text(RIG.replace("push1", "maxon_epos4"), encoding="utf-8")
        assert told in " ".join(command("plan", "wall", "--rig", rig, "--profiles", folder).err.split())
        assert command("plan", "wall", "--drive", "push1", "--profiles", folder).status == 0
        listed = command("profiles", "list", "--profiles", folder)
        assert listed.status == 0
        assert told in " ".join(listed.err.split())
        assert [line.split()[0] for line in listed.out.splitlines()] == [
            "name",
            *sorted((set(profile_names()) - {"maxon_epos4"}) | {"push1"}),
        ]

    def test_a_name_in_both_places_is_one_where_the_file_is_the_same(self, folder: Path) -> None:
        assert known_names(profile_folder()) == profile_names()
        assert load_profile("maxon_epos4", profile_folder()) == load_profile("maxon_epos4")
        (folder / "maxon_epos4.toml").symlink_to(profile_folder() / "maxon_epos4.toml")
        assert load_profile("maxon_epos4", folder).name == "maxon_epos4"

    def test_a_file_that_is_broken_with_its_faults_and_no_other(self, folder: Path, command: Command) -> None:
        (folder / "bad.toml").write_text(COMPLETE.replace("schema = 1", "schema = 2"), encoding="utf-8")
        (folder / "worse.toml").write_bytes(b"\xff")
        with pytest.raises(ProfileError, match=r"bad\.toml: line 1: schema: 2; expected 1"):
            haptic_fieldbus.plan("wall", drive="bad", profiles=folder)
        assert haptic_fieldbus.plan("wall", drive="push1", profiles=folder)
        listed = command("profiles", "list", "--profiles", folder)
        assert listed.status == 0
        assert "push1" in listed.out
        assert f"{folder / 'bad.toml'}: line 1: schema: 2; expected 1" in listed.err
        assert f"{folder / 'worse.toml'}: line 1: not UTF-8" in listed.err
        (first, _) = json.loads(command("profiles", "list", "--json", "--profiles", folder).out)["errors"]
        assert first == {
            "source": str(folder / "bad.toml"), "key": "schema", "line": 1, "message": "2; expected 1",
        }  # fmt: skip
        assert command("profiles", "check", "--profiles", folder).status == 2


class TestHostile:
    def test_an_empty_folder_adds_nothing(self, tmp_path: Path) -> None:
        assert known_names(tmp_path) == profile_names()

    @pytest.mark.parametrize("name", ["..", ".", "", "*", "push?", "~", "PUSH1", "push1 ", "\0"])
    def test_only_whole_names_are_found(self, name: str, folder: Path) -> None:
        with pytest.raises(UsageError, match="no profile"):
            load_profile(name, folder)

    @pytest.mark.parametrize("name", ["../secret", "./push1", "drives/push1", "../drives/push1"])
    def test_a_name_with_a_slash_is_a_path_from_here_and_not_from_the_folder(
        self, name: str, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (folder.parent / "secret.toml").write_text("", encoding="utf-8")
        monkeypatch.chdir(folder)
        with pytest.raises(ProfileError, match="no such file"):
            load_profile(name, folder)

    def test_what_is_no_file_is_not_waited_for(self, folder: Path) -> None:
        os.mkfifo(folder / "pipe.toml")
        (folder / "room.toml").mkdir()
        (folder / "gone.toml").symlink_to(folder / "nowhere")
        for name in ("pipe", "room", "gone"):
            with pytest.raises(UsageError, match=rf'profile "{name}": .*{name}\.toml is not a file'):
                load_profile(name, folder)
        assert isinstance(profile_summaries(folder)["pipe"], UsageError)
        assert load_profile("push1", folder)

    def test_hidden_files_and_names_that_look_like_paths_are_left_out(self, folder: Path) -> None:
        for name in (".hidden.toml", ".toml", "sheet.eds.toml", "notes.txt", "push1.toml~"):
            (folder / name).write_text("")
        assert list(own_files(folder)) == ["push1"]

    def test_a_link_leads_to_its_file(self, folder: Path) -> None:
        (folder / "other.toml").symlink_to(folder / "push1.toml")
        assert load_profile("other", folder).name == "other"
        assert profile_file("other", folder) == folder / "other.toml"

    @pytest.mark.thorough("reads a thousand files")
    def test_a_thousand_files_are_listed_and_only_the_one_that_is_named_is_read(self, folder: Path) -> None:
        for number in range(1000):
            (folder / f"broken{number}.toml").write_text("=")
        assert len(known_names(folder)) == 1001 + len(profile_names())
        assert haptic_fieldbus.plan("wall", drive="push1", profiles=folder)
        assert sum(isinstance(each, ProfileError) for each in profile_summaries(folder).values()) == 1000

    @pytest.mark.thorough("judges a scene on every drive")
    def test_what_scenes_show_advises_does_not_depend_on_it(
        self, folder: Path, command: Command, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        before = command("scenes", "show", "wall").out
        (folder / "maxon_epos4.toml").write_text("=")
        monkeypatch.setenv(VARIABLE, str(folder))
        assert command("scenes", "show", "wall").out == before

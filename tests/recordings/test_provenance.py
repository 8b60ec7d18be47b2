"""The provenance of a run, in every file that holds it, and the run again that it describes."""

import json
import math
import os
import platform
import re
import zlib
from base64 import b64decode, b64encode
from dataclasses import replace
from inspect import signature
from itertools import cycle
from pathlib import Path
from typing import Any, cast

import pytest

import haptic_fieldbus
from haptic_fieldbus import (
    HapticFieldbusError,
    Provenance,
    UsageError,
    compare_recording,
    read_provenance,
    read_recording,
    repeat,
    run,
)
from haptic_fieldbus.api import Trial, prepare_run
from haptic_fieldbus.api import provenance as gathering
from haptic_fieldbus.api.rehearsal import rehearsal
from haptic_fieldbus.cli.app import application
from haptic_fieldbus.documents.safe_read import PROVENANCE_SIZE
from haptic_fieldbus.planning.request import RECORD_SUFFIXES, Task
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.recordings.provenance import (
    HIDDEN,
    MARK,
    PICTURES,
    digest,
    hidden,
    marked,
    scrubbed,
    side_file,
    without_secrets,
    write_beside,
)
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.cli.command import Command

SHORT = 0.05
RIG = """
[bus.left]
interface = "haptic_sim"
channel = "left"
bitrate = 500000
[axis.handle]
bus = "left"
node = 9
profile = "mine.toml"
rated_torque = 0.4
encoder_counts_per_revolution = 2000
inertia = 5e-5
viscous_damping = 1e-4
coulomb_friction = 1e-3
emergency_stop = "power"
mechanism = { kind = "linear", metres_per_revolution = 0.04, sign = -1 }
limits = { speed = 3.0, position = [-0.1, 0.1] }
"""
SCENE = """
include = ["wall"]
hand = "sine"
[axis.handle]
workspace = "linear"
[[element]]
kind = "damper"
axis = "handle"
damping = 0.5
"""

ARGUMENTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "settings": {"settings": {"wall.stiffness": "max/2", "wall.position": 0.001}, "rate": 500.0, "hand": "none"},
    "faults": {"faults": "random@3", "seed": 7},
    "changes": {"changes": [(0.02, {"wall.stiffness": 300.0})]},
    "modbus": {"bus": "sim-modbus-tcp"},
}


def recorded(path: Path, **arguments: Any) -> haptic_fieldbus.Result:
    return run(arguments.pop("scene", "wall"), duration=SHORT, record=path, **arguments)


@pytest.mark.parametrize("name", ARGUMENTS)
def test_a_recorded_run_is_repeated_row_by_row(name: str, tmp_path: Path) -> None:
    result = recorded(tmp_path / "a.csv", **ARGUMENTS[name])
    again = repeat(tmp_path / "a.csv", record=tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert again.to_json()["limit"] == result.to_json()["limit"]
    assert again.warnings == result.warnings
    assert (again.drive, again.bus) == (result.drive, result.bus)
    assert again.provenance is not None
    assert result.provenance is not None
    assert again.provenance.scene == result.provenance.scene
    assert again.provenance.conditions == result.provenance.conditions


def test_the_files_of_a_bench_need_not_be_there_any_more(tmp_path: Path) -> None:
    bench = tmp_path / "bench"
    bench.mkdir()
    (bench / "mine.toml").write_text(Path(load_profile("maxon_epos4").source).read_text())
    (bench / "rig.toml").write_text(RIG)
    (bench / "own.toml").write_text(SCENE)
    record = tmp_path / "a.log"
    result = recorded(record, scene=bench / "own.toml", rig=bench / "rig.toml", axes={"handle": "handle"})
    found = read_provenance(record)
    assert found.rig.source == str(bench / "rig.toml")
    assert found.rig.source_sha256 == digest(RIG)
    assert found.conditions.hand == "sine"
    for path in bench.iterdir():
        path.unlink()
    again = repeat(found, record=tmp_path / "b.log")
    assert again.to_json()["limit"] == result.to_json()["limit"]
    assert again.warnings == result.warnings
    assert record.read_bytes() == (tmp_path / "b.log").read_bytes()


@pytest.mark.thorough("runs every scene of the library twice")
@pytest.mark.parametrize("scene", scene_names())
def test_each_scene_of_the_library_is_repeated(scene: str, tmp_path: Path) -> None:
    recorded(tmp_path / "a.csv", scene=scene)
    repeat(tmp_path / "a.csv", record=tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_run_from_takes_every_file_that_a_run_leaves(command: Command, tmp_path: Path) -> None:
    told = command("run", "wall", "--duration", "0.05", "--json", "--record", str(tmp_path / "a.log"))
    sources = [tmp_path / "a.json", tmp_path / "a.log", side_file(tmp_path / "a.log")]
    sources[0].write_text(told.out)
    for suffix in (".blf", ".csv"):
        sources.append(tmp_path / f"a{suffix}")
        command("run", "wall", "--duration", "0.05", "--record", str(sources[-1]))
    for suffix in PICTURES:
        sources.append(tmp_path / f"a{suffix}")
        command("run", "wall", "--duration", "0.05", "--plot", str(sources[-1]))
    for source in sources:
        finished = command("run", "-v", "--from", str(source), "--record", str(tmp_path / "b.log"))
        assert (finished.status, finished.err) == (0, ""), source
        assert (tmp_path / "a.log").read_bytes() == (tmp_path / "b.log").read_bytes(), source


def test_a_run_from_a_file_takes_no_option_that_the_file_decides(command: Command, tmp_path: Path) -> None:
    recorded(tmp_path / "a.csv")
    refused = command("run", "wall", "--from", str(tmp_path / "a.csv"), "--rate", "500", "--set", "wall.stiffness=1")
    assert refused.status == 2
    assert "omit SCENE, --rate, --set" in refused.err
    assert "expected SCENE or --from FILE" in command("run").err


def test_a_scene_may_have_the_name_of_the_rig(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(SCENE)
    result = run(tmp_path / "rig.toml", duration=SHORT, record=tmp_path / "a.csv")
    provenance = cast(Any, result.provenance)
    assert provenance.scene.name == provenance.rig.name == "rig.toml"
    repeat(tmp_path / "a.csv", record=tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


WRONG_LED = [(3, "handle", 0.1), (2, "handle", 0.2)], [(1, "foot", 0.1)], [(1, "", "kick")], [(1, "handle", "push")]


@pytest.mark.parametrize("led", [*WRONG_LED, [(1, "handle", float("nan"))], [(1, "", None)], [(-1, "", "push")]])
def test_a_hand_that_no_page_has_led_is_refused(led: list[Any]) -> None:
    found = run("wall", duration=SHORT).provenance
    assert found is not None
    wrong = replace(found, conditions=replace(found.conditions, led=tuple(led)))
    with pytest.raises(UsageError, match=r"conditions\.led: \[.*\]: expected a later period, and an axis and a place"):
        repeat(wrong)


def test_a_hand_that_was_led_for_longer_than_is_kept_is_told() -> None:
    found = run("wall", duration=SHORT).provenance
    assert found is not None
    warnings = repeat(replace(found, conditions=replace(found.conditions, led=None))).warnings
    assert warnings[0].startswith("the hand was led on a page for longer than is recorded: the repetition has the hand")


def test_another_version_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    recorded(tmp_path / "a.csv")
    now = gathering.versions()
    monkeypatch.setattr(gathering, "versions", lambda: {**now, "haptic-fieldbus": "99.0", "numpy": "98.0"})
    told = " ".join(repeat(tmp_path / "a.csv").warnings)
    assert f"recorded with haptic-fieldbus {now['haptic-fieldbus']}, repeated with 99.0" in told
    assert "repeated with 98.0" in told


def test_it_tells_who_made_the_run_unless_that_is_left_out(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("USER", "ada")
    rig = tmp_path / "mine" / "rig.toml"
    rig.parent.mkdir()
    rig.write_text(RIG.replace("mine.toml", "maxon_epos4"))
    words = ["run", "wall", "--rig", str(rig), "--duration", "0.05", "--json"]
    monkeypatch.setattr("sys.argv", ["/opt/bin/haptic-fieldbus", *words, "--token", "5ecret", "--token=5ecret"])
    named = json.loads(command(*words).out)["provenance"]
    assert (named["host"], named["user"]) == (platform.node(), "ada")
    assert named["rig"]["source"] == str(rig)
    assert named["command"][:5] == ["/opt/bin/haptic-fieldbus", *words[:4]]
    assert "5ecret" not in json.dumps(named)
    bare = json.dumps(json.loads(command(*words, "--anonymous").out)["provenance"])
    for private in (f'"{platform.node()}"', '"ada"', str(tmp_path), "/opt/bin", "5ecret"):
        assert private not in bare


def test_secrets_are_left_out() -> None:
    assert scrubbed(["x", "--token", "a", "--api-token=b", "c"]) == (
        "x",
        "--token",
        HIDDEN,
        f"--api-token={HIDDEN}",
        "c",
    )
    assert scrubbed(["/a/b/x", "c/d.toml"], paths=False) == ("x", "d.toml")
    assert scrubbed(["/home/ada/bin/x", "--profiles", "/home/ada/", "/home/ada"], paths=False) == (
        "x", "--profiles", HIDDEN, HIDDEN,
    )  # fmt: skip
    table = {"can0": {"channel": "x", "arguments": {"password": "a", "port": 1}, "also": [{"token": "b"}]}}
    shown = {"channel": "x", "arguments": {"password": HIDDEN, "port": 1}, "also": [{"token": HIDDEN}]}
    assert without_secrets(table) == {"can0": shown}


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("socketcand:can0,host=h,password=hunter2,port=1", f"socketcand:can0,host=h,password={HIDDEN},port=1"),
        ("--bus=remote:x,api_token=hunter2", f"--bus=remote:x,api_token={HIDDEN}"),
        ("password=hunter2", f"password={HIDDEN}"),
        ("ws://ada:hunter2@host:80/x", f"ws://ada:{HIDDEN}@host:80/x"),
        ("wall.stiffness=400", "wall.stiffness=400"),
    ],
)
def test_a_secret_inside_of_a_word_is_left_out_too(text: str, shown: str) -> None:
    assert scrubbed([text]) == (shown,)
    assert hidden(text) == shown


def test_an_element_of_python_is_told_and_not_repeated(tmp_path: Path) -> None:
    from haptic_fieldbus import load_scene
    from haptic_fieldbus.scenes.wall import Wall

    class Mine(Wall):
        """A class that no file can name."""

    scene = load_scene("wall")
    own = type(scene)("own", "", scene.axes, (Mine("handle", 300.0, 0.02),))
    recorded(tmp_path / "a.csv", scene=own)
    assert read_provenance(tmp_path / "a.csv").scene is None
    with pytest.raises(UsageError, match="object of Python"):
        repeat(tmp_path / "a.csv")


@pytest.mark.parametrize("sort", ["hand", "method", "estimator"])
def test_a_part_of_python_that_is_not_here_is_named(sort: str, command: Command, tmp_path: Path) -> None:
    recorded(tmp_path / "a.csv")
    beside = side_file(tmp_path / "a.csv")
    table = json.loads(beside.read_text())
    beside.write_text(json.dumps(table | {"conditions": table["conditions"] | {sort: "mine"}}))
    refused = command("run", "--from", str(tmp_path / "a.csv"))
    told = " ".join(refused.err.split())
    assert refused.status == 2
    assert f'the {sort} "mine" of the recorded run was an object of a program' in told
    assert f"repeat(FILE, {sort}=...)" in told


def test_a_run_that_is_stopped_is_repeated_up_to_its_end() -> None:
    found = run("wall", duration=SHORT).provenance
    assert found is not None
    assert found.ended(20, []).conditions.duration == 0.02
    acted, late = (0.01, {"wall.stiffness": 1.0}), (0.02, {"wall.stiffness": 2.0})
    assert found.ended(None, [acted]).conditions.changes == (acted,)
    # A change that began with the end: nothing came after it, and no run may schedule it.
    assert found.ended(20, [acted, late]).conditions.changes == (acted,)


def test_a_provenance_that_cannot_be_completed_is_told(tmp_path: Path) -> None:
    record = tmp_path / "a.csv"

    def taken(done: int, total: int) -> None:
        side_file(record).with_name(side_file(record).name + ".new").mkdir(exist_ok=True)

    result = run("wall", duration=3 * SHORT, record=record, progress=taken)
    told = f"the provenance beside {record} could not be completed; it holds only what was known before the run: "
    assert any(told in each for each in result.warnings)
    assert read_provenance(record).drives == {}


def test_a_run_on_real_drives_is_repeated_in_simulation(tmp_path: Path) -> None:
    """Of which the rig alone is another one: its bus."""
    found = run("wall", duration=SHORT, record=tmp_path / "a.csv").provenance
    assert found is not None
    text = found.rig.text.replace('interface = "haptic_sim"', 'interface = "socketcan"')
    real = replace(found, simulated=False, rig=replace(found.rig, text=text, sha256=digest(text)))
    again = repeat(real, record=tmp_path / "b.csv")
    assert again.clock == "virtual"
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_a_rehearsal_is_told_from_a_run_on_a_real_drive(command: Command, tmp_path: Path) -> None:
    with rehearsal(Task("wall"), Trial()) as rig:
        task = Task("wall", rig, settings={"wall.stiffness": "max/2"})
        found = prepare_run(task, Trial())[0].provenance
    assert found is not None
    assert (found.rehearsed, found.simulated) == (True, False)
    run("wall", duration=0.01, record=tmp_path / "a.csv")
    ordinary = read_provenance(tmp_path / "a.csv")
    assert not ordinary.rehearsed
    write_beside(tmp_path / "a.csv", replace(ordinary, rehearsed=True))
    assert "rehearsed: the drives were simulated" in command("replay", tmp_path / "a.csv").out


def test_the_file_beside_a_recording_is_named_where_it_is_damaged(tmp_path: Path) -> None:
    record = tmp_path / "a.csv"
    run("wall", duration=0.01, record=record)
    for text, words in (("", "no provenance in it: Expecting value"), ("{}", "version: Field required")):
        side_file(record).write_text(text, encoding="utf-8")
        for read in (read_provenance, read_recording):
            with pytest.raises(UsageError, match=rf"a\.csv\.provenance\.json: {words}"):
                read(record)


def test_the_result_of_a_trip_has_the_whole_provenance(tmp_path: Path) -> None:
    faults = tmp_path / "faults.toml"
    faults.write_text('[[fault]]\nkind = "emergency"\nat = 0.02\ncode = 0x2310\n')
    with pytest.raises(HapticFieldbusError) as tripped:
        run("wall", duration=1.0, faults=faults, record=tmp_path / "a.csv")
    result = cast(Any, tripped.value.result)
    assert result.provenance.drives["handle"]["title"] == "maxon EPOS4"
    with pytest.raises(HapticFieldbusError, match=re.escape(str(tripped.value))):
        repeat(tmp_path / "a.csv", record=tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_the_next_octets_of_a_picture_are_no_part_of_its_provenance(tmp_path: Path) -> None:
    """The text of three lengths, so that its base64 ends with 0, 1 and 2 signs of padding."""
    recorded(tmp_path / "a.csv")
    found = read_provenance(tmp_path / "a.csv")
    picture, lengths = tmp_path / "a.png", set[int]()
    for more in range(40):
        longer = replace(found, command=(*found.command, *map(str, range(more))))
        mark = longer.mark
        lengths.add(mark.count("="))
        for after in ("A", "AB", "+/9", "ABCD", "=", "==", "A=", "\0"):
            picture.write_bytes(b"\x89PNG" + mark.encode() + after.encode() + b"\0\0\0")
            assert read_provenance(picture) == longer
    assert lengths == {0, 1, 2}


WORDS = {
    "stability": ("wall", "--set", "wall.stiffness=max/2"),
    "response": ("wall", "--duration", "0.05"),
    "estimate": ("signal.csv",),
    "sweep": ("wall", "--grid", "wall.stiffness=100:200:2", "--workers", "1", "--out", "rows"),
    "replay": ("signal.csv",),
}
"""Arguments of the commands that draw no run, beside --plot."""


def told_by(picture: Path) -> dict[str, Any]:
    """Return the JSON object in a picture, found without the package."""
    found = re.search(
        MARK.encode() + rb"((?:[A-Za-z0-9+/]{4})*(?:[A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?)", picture.read_bytes()
    )
    assert found is not None, picture
    return cast(dict[str, Any], json.loads(zlib.decompress(b64decode(found[1]))))


@pytest.mark.thorough("draws pictures of many commands")
def test_a_picture_of_no_run_tells_what_it_was_made_from(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("USER", "ada")
    recorded(Path("signal.csv"))
    side_file(Path("signal.csv")).unlink()
    rows = Path("signal.csv").read_text().splitlines()
    place = rows[0].split(",").index("handle.position")
    signal = [f"{index / 1000},{row.split(',')[place]}" for index, row in enumerate(rows[1:])]
    Path("motion.csv").write_text("\n".join(["time,position", *signal]))
    for (name, given), suffix in zip(WORDS.items(), cycle(PICTURES), strict=False):
        words = ("motion.csv",) if name == "estimate" else given
        picture = Path("secret", f"{name}{suffix}")
        picture.parent.mkdir(exist_ok=True)
        monkeypatch.setattr("sys.argv", ["/opt/bin/haptic-fieldbus", name, *words, "--plot", str(picture)])
        finished = command(name, *words, "--plot", str(picture))
        assert finished.status == 0, finished.err
        told = told_by(picture)
        assert told["version"] == gathering.versions()["haptic-fieldbus"]
        assert told["command"][:3] == ["haptic-fieldbus", name, words[0]]
        if words[0].endswith(".csv"):
            assert told["files"] == {words[0]: digest(Path(words[0]).read_bytes())}
        else:
            assert 'kind = "wall"' in told["scene"]
        assert (told["host"], told["user"]) == (None, None)
        assert not any(private in json.dumps(told) for private in ("/opt", "secret", '"ada"', str(tmp_path)))
        refused = command("run", "--from", str(picture))
        assert refused.status == 2
        assert f"shows no run that could be repeated; made by haptic-fieldbus {name} {words[0]}" in refused.err


def test_every_command_that_draws_is_tried() -> None:
    commands = [cast(Any, each.callback) for each in application().registered_commands]
    drawing = {each.__name__ for each in commands if "plot" in signature(each).parameters}
    assert drawing == {*WORDS, "run", "rehearse", "identify", "certify"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rate": 0.0}, "rate 0: expected a rate above 0"),
        ({"rate": math.nan}, "rate nan: expected a rate above 0"),
        ({"fade_in": 0.0}, "fade-in 0 s: expected"),
        ({"changes": ((0.005, {"wall.stiffness": 300.0}),), "ramp": 1e308}, "ramp 1e308: expected a time above 0 s"),
    ],
    ids=str,
)
def test_conditions_that_no_run_had_are_neither_repeated_nor_compared(
    change: dict[str, Any], words: str, tmp_path: Path
) -> None:
    found = run("wall", duration=0.01, record=tmp_path / "a.csv").provenance
    assert found is not None
    write_beside(tmp_path / "a.csv", replace(found, conditions=replace(found.conditions, **change)))
    for again in (repeat, compare_recording):
        with pytest.raises(UsageError, match=words):
            again(tmp_path / "a.csv")


def test_what_is_no_provenance_is_refused(tmp_path: Path) -> None:
    recorded(tmp_path / "a.csv")
    beside = side_file(tmp_path / "a.csv")
    table = json.loads(beside.read_text())
    for change, message in (
        ({"scene": {**table["scene"], "text": "x"}}, "changed after the run"),
        ({"conditions": 3}, "conditions: "),
        *(
            ({"rig": {**table["rig"], "name": name}}, "expected the name of a file")
            for name in ("../rig.toml", "..", ".", "", "a\0b", "a\n", "a" * 300, "/etc/rig.toml", "..\\rig.toml")
        ),
        ({"profiles": [table["rig"]]}, "a name of its own"),
    ):
        beside.write_text(json.dumps(table | change))
        with pytest.raises(UsageError, match=message):
            read_provenance(tmp_path / "a.csv")
    for text in ("[1", "[" * 100_000, "", "\xff"):
        beside.write_text(text, encoding="latin-1")
        with pytest.raises(UsageError, match="no provenance in it"):
            read_provenance(tmp_path / "a.csv")
    beside.unlink()
    with pytest.raises(UsageError, match=r"nor in a file a\.csv\.provenance\.json beside it"):
        read_provenance(tmp_path / "a.csv")
    with pytest.raises(UsageError, match="No such file"):
        read_provenance(tmp_path / "nothing.log")
    (tmp_path / "a.png").write_bytes(b"haptic-fieldbus provenance AAAA")
    with pytest.raises(UsageError, match="no provenance in it"):
        read_provenance(tmp_path / "a.png")
    (tmp_path / "bomb.png").write_bytes(MARK.encode() + b64encode(zlib.compress(b" " * (PROVENANCE_SIZE + 1), 9)))
    with pytest.raises(UsageError, match="no provenance in it"):
        read_provenance(tmp_path / "bomb.png")
    for text in ('{"files": 1}', '{"files": {}, "command": 3, "date": 1, "version": 2}'):
        (tmp_path / "a.png").write_text(marked(text))
        with pytest.raises(UsageError, match="no provenance in it"):
            read_provenance(tmp_path / "a.png")
    os.mkfifo(tmp_path / "a.json")
    (tmp_path / "zero.png").symlink_to("/dev/zero")
    for name, kind in (("a.json", "a FIFO"), ("zero.png", "a device")):
        with pytest.raises(UsageError, match=f"{name}: it is {kind}; expected a regular file"):
            read_provenance(tmp_path / name)
    with pytest.raises(TypeError, match="path: expected"):
        read_provenance(3)  # type: ignore[arg-type]
    assert isinstance(Provenance, type)
    assert {".log", ".blf", ".csv"} <= set(RECORD_SUFFIXES)

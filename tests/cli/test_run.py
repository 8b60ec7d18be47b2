"""`run` as a person and as a script sees it."""

import json
from pathlib import Path

import pytest
from PIL import Image

from haptic_fieldbus.cli import options
from haptic_fieldbus.cli import run as module
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.report.drawing import CONTENT
from tests.cli.command import Command

SHORT = ("--duration", "0.6")
KEYS = [
    "scene", "drive", "bus", "rate_hz", "clock", "cycles", "missed_cycles", "duration_s", "bus_load", "plan", "timing",
    "torque_error", "energy_generated_j", "travel", "stability", "trips", "stopped", "changes", "passivity", "verdict",
    "guards", "host", "deadlines", "limit", "provenance",
]  # fmt: skip
STABILITY = {
    "period_s", "delay_s", "plant", "stiffness", "damping", "limit", "stiffness_limit", "judged_at",
    "spectral_radius", "margin", "verdict", "own_laws",
}  # fmt: skip


def test_a_run_tells_what_it_did_line_by_line(command: Command) -> None:
    finished = command("run", "wall", *SHORT)
    assert finished.status == 0
    assert finished.err == ""
    keys = [line[:11].strip() for line in finished.out.splitlines()]
    assert keys == ["scene", "bench", "sends", "limit", "result", "verdict"]
    for words in ("stiffness 600 N/m at 20 mm", "maxon EPOS4 (simulated), node 1", "reads statusword, position",
                  "600 periods, none missed; no trip", "handle from 0 to "):  # fmt: skip
        assert words in finished.out
    assert "\x1b" not in finished.out


def test_json_is_the_only_thing_on_standard_output(command: Command) -> None:
    finished = command("run", "wall", "--json", *SHORT)
    assert finished.status == 0
    result = json.loads(finished.out)
    assert list(result) == KEYS
    assert (result["scene"], result["bus"], result["clock"]) == ("wall", "sim", "virtual")
    assert (result["cycles"], result["missed_cycles"], result["trips"]) == (600, 0, [])
    assert set(result["plan"]) == {"mapped", "left_out", "assumed"}
    assert result["plan"]["mapped"] == [
        "6041h:00 statusword",
        "6064h:00 position actual value",
        "6077h:00 torque actual value",
        "6040h:00 controlword",
        "6071h:00 target torque",
    ]
    assert all(set(each) == {"what", "why"} for each in result["plan"]["left_out"])
    assert set(result["timing"]) == {"period_us", "age_us", "compute_us", "lateness_us", "late"}
    spreads = [each for key, each in result["timing"].items() if key != "late"]
    assert all(set(each) == {"p50", "p99", "p999", "max"} for each in spreads)
    assert result["timing"]["period_us"]["p50"] == pytest.approx(1000.0)
    assert set(result["torque_error"]) == {"rms", "max", "unit", "by_source", "contact", "contact_s"}
    assert set(result["stability"]) == STABILITY
    assert set(result["stability"]["stiffness_limit"]) == {"passive", "stable", "quantisation", "cautious"}


def test_changes_are_announced_and_told_with_when_they_began(command: Command) -> None:
    options = ("--change", "0.2:wall.stiffness=0.8 N/mm", "--change", "0.2:wall.position=25 mm")
    words = ("run", "wall", *options, *SHORT)
    lines, details = (
        [(line[:11].strip(), line[11:]) for line in command(*words, *more).out.splitlines()] for more in ((), ("-v",))
    )
    assert ("changes", "at 0.2 s wall.stiffness=0.8 N/mm, wall.position=25 mm") in lines
    assert ("changed", "at 0.2 s wall.stiffness=800, wall.position=0.025") in details
    result = json.loads(command("run", "wall", *options, *SHORT, "--json").out)
    assert result["changes"] == [{"t_s": 0.2, "settings": {"wall.stiffness": 800.0, "wall.position": 0.025}}]


@pytest.mark.parametrize(
    ("words", "status", "sentence"),
    [
        (("wal",), 2, "nearest: wall"),
        (("wall", "--drive", "maxon_epos5"), 2, "nearest: maxon_epos4"),
        (("wall", "--node", "0"), 2, "node 0"),
        (("wall", "--node", "128"), 2, "node 128"),
        (("wall", "--rate", "0"), 2, "rate 0"),
        (("wall", "--rate", "nan"), 2, "rate nan"),
        (("wall", "--duration", "0"), 2, "duration 0"),
        (("wall", "--duration", "-1"), 2, "duration -1"),
        (("wall", "--seed", "-1"), 2, "seed -1"),
        (("wall", "--bus", "simm"), 2, "nearest: sim"),
        (("wall", "--bus", "modbus-tcp:10.0.0.1:x"), 2, "expected a port after the host, 1 to 65535"),
        (("wall", "--hand", "pusk"), 2, "push"),
        (("wall", "--set", "wall.stiffness"), 2, "element.parameter=value"),
        (("wall", "--change", "wall.stiffness=4"), 2, "SECONDS:element.parameter=value"),
        (("wall", "--change", "20:wall.stiffness=4"), 2, "below the duration"),
        (("wall", "--change", "2:wall.stifness=4"), 2, "nearest: stiffness"),
        (("wall", "--change", "2:wall.stiffness=3000"), 4, "exceeds the limit of 750 N/m"),
        (("wall", "--change", "2:wall.damping=3"), 4, "which this run does not estimate: start a new run"),
        (("wall", "--set", "wall.stiffness=-1"), 2, "wall.stiffness"),
        (("wall", "--set", "wall.stiffness=nan"), 2, "wall.stiffness"),
        (("wall", "--set", "wall.stifness=1"), 2, "nearest: stiffness"),
        (("wall", "--set", "wal.stiffness=1"), 2, "nearest: wall"),
        (("sprung_mass", "--method", "exact-fo"), 2, "exact-foh"),
        (("damped_wall", "--estimator", "backwards"), 2, "backward-difference"),
        (("wall", "--rig", "no.toml"), 2, "no such file"),
        (("wall", "--rig", "no.toml", "--drive", "maxon_epos4", "--node", "3"), 2, "omit --drive and --node"),
        (("wall", "--faults", "no.toml"), 2, "no such file"),
        (("wall", "--plot", "picture.txt"), 2, "suffix must be one of .png"),
        (("wall", "--plot", "no folder/picture.png"), 2, 'picture.png": no folder no folder'),
        (("wall", "--record", "frames.txt"), 2, "suffix must be one of .log"),
        (("wall", "--node", "one"), 2, "Invalid value"),
        (("wall", "--nope"), 2, "No such option"),
        ((), 2, "expected SCENE or --from FILE"),
        (("wall", "--set", "wall.stiffness=3000"), 4, "3000 N/m exceeds the limit of 750 N/m on this bench"),
        (("wall", "--drive", "generic_cia402", "--rate", "8000"), 4, "Fits: --rate"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_what_cannot_be_done_is_said_in_a_sentence(
    words: tuple[str, ...],
    status: int,
    sentence: str,
    command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    finished = command("run", *words)
    assert finished.status == status
    assert sentence in finished.err
    assert "Traceback" not in finished.err
    assert not list(tmp_path.iterdir())


def test_a_linear_scene_on_a_rotary_bench_is_refused(command: Command, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(
        """
        [bus.can0]
        interface = "haptic_sim"
        channel = "sim"
        [axis.handle]
        bus = "can0"
        node = 5
        profile = "maxon_epos4"
        rated_torque = 0.4
        encoder_counts_per_revolution = 4096
        inertia = 4.0e-5
        viscous_damping = 1.0e-4
        coulomb_friction = 2.0e-3
        [axis.handle.mechanism]
        kind = "rotary"
        """
    )
    finished = command("run", "wall", "--rig", str(rig))
    assert finished.status == 2
    assert "linear" in finished.err
    assert "rotary" in finished.err


def test_a_refused_run_still_prints_what_is_known(command: Command) -> None:
    finished = command("run", "wall", "--set", "wall.stiffness=3000", "--json")
    assert finished.status == 4
    result = json.loads(finished.out)
    assert list(result) == KEYS
    assert result["stability"]["verdict"] == "unstable"
    assert (result["cycles"], result["torque_error"], result["verdict"]) == (None, None, None)
    assert "refused" in finished.err


def test_force_overrides_instability_and_says_so(command: Command) -> None:
    finished = command("run", "wall", "--set", "wall.stiffness=1600", "--force", "--hand", "none", *SHORT)
    assert finished.status in (0, 3)
    assert "Unstable" in finished.out


def test_a_picture_and_the_frames_are_left_behind(command: Command, tmp_path: Path) -> None:
    picture, frames = tmp_path / "run.png", tmp_path / "run.log"
    finished = command("run", "wall", "--plot", str(picture), "--record", str(frames), *SHORT)
    assert finished.status == 0
    assert str(picture) in finished.out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert " 080#" in frames.read_text()


def test_a_rotary_bench_speaks_of_torque(command: Command, tmp_path: Path) -> None:
    scene = tmp_path / "knob.toml"
    scene.write_text(
        """
        [axis.knob]
        workspace = "rotary"
        [[element]]
        kind = "wall"
        axis = "knob"
        position = 0.1
        stiffness = 0.05
        """
    )
    finished = command("run", str(scene), *SHORT)
    assert finished.status == 0
    assert "stiffness 0.05 N·m/rad at 0.1 rad" in finished.out
    assert "torque error" in finished.out


def test_without_matplotlib_a_picture_is_refused_before_anything_runs(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(options, "find_spec", lambda name: None)
    finished = command("run", "wall", "--plot", str(tmp_path / "run.png"))
    assert finished.status == 2
    assert "pip install -e '.[plot]'" in finished.err
    assert finished.out == ""


def test_a_bit_rate_that_cannot_be_known_is_said(command: Command) -> None:
    finished = command("plan", "wall", "--bus", "socketcan:can0")
    assert "1 Mbit/s is assumed" in finished.err
    assert "assumed" not in command("plan", "wall", "--bus", "socketcan:can0@500000").err


def test_on_a_real_bus_an_unknown_bench_is_refused(command: Command) -> None:
    finished = command("run", "wall", "--bus", "virtual:nobody@1000000")
    assert finished.status == 4
    assert "inertia" in finished.err


def test_without_a_person_only_yes_enables_a_drive() -> None:
    with pytest.raises(UsageError, match="--yes"):
        module.ask("about to enable torque\nEnable?")


@pytest.mark.parametrize(("words", "status"), [(("run", "wall", *SHORT), 0), (("rehearse",), 2)])
def test_a_closed_standard_input_is_no_terminal(
    words: tuple[str, ...], status: int, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", None)
    finished = command(*words)
    assert finished.status == status
    assert finished.err == ("" if status == 0 else "no terminal to confirm on; add --yes\n")
    with pytest.raises(UsageError, match="--yes"):
        module.ask("about to enable torque\nEnable?")


def test_what_yes_answers_is_printed_with_the_answer_in_place_of_the_question(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert module.tell_question("can0: listened for 1 s\nabout to enable torque\nEnable torque?")
    printed = capsys.readouterr()
    assert printed.err == "can0: listened for 1 s\nabout to enable torque\nEnabled by --yes.\n"
    assert printed.out == ""


SOFT = ("wall", "--set", "wall.stiffness=10", "--duration", "3")
"""A wall that the hand pushes through, up to the limit of the travel."""
FULL = Path("/dev/full")


@pytest.mark.thorough("draws a picture", quick=1)
@pytest.mark.parametrize("as_json", [False, True])
def test_a_run_that_trips_is_drawn_up_to_its_trip(command: Command, tmp_path: Path, *, as_json: bool) -> None:
    picture = tmp_path / "trip.png"
    finished = command("run", *SOFT, "--plot", picture, *["--json"] * as_json)
    assert finished.status == 3
    with Image.open(picture) as drawn:
        content = json.loads(drawn.info[CONTENT])
    assert any(text.startswith("Tripped 0.877 s after enabling: position") for text in content["texts"])
    assert "commanded" in content["texts"]
    assert finished.err.startswith("tripped    0.877 s after enabling: position"), "the last text, and the only one"
    if as_json:
        assert json.loads(finished.out)["trips"][0]["name"] == "position limit"
    else:
        assert finished.out.endswith(f"plot       {picture}\n")


def test_a_run_that_enabled_no_drive_says_why_it_is_not_drawn(command: Command, tmp_path: Path) -> None:
    picture = tmp_path / "refused.png"
    finished = command("run", "wall", "--set", "wall.stiffness=100000", "--plot", picture)
    assert (finished.status, picture.exists()) == (4, False)
    assert finished.err.startswith("plot       not drawn: the drive was not enabled\nrefused    100000 N/m exceeds")


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
@pytest.mark.thorough("draws a picture for each format")
@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_a_disk_that_is_full_when_the_picture_is_drawn_is_no_wrong_usage(
    command: Command, tmp_path: Path, suffix: str
) -> None:
    picture = tmp_path / f"full.{suffix}"
    picture.symlink_to(FULL)
    told = f'failed     plot "{picture}": cannot be written: No space left on device'
    finished = command("run", "wall", "--plot", picture, *SHORT)
    assert (finished.status, finished.err.strip()) == (1, told)
    finished = command("run", "wall", "--plot", picture, "--json", *SHORT)
    assert finished.status == 1
    assert json.loads(finished.out)["scene"] == "wall", "one object"
    finished = command("run", *SOFT, "--plot", picture)
    assert finished.status == 3, "the trip goes before"
    first, *_, last = finished.err.splitlines()
    assert first == told
    assert last.startswith("tripped")


def test_faults_of_a_seed_are_printed_as_a_file_that_repeats_them(command: Command, tmp_path: Path) -> None:
    seeded = command("run", "wall", "--duration", "0.4", "--faults", "random@7", "--record", str(tmp_path / "a.log"))
    assert seeded.err.startswith("# random@7, 0.4 s\n[[fault]]\nkind = ")
    path = tmp_path / "faults.toml"
    path.write_text(seeded.err.partition("\nfailed")[0].partition("\ntripped")[0], encoding="utf-8")
    again = command("run", "wall", "--duration", "0.4", "--faults", str(path), "--record", str(tmp_path / "b.log"))
    assert again.status == seeded.status
    assert (tmp_path / "a.log").read_bytes() == (tmp_path / "b.log").read_bytes()


def test_a_seed_that_is_none_is_refused(command: Command) -> None:
    refused = command("run", "wall", "--faults", "random@x")
    assert refused.status == 2
    assert 'faults "random@x": expected a whole number' in refused.err

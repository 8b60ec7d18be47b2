"""Command `identify`."""

import json
import math
import signal
from pathlib import Path

import pytest

import haptic_fieldbus
from haptic_fieldbus.numerals import rounded_limit
from haptic_fieldbus.recordings.provenance import digest
from tests.api.test_identification import rig_text
from tests.cli.command import Command
from tests.recordings.test_provenance import told_by

KEYS = "axis values stribeck waves rate_hz travel speed effort torque limit residual samples scale warnings written"


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text("viscous_damping = 1.0e-4"), encoding="utf-8")
    return path


def test_a_dry_run_says_what_would_move_and_changes_nothing(rig: Path, command: Command) -> None:
    before = rig.read_text(encoding="utf-8")
    ended = command("identify", "--rig", rig, "--dry-run")
    assert ended.status == 0
    assert "axis handle: the handle moves by itself, from -0.1 m to 0.1 m" in ended.out
    assert "25 % of rated torque" in ended.out
    told = json.loads(command("identify", "--rig", rig, "--dry-run", "--json").out)
    assert any("25 % of rated torque" in line for line in told["move"])
    assert rig.read_text(encoding="utf-8") == before


@pytest.mark.thorough("measures a bench, and draws it")
def test_the_values_are_told_drawn_and_written(rig: Path, tmp_path: Path, command: Command) -> None:
    picture, before = tmp_path / "bench.png", digest(rig.read_text(encoding="utf-8"))
    ended = command("identify", "--rig", rig, "--plot", picture)
    assert ended.status == 0, ended.err
    assert "the rig states 0.3 mN·m·s/rad, measured" in ended.out
    assert "fix a known mass to the handle and repeat with --with-mass" in " ".join(ended.out.split())
    assert f"[axis.handle.identified] written into {rig}" in ended.out
    limit = haptic_fieldbus.stability("wall", rig).limit
    assert limit.basis.value == "identified"
    assert f"limit      {rounded_limit(limit.value)} N/m for a wall at 1000 Hz" in ended.out
    assert picture.stat().st_size > 10_000
    assert told_by(picture)["files"] == {rig.name: before}, "the rig file as it was before the values were written"


def test_a_handle_that_is_faster_than_allowed_is_told_with_the_options_of_this_command(
    rig: Path, command: Command
) -> None:
    """A light handle, which the first pulses make fast."""
    text = rig.read_text(encoding="utf-8")
    rig.write_text(text.replace("viscous_damping = 1.0e-4", "inertia = 1e-6"), encoding="utf-8")
    ended = command("identify", "--rig", rig, "--speed", "0.02")
    assert ended.status == 3
    told = " ".join(ended.err.split())
    assert "above the limit of 0.018 m/s; torque is off." in told
    assert "lower --effort, or raise --speed, up to axis.handle.limits.speed of the rig." in told
    assert "scene" not in told
    assert "at most 12.6 N (25 % of rated torque) and 0.018 m/s; beyond these" in ended.out, "the same limit"


def test_a_part_is_skipped_and_not_announced(rig: Path, command: Command) -> None:
    before = rig.read_text(encoding="utf-8")
    ended = command("identify", "--rig", rig, "--skip", "dynamics")
    assert ended.status == 0, ended.err
    assert "first run: rest, slow pushes until it moves\n" in ended.out
    assert "second run" not in ended.out
    assert " N·m forward, " in ended.out or "mN·m forward, " in ended.out
    assert "nothing is written into the rig" in " ".join(ended.out.split())
    assert rig.read_text(encoding="utf-8") == before


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--rate", "0"), "rate 0: expected a rate above 0"),
        (("--rate", "nan"), "rate nan: expected a rate above 0"),
        (("--skip", "motion"), "--skip motion: expected one of rest, friction, dynamics"),
        (("--skip", "friction", "--skip", "dynamics"), "nothing would be measured"),
        (("--skip", "dynamics", "--with-mass", "0.2"), "--skip dynamics: expected without an added mass"),
        (("--skip", "dynamics", "--plot", "bench.png"), "--skip dynamics: expected without --plot"),
    ],
)
def test_what_cannot_be_skipped_or_asked_is_refused(
    rig: Path, command: Command, words: tuple[str, ...], complaint: str
) -> None:
    ended = command("identify", "--rig", rig, *words)
    assert ended.status == 2
    assert complaint in ended.err


@pytest.mark.thorough("measures a bench")
def test_json_has_every_value_with_its_interval(rig: Path, command: Command) -> None:
    ended = command("identify", "--rig", rig, "--bus", "sim", "--json")
    assert ended.status == 0, ended.err
    found = json.loads(ended.out)
    assert list(found) == KEYS.split()
    assert set(found["values"]) == {
        "inertia", "viscous_damping", "coulomb_friction", "delay", "torque_lag", "delay_and_lag", "load",
        "breakaway_forward", "breakaway_backward",
    }  # fmt: skip
    for each in found["values"].values():
        assert each["low"] <= each["value"] <= each["high"]
        assert set(each) == {"value", "low", "high", "unit", "reason", "stated"}
    assert found["written"] is None
    assert found["limit"]["basis"] == "identified"
    assert found["limit"]["unit"] == "N/m"
    assert found["torque"] == pytest.approx(found["effort"] * 0.05 / math.tau)
    assert "keep hands off" in ended.err


def test_a_load_that_falls_is_told_and_nothing_is_written(rig: Path, command: Command) -> None:
    text = rig_text("gravity = { torque = 0.005 }")
    rig.write_text(text, encoding="utf-8")
    ended = command("identify", "--rig", rig)
    assert ended.status == 3
    assert "moves while no effort acts on it" in ended.err
    assert "torque is off" in ended.err
    assert rig.read_text(encoding="utf-8") == text


@pytest.mark.thorough("begins to measure a bench six times", quick=("breakaway-2-130", "motion-15-143"))
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("stage", ["breakaway", "motion", "fit"])
def test_a_signal_ends_it_with_its_status_and_nothing_is_written(
    stage: str, number: int, status: int, rig: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def told(label: str, text: str) -> None:
        if (label, text) == ("stage", stage):
            signal.raise_signal(number)

    monkeypatch.setattr("haptic_fieldbus.cli.identify._show_progress", told)
    before = rig.read_text(encoding="utf-8")
    ended = command("identify", "--rig", rig)
    assert ended.status == status
    assert "tripped" not in ended.err
    assert (
        ended.err.splitlines()[-1] == f"stopped by {'you' if number == signal.SIGINT else 'SIGTERM'}; the motor is off"
    )
    assert rig.read_text(encoding="utf-8") == before


def test_a_command_without_a_rig_is_wrong_usage(command: Command) -> None:
    assert command("identify").status == 2

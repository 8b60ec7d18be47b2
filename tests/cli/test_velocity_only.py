"""Messages of the command line about a drive that offers velocity only."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.builders import EXAMPLE, canopen
from tests.cli.command import Command
from tests.velocity_only import velocity_only


def test_stability_names_the_tachometer_and_says_why_nothing_is_passive(command: Command, tmp_path: Path) -> None:
    finished = command("stability", "damped_wall", "--drive", str(velocity_only(tmp_path)))
    assert "tachometer step 0.833 µm" in finished.out
    assert "not passive" in finished.out
    assert "between two steps" in finished.out
    assert "passive limit 0: with a sampled velocity no stiffness is passive" in finished.err


def test_stability_as_json_tells_the_device_with_its_tachometer(command: Command, tmp_path: Path) -> None:
    found = json.loads(command("stability", "wall", "--drive", str(velocity_only(tmp_path)), "--json").out)
    assert found["plant"]["tachometer"] is True
    assert found["stiffness_limit"]["passive"] == 0.0


@pytest.mark.thorough("judges a grid of walls")
def test_the_region_of_a_tachometer_is_drawn(command: Command, tmp_path: Path) -> None:
    picture = tmp_path / "region.png"
    command("stability", "damped_wall", "--drive", str(velocity_only(tmp_path)), "--plot", str(picture))
    assert picture.stat().st_size > 10_000


def test_a_profile_shows_its_velocity_and_no_position(command: Command, tmp_path: Path) -> None:
    path = velocity_only(tmp_path)
    assert command("profiles", "check", str(path)).status == 0
    shown = command("profiles", "show", str(path)).out
    assert "606Ch int32 rpm" in shown
    assert "position.actual" not in shown
    assert json.loads(command("profiles", "show", str(path), "--json").out)["position"] is None


def test_an_unstable_scene_is_refused_with_what_would_be_stable(command: Command, tmp_path: Path) -> None:
    drive = ("--drive", str(velocity_only(tmp_path)))
    refused = command("run", "damped_wall", *drive, "--set", "wall.stiffness=5000")
    assert refused.status != 0
    hint = re.search(r"Inside the limit: --set (wall\.stiffness=\d+)", refused.err)
    assert hint is not None
    assert "verdict    stable" in command("stability", "damped_wall", *drive, "--set", hint[1]).out


def test_the_shipped_example_is_the_generic_drive_with_a_tachometer_alone(tmp_path: Path) -> None:
    example, made = (canopen(name) for name in (EXAMPLE, str(velocity_only(tmp_path))))
    assert example.position is None
    assert replace(
        made, name=EXAMPLE, drive=example.drive, identity=example.identity, sources=example.sources
    ) == replace(example, source=made.source)


@pytest.mark.thorough("runs until the position has drifted")
def test_the_shipped_example_ends_by_drift_after_twelve_seconds(command: Command) -> None:
    finished = command("run", "damped_wall", "--drive", EXAMPLE, "--duration", "13")
    assert finished.status == 3
    assert "12.000 s after enabling" in finished.err
    assert "add up" in finished.err

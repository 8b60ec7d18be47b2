"""`response` on the command line: the contract of its keys, and what it says."""

import json
import math
from pathlib import Path

import pytest

from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.cli.command import Command

KEYS = ["time", "position", "force", "states", "spectral_radius", "diverged"]


@pytest.mark.thorough("every scene of the library", quick=("wall", "sprung_mass"))
@pytest.mark.parametrize("scene", scene_names())
def test_the_json_object_has_the_keys_of_the_contract(scene: str, command: Command) -> None:
    finished = command("response", scene, "--json")
    assert finished.status == 0
    found = json.loads(finished.out)
    assert list(found) == KEYS
    assert len(found["time"]) == len(found["position"]) == len(found["force"]) == 1001
    assert found["diverged"] is False


@pytest.mark.parametrize("method", METHODS)
def test_the_lectures_step_can_be_had_with_every_method(method: str, command: Command) -> None:
    found = json.loads(command("response", "sprung_mass", "--method", method, "--json").out)
    assert list(found["states"]) == ["position", "velocity"]
    assert found["states"]["position"][0] == pytest.approx(0.0, abs=1e-15)
    assert found["force"][0] == pytest.approx(-200.0, rel=1e-14)
    assert found["spectral_radius"] == pytest.approx(METHODS[method].oscillator_growth(20e-3), abs=1e-12)


def test_what_diverges_is_flagged_and_told(command: Command) -> None:
    options = ("--method", "forward-euler", "--rate", "5", "--duration", "500")
    finished = command("response", "sprung_mass", *options, "--json")
    found = json.loads(finished.out)
    assert finished.status == 0
    assert found["diverged"] is True
    assert all(map(math.isfinite, found["force"]))
    assert "no longer finite" in finished.err
    assert "diverged: " in command("response", "sprung_mass", *options).out


@pytest.mark.parametrize(
    ("method", "word"),
    [("forward-euler", "grows"), ("backward-euler", "decays"), ("exact-foh", "neither grows nor decays")],
)
def test_the_text_tells_how_a_method_grows(method: str, word: str, command: Command) -> None:
    out = command("response", "sprung_mass", "--method", method, "--input", "sine@2", "--amplitude", "0.1").out
    assert f"a free motion {word}" in out
    assert "virtual position" in out


def test_a_file_is_followed(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "motion.csv"
    path.write_text("time,position\n0,0\n0.1,0.03\n")
    found = json.loads(command("response", "wall", "--input", str(path), "--json").out)
    assert found["time"][-1] == pytest.approx(0.1)
    assert found["force"][-1] == pytest.approx(-6.0)


def test_a_response_without_a_single_finite_sample_is_told_too(command: Command) -> None:
    finished = command("response", "wall", "--amplitude", "1e308")
    assert finished.status == 0
    assert "force: none" in finished.out


@pytest.mark.thorough("draws each scene", quick=1)
@pytest.mark.parametrize("scene", ["sprung_mass", "wall"])
def test_it_is_drawn(scene: str, tmp_path: Path, command: Command) -> None:
    picture = tmp_path / "response.png"
    finished = command("response", scene, "--plot", str(picture))
    assert finished.status == 0
    assert str(picture) in finished.out
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    "options", [("--input", "jump"), ("--method", "magic"), ("--set", "wall.stiffness=-1"), ("--duration", "0")]
)
def test_what_does_not_exist_is_refused_with_status_2(options: tuple[str, ...], command: Command) -> None:
    assert command("response", "wall", *options).status == 2

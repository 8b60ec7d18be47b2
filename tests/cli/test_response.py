"""`response` on the command line: the contract of its keys, and what it says."""

import json
import math
import re
from pathlib import Path

import numpy as np
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
    assert "not finite after" in finished.err
    assert "diverged: " in command("response", "sprung_mass", *options).out


@pytest.mark.parametrize(
    ("method", "word"),
    [("forward-euler", "grows"), ("backward-euler", "decays"), ("exact-foh", "neither grows nor decays")],
)
def test_the_text_tells_how_a_method_grows(method: str, word: str, command: Command) -> None:
    out = command("response", "sprung_mass", "--method", method, "--input", "sine@2", "--amplitude", "0.1").out
    assert f"a free motion {word}" in out
    assert re.search(r"virtual position .* to .* m$", out, re.MULTILINE)
    assert re.search(r"virtual velocity .* to .* m/s$", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("frequency", "told"),
    [("1e9", "0 Hz"), ("998", "2 Hz"), ("500", "0 Hz"), ("700", "300 Hz"), ("499", ""), ("2", "")],
)
def test_a_sine_that_the_samples_cannot_show_is_told(frequency: str, told: str, command: Command) -> None:
    finished = command("response", "sprung_mass", "--input", f"sine@{frequency}", "--amplitude", "0.01", "--json")
    found = json.loads(finished.out)
    assert ("half the rate" in finished.err) == bool(told)
    assert told in finished.err
    turns = np.abs(np.fft.rfft(found["position"][:1000]))
    if told:
        assert turns.max() < 1e-3 or turns.argmax() == float(told.split()[0])


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


class TestTheModel:
    def test_it_is_told_as_json_beside_the_response(self, command: Command) -> None:
        found = json.loads(command("response", "sprung_mass", "--model", "--method", "trapezoidal", "--json").out)
        assert list(found) == [*KEYS, "model"]
        model = found["model"]
        assert model["continuous"]["a"] == [[0.0, 1.0], [-400.0, 0.0]]
        assert model["continuous"]["poles"] == [[0.0, pytest.approx(-20.0)], [0.0, pytest.approx(20.0)]]
        assert (model["period_s"], model["method"]) == (0.001, "trapezoidal")
        assert model["growth"]["forward-euler"] == pytest.approx((1 + 0.02**2) ** 0.5, rel=1e-12)
        assert list(model["growth"]) == list(METHODS)

    def test_it_is_told_in_matrices_poles_and_formulas(self, command: Command) -> None:
        out = command("response", "sprung_mass", "--model").out
        assert "A [[0, 1], [-400, 0]]" in out
        assert "poles ± 20j (modulus 20)" in out
        assert "F/x = -200 s^2/(s^2 + 400)" in out
        assert "natural frequency 20 rad/s, 3.18 Hz, a period of 0.314 s, damping ratio 0" in out
        assert "x[n] to F[n] at 1 ms, virtual states by exact-foh" in out
        assert "F[n] = - 199.987 x[n]" in out
        assert "forward-euler 1.00019998" in out

    def test_a_wall_has_no_states_and_nothing_grows(self, command: Command) -> None:
        out = command("response", "damped_wall", "--model").out
        assert "no virtual states" in out
        assert "F/v = -2" in out
        assert "F/x = (-2600 z + 2000)/z" in out
        assert "growth " not in out
        assert json.loads(command("response", "wall", "--model", "--json").out)["model"]["growth"] == {}

    def test_a_memory_steps_itself_and_a_real_pole_stands_alone(self, command: Command) -> None:
        out = command("response", "generalised_maxwell", "--model").out
        assert "the memory of an element by its own exact step" in out
        assert "poles -333.333333 (modulus 333.333333), -10 (modulus 10), -1 (modulus 1)" in out

    @pytest.mark.thorough("draws")
    @pytest.mark.parametrize("scene", ["sprung_mass", "free_puck", "damped_sprung_mass"])
    def test_its_poles_are_drawn(self, scene: str, command: Command, tmp_path: Path) -> None:
        picture = tmp_path / "poles.png"
        assert command("response", scene, "--model", "--plot", picture).status == 0
        assert picture.stat().st_size > 30_000

    def test_a_picture_of_no_poles_is_refused(self, command: Command, tmp_path: Path) -> None:
        finished = command("response", "wall", "--model", "--plot", tmp_path / "poles.png")
        assert finished.status == 2
        assert "there are no poles to draw" in finished.err


@pytest.mark.parametrize(
    "options", [("--input", "jump"), ("--method", "magic"), ("--set", "wall.stiffness=-1"), ("--duration", "0")]
)
def test_what_does_not_exist_is_refused_with_status_2(options: tuple[str, ...], command: Command) -> None:
    assert command("response", "wall", *options).status == 2

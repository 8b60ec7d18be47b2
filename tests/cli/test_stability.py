"""`stability` on the command line: the contract of its keys, its exit status, and what it says."""

import json
from pathlib import Path

import pytest
from matplotlib.text import Text

import haptic_fieldbus
from haptic_fieldbus.api.stability_limits import judge_scene
from haptic_fieldbus.numerics.estimators import linear_stand_in
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.report import analysis_plots
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.cli.command import Command

KEYS = [
    "period_s", "delay_s", "plant", "stiffness", "damping", "limit", "stiffness_limit", "judged_at",
    "spectral_radius", "margin", "verdict", "own_laws",
]  # fmt: skip


@pytest.mark.thorough("every scene of the library", quick=("wall", "sprung_mass", "virtual_shaft"))
@pytest.mark.parametrize("scene", scene_names())
def test_the_json_object_has_the_keys_of_the_contract(scene: str, command: Command) -> None:
    finished = command("stability", scene, "--json")
    assert finished.status == 0
    found = json.loads(finished.out)
    assert list(found) == [*KEYS, "assumed", "ways"]
    assert found.pop("ways") == [], "CANopen has one way"
    assert list(found["stiffness_limit"]) == ["passive", "stable", "quantisation", "cautious"]
    assert found.pop("assumed") == list(haptic_fieldbus.plan(scene).assumed)
    assert found == haptic_fieldbus.stability(scene).to_json()


@pytest.mark.parametrize(
    ("options", "verdict"),
    [
        (("--mass", "0.5", "--damping", "1.2"), "passive"),
        (("--mass", "0.001", "--damping", "0.29"), "stable"),
        (("--mass", "0.5", "--damping", "1.2", "--resolution", "1e-5", "--coulomb", "1e-4"), "limit-cycle"),
        (("--mass", "0.5", "--damping", "1.2", "--delay", "5e-3"), "unstable"),
        (("--mass", "0.5"), "unstable"),
    ],
)
def test_every_verdict_ends_with_status_0(options: tuple[str, ...], verdict: str, command: Command) -> None:
    finished = command("stability", "wall", *options, "--json")
    assert (finished.status, json.loads(finished.out)["verdict"]) == (0, verdict)


def test_given_numbers_are_the_whole_device(command: Command) -> None:
    found = json.loads(command("stability", "wall", "--mass", "0.5", "--json").out)
    numbers = {"mass": 0.5, "damping": 0.0, "coulomb": 0.0, "resolution": 0.0, "torque_lag": 0.0}
    assert found["plant"] == {**numbers, "tachometer": False}
    assert found["stiffness_limit"] == {"passive": 0.0, "stable": 0.0, "quantisation": None, "cautious": 0.0}
    assert (found["delay_s"], found["margin"]) == (0.0, 0.0)


def test_a_limit_of_zero_by_quantisation_is_told_with_its_reason(command: Command) -> None:
    options = ("--mass", "0.5", "--damping", "1.2", "--resolution", "1e-5", "--json")
    finished = command("stability", "wall", *options)
    assert json.loads(finished.out)["stiffness_limit"]["quantisation"] == 0.0
    assert "no Coulomb friction bridges one encoder count" in finished.err


def test_an_estimator_that_is_not_linear_is_told(command: Command) -> None:
    finished = command("stability", "damped_wall", "--estimator", "foaw-end-fit")
    assert f"foaw-end-fit is not linear; checked with {linear_stand_in('foaw-end-fit')}" in finished.err


def test_the_text_tells_limits_with_all_and_with_less_friction(command: Command) -> None:
    out = command("stability", "wall").out
    assert [line.split()[0] for line in out.splitlines() if not line.startswith(" ")] == [
        "scene", "device", "delay", "assumed", "limit", "nominal", "radius", "verdict",
    ]  # fmt: skip
    assert "with 0.7 times damping and Coulomb friction: stable to 1044 N/m, passive to 1006 N/m" in out
    assert "verdict    passive: " in out
    assert "limit      750 N/m; 600 is inside, margin 1.25" in out


def test_a_device_without_stiffness_to_vary_is_told_so(tmp_path: Path, command: Command) -> None:
    out = command("stability", "sprung_mass", "--mass", "0.5").out
    assert "stable at no stiffness" in out


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--mass", "0"), "mass 0: expected a number from 1e-12"),
        (("--mass", "-1"), "mass -1: expected a number from 1e-12"),
        (("--mass", "0.5", "--delay", "-1"), "delay -1: expected a number from 0 up"),
        (("--set", "wall.stiffness=nan"), "wall.stiffness"),
        (("--rate", "0"), "rate 0: expected a rate above 0"),
        (("--rate", "150000"), "to 100000 Hz"),
        (("--plot", "x.doc"), "suffix"),
    ],
)
def test_what_cannot_be_is_refused_with_status_2(options: tuple[str, ...], sentence: str, command: Command) -> None:
    finished = command("stability", "wall", *options)
    assert finished.status == 2
    assert sentence in finished.err


@pytest.mark.thorough("judges a grid of walls, twice")
@pytest.mark.parametrize("options", [(), ("--mass", "0.5", "--damping", "1.2")])
def test_the_region_is_drawn(options: tuple[str, ...], tmp_path: Path, command: Command) -> None:
    picture = tmp_path / "region.png"
    finished = command("stability", "damped_wall", "--plot", str(picture), *options)
    assert finished.status == 0
    assert str(picture) in finished.out
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(("scene", "margin"), [("damped_wall", "2.81"), ("wall", "1.25")])
def test_the_picture_has_margin_and_delay_of_the_text_and_names_the_unstable_area(
    scene: str, margin: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(analysis_plots, "POINTS", 3)
    told = command("stability", scene).out
    assert f"margin {margin}" in told
    assert "delay      0.559 ms" in told
    drawn = analysis_plots.draw_region(judge_scene(Task(scene)))
    texts = {each.get_text() for each in drawn.findobj(Text)}
    assert {f"margin {margin}; period 1 ms, delay 0.559 ms", "unstable"} <= texts


def test_a_region_needs_an_element_with_stiffness_and_damping(tmp_path: Path, command: Command) -> None:
    finished = command("stability", "sprung_mass", "--plot", str(tmp_path / "region.png"))
    assert finished.status == 2
    assert "--plot needs an element with stiffness and damping" in finished.err


def test_above_the_limit_nothing_is_called_passive(command: Command) -> None:
    asked = ("wall", "--set", "wall.stiffness=1000")
    out = command("stability", *asked).out
    assert "limit      750 N/m; 1000 is above it, margin 0.75" in out
    assert "verdict    stable: above the limit; small motions decay with the nominal values" in out
    assert [line for line in out.splitlines() if "passive" in line] == [
        "           passive to 1437 N/m",
        "           with 0.7 times damping and Coulomb friction: stable to 1044 N/m, passive to 1006 N/m",
    ]
    run = command("run", *asked, "--set", "wall.position=0.001", "--duration", "1")
    assert (run.status, "passive" in run.out) == (0, False)
    assert "warning    1000 N/m exceeds the limit of 750 N/m on this bench; the loop may vibrate" in run.out + run.err
    assert run.out.endswith("; above the limit\n")


def test_max_is_the_limit(command: Command) -> None:
    """In all commands, for a stiffness and for what a stiffness follows from."""
    whole = ("--set", "wall.stiffness=max/1", "--json")
    for found in (
        json.loads(command("stability", "wall", *whole).out),
        json.loads(command("run", "wall", "--duration", "0.1", *whole).out)["stability"],
        json.loads(command("plan", "wall", *whole).out)["stability"],
    ):
        assert found["limit"] == {"value": 750.0, "unit": "N/m", "basis": "simulated"}
        assert (found["stiffness"], found["margin"]) == (750.0, 1.0)
    assert "600 N/m" not in command("plan", "wall", "--set", "wall.stiffness=max/1").out

import json
from pathlib import Path

import pytest

from haptic_fieldbus.scenes.catalogue import scene_names
from tests.cli.command import Command


def test_the_list_names_every_shipped_scene(command: Command) -> None:
    finished = command("scenes", "list")
    assert finished.status == 0
    assert [line.split()[0] for line in finished.out.splitlines()] == ["name", *scene_names()]


def test_the_json_list_has_the_keys_of_the_contract(command: Command) -> None:
    scenes = json.loads(command("scenes", "list", "--json").out)["scenes"]
    assert [scene["name"] for scene in scenes] == scene_names()
    assert all(set(scene) == {"name", "description", "axes"} for scene in scenes)
    assert {"wall", "damped_wall", "sprung_mass"} <= set(scene_names())


@pytest.mark.thorough("every scene of the library", quick=("wall",))
@pytest.mark.parametrize("name", scene_names())
def test_a_scene_is_shown_with_all_that_can_be_set(name: str, command: Command) -> None:
    shown = json.loads(command("scenes", "show", name, "--json").out)
    text = command("scenes", "show", name).out
    assert shown["name"] == name
    assert shown["description"] in text
    for element in shown["elements"]:
        assert element["kind"]
        for parameter in set(element) - {"kind", "name", "axis", "axes"}:
            assert f"{element['name']}.{parameter}" in text


def test_parameters_have_their_unit(command: Command) -> None:
    text = command("scenes", "show", "damped_wall").out
    rows = {line.split()[0]: line.split()[1:] for line in text.splitlines() if "." in line.partition(" ")[0]}
    assert rows["wall.stiffness"] == ["600", "N/m"]
    assert rows["wall.damping"] == ["2", "N·s/m"]
    assert rows["wall.position"] == ["0.02", "m"]


@pytest.mark.thorough("judges two scenes on every drive")
def test_values_are_shown_as_a_file_gives_them(command: Command) -> None:
    """And nothing where there is none, without a unit."""
    text = command("scenes", "show", "needle").out + command("scenes", "show", "spring").out
    rows = {line.split()[0]: line.split()[1:] for line in text.splitlines() if "." in line.partition(" ")[0]}
    assert (rows["needle.heals"], rows["spring.positive_saturation"]) == (["true"], ["-"])


def test_all_shipped_scenes_are_checked_when_none_is_named(command: Command) -> None:
    finished = command("scenes", "check")
    assert finished.status == 0
    assert finished.out.splitlines() == [f"{name}: no fault" for name in scene_names()]


def test_faults_of_a_scene_are_listed(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(
        '[axis.handle]\nworkspace = "linear"\n[[element]]\nkind = "wall"\naxis = "hand"\nstiffness = -1.0\n'
    )
    finished = command("scenes", "check", str(path), "--json")
    assert finished.status == 2
    errors = json.loads(finished.out)["errors"]
    assert {error["line"] for error in errors} == {5, 6}


def test_an_unknown_scene_is_answered_with_the_nearest_names(command: Command) -> None:
    finished = command("scenes", "show", "wal")
    assert (finished.status, finished.out) == (2, "")
    assert "wall" in finished.err


def test_a_scene_is_shown_with_its_limit_on_each_profile(command: Command) -> None:
    """The limit that `stability` tells."""
    limit = json.loads(command("stability", "wall", "--json").out)["limit"]
    shown = f"maxon_epos4: {limit['value']:g} N/m; 600 is inside, margin {limit['value'] / 600:.3g}"
    assert shown in command("scenes", "show", "wall").out
    assert json.loads(command("scenes", "show", "wall", "--json").out)["limit"] == limit
    assert "maxon_epos4: none: no stiffness to vary" in command("scenes", "show", "damper").out


def test_a_scene_says_for_which_drives_it_is_made(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "fast.toml"
    path.write_text(
        'made_for.rate = 1000.0\n[axis.handle]\nworkspace = "linear"\n'
        '[[element]]\nkind = "damper"\naxis = "handle"\ndamping = 1.0\n'
    )
    assert "made for   drives with 1000 Hz or more" in command("scenes", "show", str(path)).out
    shown = json.loads(command("scenes", "show", str(path), "--json").out)
    assert shown["made_for"] == {"rate": 1000.0, "drive": None}

"""The key `made_for` of a scene file: the drives on whose bench the scene is inside its limit."""

from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.errors import SceneError
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.element_checks import check_kinds
from haptic_fieldbus.scenes.scene import MadeFor
from tests.scenes.test_passivity_key import WALL, written


def test_a_scene_is_made_for_every_drive_unless_it_says_otherwise(tmp_path: Path) -> None:
    assert load_scene(written(tmp_path, "plain", WALL)).made_for is None
    fast = load_scene(written(tmp_path, "fast", f"made_for.rate = 1000.0\n{WALL}"))
    assert (fast.made_for, str(fast.made_for)) == (MadeFor(rate=1000.0), "drives with 1000 Hz or more")
    one = load_scene(written(tmp_path, "one", f'made_for = {{ drive = "maxon_epos4", rate = 500.0 }}\n{WALL}'))
    assert str(one.made_for) == "maxon_epos4 and drives with 500 Hz or more"


def test_what_an_included_scene_is_made_for_is_not_what_the_whole_is_made_for(tmp_path: Path) -> None:
    written(tmp_path, "inner", f"made_for.rate = 1000.0\n{WALL}")
    outer = written(tmp_path, "outer", 'include = ["./inner.toml"]\n[axis.handle]\nworkspace = "linear"\n')
    assert load_scene(outer).made_for is None


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("made_for = {}", "made_for: empty; expected rate or drive"),
        ("made_for.rate = 0.0", r"made_for\.rate: 0"),
        ('made_for.drive = ""', r"made_for\.drive"),
        ("made_for.speed = 1.0", r"made_for\.speed"),
    ],
)
def test_a_wrong_one_is_a_fault_of_the_file(tmp_path: Path, text: str, fault: str) -> None:
    with pytest.raises(SceneError, match=fault):
        load_scene(written(tmp_path, "wrong", f"{text}\n{WALL}"))


def test_a_scene_in_python_has_a_value_of_its_kind() -> None:
    scene = load_scene("wall")
    check_kinds(replace(scene, made_for=MadeFor(drive="maxon_epos4")))
    with pytest.raises(TypeError, match=r"^scene: made_for: expected a MadeFor or None, not 'x' \(str\)$"):
        check_kinds(replace(scene, made_for="x"))  # type: ignore[arg-type]

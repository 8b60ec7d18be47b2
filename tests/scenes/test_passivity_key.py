"""The key `passivity` of a scene file."""

from pathlib import Path

import pytest

from haptic_fieldbus.errors import SceneError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from tests.builders import PROFILE, rig_of

WALL = '[axis.handle]\nworkspace = "linear"\n[[element]]\nkind = "wall"\naxis = "handle"\nstiffness = 600.0\n'


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_scene_observes_unless_it_says_otherwise(tmp_path: Path) -> None:
    assert load_scene(written(tmp_path, "plain", WALL)).passivity == "observer"
    assert not any(load_scene(scene).controlled for scene in scene_names())


def test_a_scene_that_controls_says_so_in_its_plan(tmp_path: Path) -> None:
    scene = load_scene(written(tmp_path, "controlled", f'passivity = "controller"\n{WALL}'))
    assert scene.controlled
    steps = compile_plan(scene, rig_of(scene), {PROFILE.name: PROFILE}, 1000.0).steps
    assert sum("passivity controller" in step for step in steps) == 1
    plain = load_scene("wall")
    assert not any(
        "controller" in step for step in compile_plan(plain, rig_of(plain), {PROFILE.name: PROFILE}, 1000.0).steps
    )


def test_the_last_file_that_says_it_counts(tmp_path: Path) -> None:
    written(tmp_path, "inner", f'passivity = "controller"\n{WALL}')
    outer = written(tmp_path, "outer", 'include = ["./inner.toml"]\n[axis.handle]\nworkspace = "linear"\n')
    assert load_scene(outer).controlled
    other = written(
        tmp_path, "other", 'passivity = "observer"\ninclude = ["./inner.toml"]\n[axis.handle]\nworkspace = "linear"\n'
    )
    assert not load_scene(other).controlled


def test_another_word_is_a_fault_of_the_file(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"passivity.*observer.*controller"):
        load_scene(written(tmp_path, "wrong", f'passivity = "damping"\n{WALL}'))

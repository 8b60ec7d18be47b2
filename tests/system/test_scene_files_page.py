"""The scene that docs/reference/scene_files.md shows works as it stands there, and can be rendered."""

import re
from dataclasses import fields
from pathlib import Path

import haptic_fieldbus
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.files import AxisSection, SceneFile

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "scene_files.md").read_text(encoding="utf-8")
(SHOWN,) = re.findall(r"^```toml\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_scene_that_is_shown_is_stable_on_the_simulated_bench(tmp_path: Path) -> None:
    path = tmp_path / "box.toml"
    path.write_text(SHOWN, encoding="utf-8")
    result = haptic_fieldbus.run(load_scene(path), duration=1.5)
    assert result.trips == ()
    assert (result.verdict or "").startswith("Feels right: ")


def test_every_key_of_a_scene_file_has_its_line() -> None:
    keys = set(re.findall(r"^\| `([^`]+)`", TEXT, re.MULTILINE))
    frame = {field.name for field in fields(SceneFile)} - {"axis", "element"}
    assert frame | {f"axis.NAME.{field.name}" for field in fields(AxisSection)} <= keys

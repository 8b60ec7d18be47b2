"""The JSON Schemas for editors say the same as the loaders."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.protocols.catalogue import load_profile, profile_folder, profile_names, profile_schema, rig_schema
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names, scene_schema
from haptic_fieldbus.schemas import main, schema_texts
from tests.cases import every
from tests.drive.test_profile_files import COMPLETE as PROFILE
from tests.drive.test_rig_files import COMPLETE as RIG
from tests.scenes.test_scene_files import TWO_WALLS as SCENE

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference" / "schemas"
TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "null": (),
    "integer": (int,),
    "number": (int, float),
}


def conforms(root: dict[str, Any], node: dict[str, Any], value: Any) -> bool:
    """A validator for the part of JSON Schema (draft 2020-12) that the exported files use."""
    if "$ref" in node:
        return conforms(root, root["$defs"][node["$ref"].removeprefix("#/$defs/")], value)
    if "oneOf" in node:
        return sum(conforms(root, option, value) for option in node["oneOf"]) == 1
    if "anyOf" in node:
        return any(conforms(root, option, value) for option in node["anyOf"])
    if "enum" in node and value not in node["enum"]:
        return False
    if "const" in node and value != node["const"]:
        return False
    if "type" in node:
        boolean = isinstance(value, bool)
        if not isinstance(value, TYPES[node["type"]]) or boolean is not (node["type"] == "boolean"):
            return False
    return within(node, value) and all(conforms(root, child, item) for child, item in children(node, value))


def within(node: dict[str, Any], value: Any) -> bool:
    checks: dict[str, Callable[[Any], bool]] = {
        "minimum": lambda bound: value >= bound,
        "maximum": lambda bound: value <= bound,
        "exclusiveMinimum": lambda bound: value > bound,
        "pattern": lambda pattern: re.search(pattern, value) is not None,
        "minLength": lambda bound: len(value) >= bound,
        "minItems": lambda bound: len(value) >= bound,
        "maxItems": lambda bound: len(value) <= bound,
        "minProperties": lambda bound: len(value) >= bound,
        "required": lambda names: set(names) <= value.keys(),
    }
    if node.get("additionalProperties") is False and not value.keys() <= node["properties"].keys():
        return False
    return all(check(node[keyword]) for keyword, check in checks.items() if keyword in node)


def children(node: dict[str, Any], value: Any) -> list[tuple[dict[str, Any], Any]]:
    if isinstance(value, dict):
        rest = node.get("additionalProperties") or {}
        rest = rest if isinstance(rest, dict) else {}
        return [(node.get("properties", {}).get(key, rest), item) for key, item in value.items()]
    if isinstance(value, list):
        fixed = node.get("prefixItems", [])
        return [(fixed[i] if i < len(fixed) else node.get("items", {}), item) for i, item in enumerate(value)]
    return []


def accepts(schema: dict[str, Any], text: str) -> bool:
    return conforms(schema, schema, tomllib.loads(text))


@pytest.mark.parametrize("name", schema_texts())
def test_the_schema_files_are_those_of_the_dataclasses(name: str) -> None:
    written = (FOLDER / name).read_text(encoding="utf-8")
    assert written == schema_texts()[name], "run: make docs"


def test_there_is_no_other_schema_file() -> None:
    assert sorted(path.name for path in FOLDER.glob("*.json")) == sorted(schema_texts())


def test_the_command_writes_the_schemas(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "new")]) == 0
    assert {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "new").iterdir()} == schema_texts()
    assert main([str(tmp_path / "new"), "--shipped"]) == 0
    assert {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "new").iterdir()} == schema_texts()
    assert main([]) == 2
    assert "usage" in capsys.readouterr().err


@every("name", profile_names())
def test_a_shipped_profile_conforms(name: str) -> None:
    text = (profile_folder() / f"{name}.toml").read_text(encoding="utf-8")
    assert accepts(profile_schema(load_profile(name).drive.protocol), text)


@every("name", scene_names())
def test_a_shipped_scene_conforms(name: str) -> None:
    assert accepts(scene_schema(), Path(load_scene(name).source).read_text(encoding="utf-8"))


def test_complete_files_conform() -> None:
    assert accepts(profile_schema(), PROFILE)
    assert accepts(rig_schema(), RIG)
    assert accepts(scene_schema(), SCENE)


@pytest.mark.parametrize(
    ("schema", "text", "old", "new"),
    [
        (profile_schema(), PROFILE, "schema = 1", "schema = 2"),
        (profile_schema(), PROFILE, "schema = 1", 'schema = 1\nname = "x"'),
        (profile_schema(), PROFILE, "mode_of_operation = 10", "mode_of_operation = 200"),
        (profile_schema(), PROFILE, "tpdo_types = [1]", "tpdo_types = []"),
        (rig_schema(), RIG, 'kind = "linear"', 'kind = "rotary"'),
        (rig_schema(), RIG, "[-0.10, 0.10]", "[-0.10]"),
        (rig_schema(), RIG, "sign = -1", "sign = 0"),
        (scene_schema(), SCENE, 'kind = "wall"', 'kind = "sprung_mass"'),
        (scene_schema(), SCENE, "stiffness = 500", "stiffness = -500"),
        (scene_schema(), SCENE, "stiffness = 500", ""),
        (scene_schema(), SCENE, "stiffness = 500", 'stiffness = "stiff"'),
    ],
)
def test_what_the_loader_refuses_does_not_conform(schema: dict[str, Any], text: str, old: str, new: str) -> None:
    assert accepts(schema, text)
    assert not accepts(schema, text.replace(old, new, 1))

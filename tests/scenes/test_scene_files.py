"""Scene files: the shipped ones hold, settings reach the elements, and each way to be wrong is told."""

import contextlib
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.errors import DocumentError, SceneError, UsageError
from haptic_fieldbus.scenes.catalogue import Setting, load_scene, scene_names, scene_summaries
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type, parameters
from haptic_fieldbus.scenes.scene import SceneAxis, axes_of
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.cases import every

TWO_WALLS = """\
description = "Between two walls"
[axis.handle]
workspace = "linear"
[[element]]
kind = "wall"
name = "right"
axis = "handle"
stiffness = 500
position = 0.02
[[element]]
kind = "wall"
name = "left"
axis = "handle"
stiffness = 400.0
position = -0.02
side = "negative"
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "walls.toml"
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(folder: Path, *replacements: tuple[str, str]) -> list[str]:
    text = TWO_WALLS
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(SceneError) as caught:
        load_scene(write(folder, text))
    return [str(fault) for fault in caught.value.faults]


@every("name", scene_names())
def test_a_shipped_scene_loads_and_says_what_it_is(name: str) -> None:
    scene = load_scene(name)
    assert scene.name == name
    assert scene.description
    assert Path(scene.source).is_file()
    assert {axis for element in scene.elements for axis in axes_of(element)} <= {axis.name for axis in scene.axes}


def test_the_scenes_and_parameters_of_the_command_line_are_there() -> None:
    assert {"wall", "damped_wall", "sprung_mass"} <= set(scene_names())
    assert load_scene("wall").elements == (Wall("handle", 600.0, 0.02),)
    damped = load_scene("damped_wall").elements[0]
    assert isinstance(damped, Wall)
    assert damped.name == "wall"
    assert damped.damping > 0
    assert isinstance(load_scene("sprung_mass").elements[0], SprungMass)
    assert {"stiffness", "damping", "position"} <= set(parameters(Wall))
    assert parameters(SprungMass) == ["stiffness", "mass"]


def test_summaries_have_the_keys_of_the_command_line() -> None:
    summaries = {summary["name"]: summary for summary in scene_summaries()}
    assert list(summaries) == scene_names()
    assert summaries["wall"] == {
        "name": "wall",
        "description": "A stiff wall on the right of the workspace",
        "axes": ["handle"],
    }


def test_a_scene_file_gives_axes_and_elements_in_its_order(tmp_path: Path) -> None:
    scene = load_scene(write(tmp_path, TWO_WALLS))
    assert (scene.name, scene.description) == ("walls", "Between two walls")
    assert scene.axes == (SceneAxis("handle", Workspace.LINEAR),)
    assert scene.elements == (
        Wall("handle", 500.0, 0.02, name="right"),
        Wall("handle", 400.0, -0.02, side="negative", name="left"),
    )
    assert isinstance(scene.elements[0], Wall)
    assert isinstance(scene.elements[0].stiffness, float)


@every("kind", ELEMENTS)
def test_each_kind_of_element_has_an_axis_and_its_kind_as_its_name(kind: str) -> None:
    found = {field.name: field.default for field in fields(element_type(kind))}  # type: ignore[arg-type]  # a dataclass
    assert {"axis", "axes"} & set(found)
    assert found["name"] == kind


@every("kind", ELEMENTS)
def test_each_kind_of_element_refuses_a_key_that_it_does_not_know(tmp_path: Path, kind: str) -> None:
    text = f'[axis.a]\nworkspace = "linear"\n[[element]]\nkind = "{kind}"\nnonsense = 1\n'
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, text))
    assert any(fault.key == "element[0].nonsense" and fault.line == 5 for fault in caught.value.faults)


def test_an_unknown_name_is_answered_with_the_nearest_ones() -> None:
    with pytest.raises(UsageError) as caught:
        load_scene("damped_wal")
    assert str(caught.value).startswith('no scene "damped_wal"; nearest: damped_wall')
    assert str(caught.value).endswith(". To list them: haptic-fieldbus scenes list")


def test_settings_replace_and_add_parameters_of_named_elements(tmp_path: Path) -> None:
    scene = load_scene(
        write(tmp_path, TWO_WALLS), {"left.stiffness": 800, "right.damping": 2.5, "right.sides": "bilateral"}
    )
    assert scene.elements == (
        Wall("handle", 500.0, 0.02, damping=2.5, sides="bilateral", name="right"),
        Wall("handle", 800.0, -0.02, side="negative", name="left"),
    )


def test_a_setting_can_mend_a_file(tmp_path: Path) -> None:
    path = write(tmp_path, TWO_WALLS.replace("stiffness = 500", "stiffness = -1"))
    assert load_scene(path, {"right.stiffness": 1.0}).elements[0] == Wall("handle", 1.0, 0.02, name="right")


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("wal.stiffness", '--set wal.stiffness: no element "wal" in scene wall; nearest: wall'),
        ("wall.stifness", '--set wall.stifness: no parameter "stifness" of wall; nearest: stiffness, sides'),
        ("wall.name", '--set wall.name: no parameter "name" of wall'),
        ("wall.axis", '--set wall.axis: no parameter "axis" of wall'),
        ("stiffness", "--set stiffness: expected element.parameter, such as wall.stiffness"),
        ("wall", "--set wall: expected element.parameter, such as wall.stiffness"),
    ],
)
def test_an_unknown_element_or_parameter_is_wrong_usage(setting: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        load_scene("wall", {setting: 1.0})
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("setting", "value", "message"),
    [
        ("wall.stiffness", -3.0, "--set wall.stiffness: -3.0; expected a number from 1e-12 to 1e12"),
        ("wall.stiffness", float("nan"), "--set wall.stiffness: nan; expected a number from 1e-12 to 1e12"),
        (
            "wall.stiffness",
            "800",
            '--set wall.stiffness: "800"; expected a number without quotes, or one with its unit such as "2 N/m"',
        ),
        ("wall.damping", True, "--set wall.damping: true; expected a number from 0 to 1e9"),
        ("wall.position", float("inf"), "--set wall.position: inf; expected a number from -1e6 to 1e6"),
        ("wall.side", "left", '--set wall.side: "left"; expected "positive" or "negative"'),
    ],
)
def test_a_bad_value_names_the_setting_the_value_and_what_was_expected(
    setting: str, value: Setting, message: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene("wall", {setting: value})
    assert [str(fault) for fault in caught.value.faults] == [message]


def test_a_faulty_file_is_told_before_a_setting_that_it_may_have_caused(tmp_path: Path) -> None:
    path = write(tmp_path, TWO_WALLS.replace('kind = "wall"\nname = "left"', 'kind = "wal"\nname = "left"'))
    with pytest.raises(SceneError) as caught:
        load_scene(path, {"left.stiffness": 1.0})
    assert [fault.key for fault in caught.value.faults] == ["element[1].kind"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('description = "Between two walls"', "description = 1", "line 1: description: 1; expected a string"),
        (
            '"linear"',
            '"liner"',
            'line 3: axis.handle.workspace: "liner"; expected "linear" or "rotary"; nearest: linear',
        ),
        (
            'kind = "wall"',
            'kind = "pendulm"',
            'line 5: element[0].kind: "pendulm"; expected a kind of element, see docs/reference/elements.md; '
            "nearest: pendulum",
        ),
        (
            'kind = "wall"',
            "",
            "line 4: element[0].kind: missing; expected a kind of element, see docs/reference/elements.md",
        ),
        (
            'kind = "wall"',
            "kind = [1]",
            "line 5: element[0].kind: [1]; expected a kind of element, see docs/reference/elements.md",
        ),
        (
            'name = "left"',
            "",
            'line 10: element[1].name: missing; expected a name, because the kind "wall" is used twice',
        ),
        ('"left"', '"right"', 'line 12: element[1].name: "right" is used twice; expected a unique name'),
        ('"left"', "3", "line 12: element[1].name: 3; expected a string"),
        (
            'axis = "handle"',
            'axis = "handel"',
            "line 7: element[0].axis: no [axis.handel] in this file; nearest: handle",
        ),
        ('axis = "handle"', "", "line 4: element[0].axis: missing; expected a string"),
        (
            "stiffness = 500",
            "stiffness = -500",
            "line 8: element[0].stiffness: -500; expected a number from 1e-12 to 1e12",
        ),
        (
            "stiffness = 500",
            "stiffness = nan",
            "line 8: element[0].stiffness: nan; expected a number from 1e-12 to 1e12",
        ),
        ("position = 0.02", "posishun = 0.02", "line 9: element[0].posishun: unknown key; nearest: position"),
        (
            '"negative"',
            '"negatve"',
            'line 16: element[1].side: "negatve"; expected "positive" or "negative"; nearest: negative',
        ),
    ],
)
def test_a_fault_is_told_with_key_and_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert faults_of(tmp_path, (old, new)) == [message]


def test_faults_of_frame_elements_and_rules_are_told_together(tmp_path: Path) -> None:
    faults = faults_of(
        tmp_path,
        ('"linear"', "1"),
        ("stiffness = 500", "stiffness = 0"),
        ('axis = "handle"\nstiffness = 400', 'axis = "x"\nstiffness = 400'),
    )
    assert [fault.split(":")[1].strip() for fault in faults] == [
        "axis.handle.workspace",
        "element[0].stiffness",
        "element[1].axis",
    ]


@pytest.mark.parametrize(
    "text", ["", "element = 1", "element = [1]", "element = []\n[axis]", "[[axis]]", "[[element]]"]
)
def test_a_scene_without_axes_or_elements_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, text))
    assert {fault.key.partition("[")[0].partition(".")[0] for fault in caught.value.faults} == {"axis", "element"}


def test_only_the_modules_of_the_kinds_in_use_are_imported() -> None:
    """In a new interpreter, as this one has imported all; nor is there a parser with positions without a fault."""
    script = (
        "import sys; from haptic_fieldbus.scenes.catalogue import load_scene;"
        "assert not {'pydantic', 'haptic_fieldbus.scenes.wall'} & sys.modules.keys();"
        "load_scene('wall');"
        "assert 'haptic_fieldbus.scenes.wall' in sys.modules;"
        "assert not {'haptic_fieldbus.scenes.sprung_mass', 'tree_sitter'} & sys.modules.keys()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@given(
    st.text() | st.text(alphabet='axisel_[]{}=".\n1') | st.lists(st.sampled_from(TWO_WALLS.splitlines())).map("\n".join)
)
def test_garbage_raises_nothing_but_a_document_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = write(tmp_path_factory.getbasetemp(), text)
    with contextlib.suppress(DocumentError):
        load_scene(path)

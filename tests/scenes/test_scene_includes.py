"""Scenes made of scenes, and numbers with units: what is taken together, and every way to be wrong."""

from pathlib import Path

import pytest

from haptic_fieldbus.errors import SceneError
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.files import MOST_ELEMENTS
from haptic_fieldbus.scenes.scene import SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.documents.hostile import READERS, said_of

WALL = '[[element]]\nkind = "wall"\nname = "{name}"\naxis = "handle"\nstiffness = {stiffness}\n'
AXIS = '[axis.handle]\nworkspace = "{workspace}"\n'


def write(folder: Path, name: str, *, include: str = "[]", workspace: str = "linear", walls: str = "") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(f"include = {include}\n" + AXIS.format(workspace=workspace) + walls, encoding="utf-8")
    return path


def wall(name: str, stiffness: str = "500.0") -> str:
    return WALL.format(name=name, stiffness=stiffness)


def faults_of(path: Path) -> list[str]:
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    return [str(fault) for fault in caught.value.faults]


def test_elements_of_included_files_come_first_and_settings_reach_them(tmp_path: Path) -> None:
    write(tmp_path, "base", walls=wall("inner"))
    path = write(tmp_path, "both", include='["base.toml", "wall"]', walls=wall("outer"))
    scene = load_scene(path, {"inner.stiffness": 7.0, "wall.position": 0.1})
    assert scene.axes == (SceneAxis("handle", Workspace.LINEAR),)
    assert scene.elements == (
        Wall("handle", 7.0, name="inner"),
        Wall("handle", 600.0, 0.1),
        Wall("handle", 500.0, name="outer"),
    )


def test_a_file_may_include_and_add_nothing(tmp_path: Path) -> None:
    assert load_scene(write(tmp_path, "only", include='["wall"]')).elements == load_scene("wall").elements


def test_a_circle_of_files_is_shown(tmp_path: Path) -> None:
    write(tmp_path, "second", include='["first.toml"]', walls=wall("b"))
    path = write(tmp_path, "first", include='["second.toml"]', walls=wall("a"))
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert caught.value.source == str(tmp_path / "second.toml")
    assert [str(fault) for fault in caught.value.faults] == [
        'line 1: include[0]: "first.toml"; expected no circle: first → second → first'
    ]


def test_a_file_that_includes_itself_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "self", include='["self.toml"]', walls=wall("a"))
    assert faults_of(path) == ['line 1: include[0]: "self.toml"; expected no circle: self → self']


@pytest.mark.parametrize(
    ("include", "told"),
    [
        ('["wal"]', 'line 1: include[0]: no scene "wal"; nearest: wall'),
        ('["gone.toml"]', "line 1: include[0]: "),
        ("[1]", "line 1: include[0]: 1; expected a string"),
        ('"wall"', 'line 1: include: "wall"; expected a list'),
    ],
)
def test_what_cannot_be_included_is_told(tmp_path: Path, include: str, told: str) -> None:
    (fault,) = faults_of(write(tmp_path, "scene", include=include, walls=wall("a")))
    assert fault.startswith(told)


def test_an_axis_is_the_same_in_all_files(tmp_path: Path) -> None:
    write(tmp_path, "turning", workspace="rotary", walls=wall("a"))
    (fault,) = faults_of(write(tmp_path, "scene", include='["turning.toml"]', walls=wall("b")))
    assert fault == 'line 3: axis.handle.workspace: "linear"; expected "rotary", as in an included scene'


def test_a_name_stands_once_in_all_files(tmp_path: Path) -> None:
    write(tmp_path, "base", walls=wall("a"))
    (fault,) = faults_of(write(tmp_path, "scene", include='["base.toml"]', walls=wall("a")))
    assert fault == 'line 6: element[0].name: "a" is used twice; expected a unique name'


@pytest.mark.parametrize("name", ["", "x=y"])
def test_a_name_that_a_setting_could_not_give_is_refused(tmp_path: Path, name: str) -> None:
    (fault,) = faults_of(write(tmp_path, "scene", walls=wall(name)))
    assert fault == f'line 6: element[0].name: "{name}"; expected a non-empty string, without ='


def test_faults_of_several_files_are_told_together(tmp_path: Path) -> None:
    write(tmp_path, "base", walls=wall("a", "-1"))
    first, second = faults_of(write(tmp_path, "scene", include='["base.toml"]', walls=wall("b", "nan")))
    base = tmp_path / "base.toml"
    assert first == f"in {base}: line 8: element[0].stiffness: -1; expected a number from 1e-12 to 1e12"
    assert second == "line 8: element[0].stiffness: nan; expected a number from 1e-12 to 1e12"


def test_numbers_may_carry_their_units(tmp_path: Path) -> None:
    path = write(tmp_path, "scene", walls=wall("a", '"0.5 N/mm"') + 'position = "20 mm"\n')
    assert load_scene(path, {"a.damping": "2 Ns/m"}).elements == (Wall("handle", 500.0, 0.02, damping=2.0, name="a"),)


def test_wrong_units_are_told_with_line_and_what_they_measure(tmp_path: Path) -> None:
    path = write(tmp_path, "scene", workspace="rotary", walls=wall("a", '"500 N/m"') + 'position = "20 mm"\n')
    assert faults_of(path) == [
        'line 8: element[0].stiffness: "500 N/m"; expected a stiffness in N·m/rad, because the axis is rotary; '
        "N/m is a unit of a stiffness on a linear axis",
        'line 9: element[0].position: "20 mm"; expected an angle in rad, because the axis is rotary; '
        "mm is a unit of a length on a linear axis",
    ]


def test_a_quantity_is_in_range_after_its_unit_too(tmp_path: Path) -> None:
    assert faults_of(write(tmp_path, "scene", walls=wall("a", '"-1 N/mm"'))) == [
        'line 8: element[0].stiffness: "-1 N/mm"; expected a number from 1e-12 to 1e12'
    ]


def test_a_kind_of_one_workspace_is_refused_in_the_other(tmp_path: Path) -> None:
    text = '[[element]]\nkind = "gravity"\naxis = "handle"\nmass = 1.0\n'
    (fault,) = faults_of(write(tmp_path, "scene", workspace="rotary", walls=text))
    assert fault == 'line 4: element[0]: "gravity" is for linear axes; its axis is rotary'


@pytest.mark.parametrize("name", ["../outside.toml", "inner/../../outside.toml", "link.toml", "linked/outside.toml"])
def test_a_file_outside_of_the_folder_is_not_included(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    (folder / "inner").mkdir(parents=True)
    outside = write(tmp_path, "outside", walls=wall("a"))
    (folder / "link.toml").symlink_to(outside)
    (folder / "linked").symlink_to(tmp_path)
    (fault,) = faults_of(write(folder, "scene", include=f'["{name}"]', walls=wall("b")))
    assert fault == f'line 1: include[0]: no file "{name}" in the folder of this file or below'


def test_an_absolute_path_is_not_included_even_inside_the_folder(tmp_path: Path) -> None:
    inside = write(tmp_path, "inside", walls=wall("a"))
    (fault,) = faults_of(write(tmp_path, "scene", include=f'["{inside}"]', walls=wall("b")))
    assert fault.endswith("in the folder of this file or below")


def test_an_included_file_does_not_lead_out_of_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    write(tmp_path, "beside", walls=wall("c"))
    write(tmp_path / "inner", "middle", include='["../beside.toml"]', walls=wall("b"))
    (fault,) = faults_of(write(tmp_path, "scene", include='["inner/middle.toml"]', walls=wall("a")))
    assert 'no file "../beside.toml" in the folder of this file' in fault


def test_files_below_the_folder_and_links_inside_of_it_are_included(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    write(tmp_path / "inner", "one", walls=wall("a"))
    (tmp_path / "two.toml").symlink_to("inner/one.toml")
    assert load_scene(write(tmp_path, "first", include='["inner/one.toml"]', walls=wall("b"))).elements
    assert load_scene(write(tmp_path, "second", include='["two.toml"]', walls=wall("b"))).elements


@pytest.mark.parametrize("name", ["a\\u0000.toml", "x" * 5000 + ".toml", "loop.toml"])
def test_a_path_that_cannot_be_is_told(name: str, tmp_path: Path) -> None:
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (fault,) = faults_of(write(tmp_path, "scene", include=f'["{name}"]', walls=wall("b")))
    assert fault.startswith("line 1: include[0]: ")


def test_files_that_include_ten_others_each_are_not_all_read(tmp_path: Path) -> None:
    """A billion laughs: 10⁹ files at the ninth level."""
    for level in range(9):
        names = ", ".join([f'"level{level + 1}.toml"'] * 10)
        write(tmp_path, f"level{level}", include=f"[{names}]")
    write(tmp_path, "level9", walls=wall("a"))
    said = said_of(tmp_path, {"scene": READERS["scene"].replace("x.toml", "level0.toml")})["scene"]
    assert said is not None
    assert "expected at most 32 files in all" in said


def test_there_are_at_most_some_hundred_elements_in_all_files(tmp_path: Path) -> None:
    write(tmp_path, "base", walls="".join(wall(f"a{number}") for number in range(MOST_ELEMENTS)))
    assert len(load_scene(tmp_path / "base.toml").elements) == MOST_ELEMENTS
    (fault,) = faults_of(write(tmp_path, "more", include='["base.toml"]', walls=wall("b")))
    assert fault == "element: 501 in all files; expected at most 500"

"""A scene with other parameters: the words of a file, the objects of what stays."""

from dataclasses import dataclass

import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.errors import SceneError, UsageError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.parameter_changes import changed
from haptic_fieldbus.scenes.registry import quantities
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.builders import scene_of
from tests.cases import every

TWO = scene_of(Wall("handle", 300.0), Wall("handle", 400.0, name="other"))


def test_what_no_setting_names_stays_the_same_object() -> None:
    found = changed(TWO, {"other.stiffness": "0.5 N/mm"})
    assert found.elements == (Wall("handle", 300.0), Wall("handle", 500.0, name="other"))
    assert found.elements[0] is TWO.elements[0]
    assert (found.name, found.axes) == (TWO.name, TWO.axes)


@every("name", scene_names())
def test_every_scene_of_the_library_takes_its_own_values_and_gives_itself(name: str) -> None:
    scene = load_scene(name)
    settings = {
        f"{element.name}.{parameter}": value
        for element in scene.elements
        for parameter in quantities(type(element))
        if isinstance(value := getattr(element, parameter), float | int)
    }
    assert changed(scene, settings) == scene


def test_all_faults_are_told_at_once_and_by_the_names_of_the_settings() -> None:
    with pytest.raises(SceneError) as refused:
        changed(TWO, {"wall.stiffness": -1.0, "other.damping": "2 mm"})
    assert [fault.key for fault in refused.value.faults] == ["--set wall.stiffness", "--set other.damping"]


def test_a_scene_made_in_python_takes_settings_as_one_from_a_file_does() -> None:
    found = plan(TWO, settings={"wall.stiffness": "0.8 N/mm"})
    assert found.scene.elements[0] == Wall("handle", 800.0)
    with pytest.raises(UsageError, match='no element "wal" in scene test; nearest: wall'):
        plan(TWO, settings={"wal.stiffness": 1.0})


@dataclass(frozen=True)
class Own(Wall):
    """An element of a user, which says how it is checked as its base does."""

    colour: str = "red"


def test_an_element_that_no_file_has_is_checked_by_its_own_annotations() -> None:
    scene = scene_of(Own("handle", 300.0))
    assert changed(scene, {"wall.colour": "blue"}).elements == (Own("handle", 300.0, colour="blue"),)
    with pytest.raises(SceneError, match=r"--set wall\.stiffness: -1\.0; expected a number from 1e-12"):
        changed(scene, {"wall.stiffness": -1.0})


@dataclass(frozen=True)
class Unchecked:
    """A spring that does not say how it is checked."""

    axis: str
    stiffness: float
    name: str = "own"

    def __post_init__(self) -> None:
        if self.stiffness < 0.0:
            raise ValueError("stiffness below 0")

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def force(self, position: float) -> float:
        return -self.stiffness * position

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


@pytest.mark.parametrize("text", ["0.5 N/mm", "soft"])
def test_an_element_that_takes_no_units_says_what_to_write(text: str) -> None:
    with pytest.raises(SceneError) as caught:
        plan(scene_of(Unchecked("handle", 100.0)), settings={"own.stiffness": text})
    assert [str(fault) for fault in caught.value.faults] == [
        f'--set own.stiffness: "{text}"; expected a number; Unchecked accepts units only with the line '
        "__pydantic_config__: ClassVar = STRICT and fields annotated with the types of haptic_fieldbus.scenes.element"
    ]


def test_what_an_element_refuses_itself_is_told_with_its_name() -> None:
    with pytest.raises(SceneError, match="own: stiffness below 0"):
        plan(scene_of(Unchecked("handle", 100.0)), settings={"own.stiffness": -1})
    assert changed(scene_of(Unchecked("handle", 100.0)), {"own.stiffness": 3.0}).elements[0] == Unchecked("handle", 3.0)

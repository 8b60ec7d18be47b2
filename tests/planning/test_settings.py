"""Settings of a scene, in two steps where one of them is a part of the stability limit."""

import numpy as np
import pytest

import haptic_fieldbus
from haptic_fieldbus.api import plan
from haptic_fieldbus.errors import SceneError, UsageError
from haptic_fieldbus.numerals import TYPED_DIGITS, rounded_down
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import at_limit, parsed, settled
from haptic_fieldbus.scenes.catalogue import Setting, load_scene
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import scene_of


def test_numbers_are_read_from_texts_and_the_scene_is_final() -> None:
    texts = {"wall.stiffness": "800", "wall.position": "25 mm", "wall.sides": "bilateral"}
    scene, part = settled(Task("wall", settings=texts))
    assert part is None
    assert scene.elements == (Wall("handle", 800.0, position=0.025, sides="bilateral"),)


def test_true_and_false_are_no_texts_and_what_is_no_text_stays() -> None:
    texts: dict[str, Setting] = {
        "a.on": "true",
        "a.off": "false",
        "a.unit": "25 mm",
        "a.number": "1e3",
        "a.given": 2.0,
    }
    assert parsed(texts) == {"a.on": True, "a.off": False, "a.unit": "25 mm", "a.number": 1000.0, "a.given": 2.0}
    assert parsed(None) == {}


@pytest.mark.parametrize("made", [False, True], ids=["of a file", "made in Python"])
def test_digits_alone_are_a_whole_number_for_a_parameter_that_takes_no_other(made: bool) -> None:
    scene = load_scene("knob_menu") if made else "knob_menu"
    found, _ = settled(Task(scene, settings={"entries.count": "3"}))
    entries = next(element for element in found.elements if isinstance(element, Detents))
    assert entries.count == 3
    with pytest.raises(SceneError, match=r"entries\.count: 3\.5; expected a whole number"):
        settled(Task(scene, settings={"entries.count": "3.5"}))


def test_a_value_that_cannot_even_be_shown_is_refused_by_its_kind() -> None:
    class Unseen:
        def __repr__(self) -> str:
            raise ValueError("not for you")

    with pytest.raises(TypeError, match=r"settings: a\.b: expected a number, a text, True or False, not \(Unseen\)"):
        parsed({"a.b": Unseen()})  # type: ignore[dict-item]


def test_without_settings_a_scene_made_in_python_is_itself() -> None:
    scene = scene_of(Wall("handle", 300.0))
    assert settled(Task(scene))[0] is scene


@pytest.mark.parametrize("made", [False, True], ids=["of a file", "made in Python"])
@pytest.mark.parametrize(("text", "divisor"), [("max", 1.0), ("max/2", 2.0), ("max/2.5", 2.5)])
def test_a_part_of_the_limit_waits_for_a_verdict(text: str, divisor: float, made: bool) -> None:
    scene = load_scene("damped_wall") if made else "damped_wall"
    task = Task(scene, settings={"wall.stiffness": text, "wall.damping": 3.0})
    found, part = settled(task)
    assert part == "wall.stiffness"
    assert found == load_scene("damped_wall", {"wall.damping": 3.0})
    stability = plan(found).stability
    assert stability is not None
    typed = rounded_down(stability.limit.value / divisor, TYPED_DIGITS)
    final = load_scene("damped_wall", {"wall.stiffness": typed, "wall.damping": 3.0})
    assert at_limit(task, found, part, stability) == final


def test_a_part_of_the_limit_may_be_what_the_stiffness_follows_from() -> None:
    task = Task("hunt_crossley", settings={"hunt_crossley.effort": "max/2"})
    scene, part = settled(task)
    assert part == "hunt_crossley.effort"
    stability = haptic_fieldbus.stability("hunt_crossley")
    # K = n·effort/depth, with n = 1.5 and a depth of 15 mm.
    final = at_limit(task, scene, part, stability).elements[0]
    assert final.effort == pytest.approx(stability.limit.value / 2.0 * 0.015 / 1.5, rel=0.01)  # type: ignore[attr-defined]
    with pytest.raises(UsageError, match="only a stiffness, or a parameter that determines it, can be a part"):
        settled(Task("hunt_crossley", settings={"hunt_crossley.depth": "max/2"}))
    with pytest.raises(UsageError, match="only a stiffness, or a parameter that determines it, can be a part"):
        settled(Task("damped_wall", settings={"wall.damping": "max"}))


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (
            {"wall.damping": "max/2", "wall.position": "max"},
            "only one setting may be a part of the limit, not wall.damping, wall.position",
        ),
        (
            {"wall.stiffness": "max", "other.stiffness": "max/2"},
            "only one setting may be a part of the limit, not wall.stiffness, other.stiffness",
        ),
    ],
)
def test_a_part_that_cannot_be_is_refused_before_anything_is_loaded(
    settings: dict[str, Setting], sentence: str
) -> None:
    with pytest.raises(UsageError) as refused:
        settled(Task("no such scene", settings=settings))
    assert str(refused.value) == sentence


def test_the_limit_of_coupled_axes_is_that_of_the_stiffest_coupling() -> None:
    assert settled(Task("virtual_shaft", settings={"shaft.stiffness": "max/2"}))[1] == "shaft.stiffness"
    with pytest.raises(
        UsageError,
        match=r"^wall\.stiffness=max: for coupled axes only shaft\.stiffness can be set as a part of the limit$",
    ):
        settled(Task("virtual_shaft", settings={"wall.stiffness": "max"}))


def test_without_a_limit_there_is_no_part_of_it() -> None:
    task = Task("wall", settings={"wall.stiffness": "max/2"})
    with pytest.raises(UsageError, match=r"^wall\.stiffness=max/2: this scene has no limit on this bench$"):
        at_limit(task, settled(task)[0], "wall.stiffness", None)
    with pytest.raises(UsageError, match=r"^wall\.stiffness=max/0: division of the limit by zero$"):
        haptic_fieldbus.plan("wall", settings={"wall.stiffness": "max/0"})


def test_a_number_of_numpy_is_a_number() -> None:
    assert parsed({"wall.stiffness": np.float32(500.0)}) == {"wall.stiffness": 500.0}  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (["wall.stiffness=3"], r"^settings: expected a mapping such as .* not \['wall.stiffness=3'\] \(list\)$"),
        ({"wall.stiffness": np.array([1.0, 2.0])}, r"^settings: wall\.stiffness: expected a number, .* not array"),
        ({"wall.stiffness": None}, r"^settings: wall\.stiffness: expected a number, a text, True or False, not None"),
    ],
)
def test_settings_of_the_wrong_kind_are_told_by_name(settings: object, told: str) -> None:
    with pytest.raises(TypeError, match=told):
        parsed(settings)  # type: ignore[arg-type]

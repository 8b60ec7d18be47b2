"""Elements made in Python are refused for what their files would be refused for, wherever a scene is first used."""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
import pytest

import haptic_fieldbus
from examples.own_element import HardeningSpring
from haptic_fieldbus.errors import SceneError
from haptic_fieldbus.numerals import rounded_limit
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.element import STRICT
from haptic_fieldbus.scenes.element_checks import check_elements, check_kinds
from haptic_fieldbus.scenes.registry import ELEMENTS
from haptic_fieldbus.scenes.scene import Scene, SceneAxis, axes_of
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.cases import every

PERIOD = 1e-3
ENTRANCES: dict[str, Callable[[Scene], object]] = {
    "plan": haptic_fieldbus.plan,
    "stability on a bench": haptic_fieldbus.stability,
    "stability of a device": lambda scene: haptic_fieldbus.stability(scene, mass=0.5, damping=1.0),
    "response": haptic_fieldbus.response,
    "run": lambda scene: haptic_fieldbus.run(scene, duration=0.01),
}


def made(*elements: Any) -> Scene:
    axes = dict.fromkeys(axis for element in elements for axis in axes_of(element))
    return Scene("made", "", tuple(SceneAxis(axis, Workspace.LINEAR) for axis in axes), elements)


def refusal(scene: Scene, method: str | None = None) -> str:
    with pytest.raises(SceneError) as refused:
        check_elements(scene, PERIOD, method)
    return "\n".join(str(fault) for fault in refused.value.faults)


@every("entrance", ENTRANCES)
@every("mass", [0.0, -0.0, -1.0, math.nan, math.inf])
def test_a_virtual_mass_that_cannot_be_is_refused_at_every_entrance(entrance: str, mass: float) -> None:
    with pytest.raises(SceneError, match=r"made: sprung_mass\.mass: .*; expected a number from 1e-12"):
        ENTRANCES[entrance](made(SprungMass("handle", 200.0, mass)))


@every("entrance", ENTRANCES)
@every("stiffness", [-1.0, 0.0, math.nan, math.inf])
def test_a_stiffness_that_cannot_be_is_refused_at_every_entrance(entrance: str, stiffness: float) -> None:
    with pytest.raises(SceneError, match=r"made: wall\.stiffness: .*; expected a number from 1e-12"):
        ENTRANCES[entrance](made(Wall("handle", stiffness)))


@pytest.mark.parametrize("method", METHODS)
def test_no_mass_is_refused_with_the_smallest_one_of_its_method(method: str) -> None:
    """k·(T/h)², h the method's own limit of T·√(k/m)."""
    told = refusal(made(SprungMass("handle", 200.0, 0.0)), method).partition("1e9; ")[2]
    limit = METHODS[method].oscillator_limit
    if math.isinf(limit):
        assert told == f"for a mass towards 0 {method} stays bounded, and so does the force"
    elif limit:
        least = 200.0 * (PERIOD / limit) ** 2
        assert told == f"{method} renders it without growth from {rounded_limit(least)} up, at 1000 Hz"
    else:
        assert told == f"{method} renders no mass without growth"


def test_the_smallest_mass_is_not_told_where_it_makes_no_sense() -> None:
    told = refusal(made(SprungMass("handle", math.nan, 0.0)))
    assert told.split("\n") == [
        "sprung_mass.stiffness: nan; expected a number from 1e-12 to 1e12",
        "sprung_mass.mass: 0.0; expected a number from 1e-12 to 1e9",
    ]


def test_all_faults_of_all_elements_are_told_at_once() -> None:
    scene = made(Wall("handle", -1.0, damping=-2.0), SprungMass("handle", 200.0, -3.0))
    assert refusal(scene).split("\n") == [
        "wall.stiffness: -1.0; expected a number from 1e-12 to 1e12",
        "wall.damping: -2.0; expected a number from 0 to 1e9",
        "sprung_mass.mass: -3.0; expected a number from 1e-12 to 1e9",
    ]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"stiffness": "600"}, 'wall.stiffness: "600"; expected a number from 1e-12'),
        ({"stiffness": True}, "wall.stiffness: true; expected a number from 1e-12"),
        ({"stiffness": None}, "wall.stiffness: missing; expected a number from 1e-12"),
        ({"position": None}, 'wall.position: "None"; expected a number'),
        ({"position": object()}, "wall.position: "),
        ({"side": "left"}, 'wall.side: "left"; expected "positive" or "negative"'),
        ({"name": 3}, "3.name: 3; expected a string"),
    ],
)
def test_values_of_another_kind_are_refused(changes: dict[str, Any], told: str) -> None:
    assert refusal(made(replace(Wall("handle", 600.0), **changes))).startswith(told)


def test_an_axis_that_the_scene_has_not_is_refused() -> None:
    scene = replace(made(Wall("handle", 600.0)), elements=(Wall("handel", 600.0),))
    assert refusal(scene) == "wall.axis: this scene has no axis 'handel'; nearest: handle"


@pytest.mark.parametrize("entrance", ENTRANCES.values(), ids=ENTRANCES)
def test_nor_does_an_element_that_does_not_say_how_to_check_it_vanish_with_its_axis(
    entrance: Callable[[Scene], object],
) -> None:
    own = HardeningSpring("handel", stiffness=100.0, hardening=0.0, reach=0.01, name="own")
    scene = replace(made(Wall("handle", 600.0)), elements=(Wall("handle", 600.0), own))
    with pytest.raises(SceneError, match=r"own\.axis: this scene has no axis 'handel'; nearest: handle"):
        entrance(scene)


def test_numbers_of_numpy_are_numbers() -> None:
    stiffnesses: list[Any] = [600, np.float64(3.0), np.float32(3.0), np.int64(3)]
    check_elements(made(*(Wall("handle", stiffness) for stiffness in stiffnesses)), PERIOD, None)


@every("name", scene_names())
def test_every_shipped_scene_holds(name: str) -> None:
    check_elements(load_scene(name), PERIOD, None)


@every("kind", ELEMENTS)
def test_every_kind_is_refused_with_any_number_that_is_none(kind: str) -> None:
    for example in import_module(f"tests.scenes.sheets.{kind}").SHEET.examples:
        check_elements(made(example), PERIOD, None)
        for field in fields(example):
            if isinstance(getattr(example, field.name), float):
                for wrong in (math.nan, -math.inf):
                    with pytest.raises(ValueError, match=field.name):
                        check_elements(made(replace(example, **{field.name: wrong})), PERIOD, None)


def test_an_element_of_ones_own_is_ones_own_affair() -> None:
    """Only those that say how a file gives them are held to it."""

    @dataclass(frozen=True)
    class Free:
        axis: str
        strength: float
        name: str = "mine"

    @dataclass(frozen=True)
    class Strict(Free):
        __pydantic_config__: ClassVar = STRICT

    check_elements(made(Free("handle", math.nan)), PERIOD, None)
    assert refusal(made(Strict("handle", math.nan))) == "mine.strength: nan; expected a finite number"


WALLS = made(Wall("handle", stiffness=100.0))


@every(
    ("changes", "told"),
    [
        ({"name": 3}, r"^scene: name: expected a text, not 3 \(int\)$"),
        ({"passivity": "x"}, r"^scene: passivity: expected observer or controller, not 'x' \(str\)$"),
        ({"axes": ()}, r"^scene: axes: expected a tuple of at least one SceneAxis, not \(\) \(tuple\)$"),
        ({"axes": ("handle",)}, r"^scene: axes: expected a SceneAxis of a name and a Workspace, not 'handle' \(str\)$"),
        ({"elements": Wall("handle", 1.0)}, r"^scene: elements: expected a tuple of elements, not Wall\("),
        ({"elements": ("wall",)}, r"^scene: elements: expected an element with name, needs, .* not 'wall' \(str\)$"),
    ],
)
def test_a_scene_of_the_wrong_kinds_is_told_by_its_field(changes: dict[str, Any], told: str) -> None:
    check_kinds(WALLS)
    with pytest.raises(TypeError, match=told):
        check_kinds(replace(WALLS, **changes))

"""Abilities of an element beyond its law: one list, one way to ask, one page for those who write elements."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from haptic_fieldbus.scenes import element as element_module
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.element import Abilities, AnyElement, abilities
from haptic_fieldbus.scenes.wall import Wall
from tests.cases import every

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "write_your_own_element.md"
LIBRARY: list[AnyElement] = [element for name in scene_names() for element in load_scene(name).elements]
FORMER = {
    "Active": "strongest",
    "Eventful": "by_event",
    "Graded": "with_stiffness",
    "Incremental": "increments",
    "Paced": "at_period",
    "Phased": "phases",
    "Reserving": "reserve",
    "Storing": "stored",
    "Surfaced": "penetration",
}


@every("ability", Abilities.__annotations__)
def test_an_element_that_says_nothing_has_the_default(ability: str) -> None:
    assert getattr(abilities(object()), ability) == getattr(Abilities, ability)


@every("ability", Abilities.__annotations__)
def test_an_element_says_it_by_a_member_of_any_class(ability: str) -> None:
    answer = object()
    assert getattr(abilities(SimpleNamespace(**{ability: answer})), ability) is answer


@every("ability", Abilities.__annotations__)
def test_a_shipped_element_says_each_of_them(ability: str) -> None:
    assert any(hasattr(element, ability) for element in LIBRARY)


def test_what_nobody_can_say_is_an_error() -> None:
    with pytest.raises(AttributeError, match="strength"):
        abilities(Wall("handle", 600.0)).strength  # type: ignore[attr-defined]  # noqa: B018


def test_the_guide_lists_each_of_them_once() -> None:
    table = (
        GUIDE.read_text(encoding="utf-8").partition("| member | what it says | without it |")[2].partition("\n\n")[0]
    )
    assert sorted(re.findall(r"^\| `(\w+)", table, re.MULTILINE)) == sorted(Abilities.__annotations__)


@every("name", FORMER)
def test_a_former_protocol_still_tells_who_says_it(name: str) -> None:
    former: Any = getattr(element_module, name)
    for element in LIBRARY:
        assert isinstance(element, former) == (hasattr(element, FORMER[name]))


def test_no_other_name_is_made_up() -> None:
    with pytest.raises(AttributeError, match="Sorting"):
        element_module.Sorting  # type: ignore[attr-defined]  # noqa: B018

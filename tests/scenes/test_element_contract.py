"""What every element must be, whatever it is: run over all of the registry."""

import dataclasses
import math
from importlib import import_module
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from haptic_fieldbus.numerics.integrators import bind
from haptic_fieldbus.scenes import element as element_module
from haptic_fieldbus.scenes.element import DynamicElement, Element, StaticElement
from haptic_fieldbus.scenes.registry import ELEMENTS
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

MEMBERS: dict[str, list[Element]] = {
    "wall": [
        Wall("handle", stiffness=600.0, position=0.01),
        Wall("handle", stiffness=600.0, position=0.01, damping=3.0),
        Wall("handle", stiffness=600.0, position=-0.01, damping=3.0, side="negative"),
        Wall("handle", stiffness=600.0, sides="bilateral"),
    ],
    "sprung_mass": [SprungMass("handle", stiffness=300.0, mass=0.4)],
}
"""Examples of each kind; a new kind needs at least one."""
EXAMPLES = [
    pytest.param(kind, example, id=f"{kind}-{n}") for kind in MEMBERS for n, example in enumerate(MEMBERS[kind])
]
NOT_ELEMENTS = {"__init__", "element", "scene", "registry", "catalogue"}


def test_every_kind_has_an_example_here() -> None:
    assert set(MEMBERS) == set(ELEMENTS), "add an example of the new kind to MEMBERS"


def test_every_module_beside_them_is_listed() -> None:
    modules = {path.stem for path in Path(element_module.__file__).parent.glob("*.py")} - NOT_ELEMENTS
    listed = {module.rsplit(".", 1)[-1] for module, _ in ELEMENTS.values()}
    assert modules == listed, "add a line to ELEMENTS in scenes/registry.py"


@pytest.mark.parametrize(("kind", "element"), EXAMPLES)
class TestEveryElement:
    def test_is_what_the_registry_names(self, kind: str, element: Element) -> None:
        module, name = ELEMENTS[kind]
        assert type(element) is getattr(import_module(module), name)

    def test_is_a_frozen_dataclass_named_as_its_kind_unless_told(self, kind: str, element: Element) -> None:
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(element, "axis", "another")  # noqa: B010 - an assignment would not pass the type checker
        assert element.name == kind
        assert element.axis == "handle"

    def test_can_be_written_in_a_file_and_nothing_else_can(self, kind: str, element: Element) -> None:
        adapter = TypeAdapter(type(element))
        values = adapter.dump_python(element)
        assert adapter.validate_python(values) == element
        with pytest.raises(ValueError, match="unheard_of"):
            adapter.validate_python({**values, "unheard_of": 1})

    def test_is_static_or_dynamic_and_not_both(self, kind: str, element: Element) -> None:
        assert isinstance(element, StaticElement) != isinstance(element, DynamicElement)

    def test_needs_signals_of_motion_only_and_each_once(self, kind: str, element: Element) -> None:
        assert set(element.needs) <= {Signal.POSITION, Signal.VELOCITY}
        assert len(set(element.needs)) == len(element.needs)

    def test_is_linearised_to_one_force_from_position_and_velocity(self, kind: str, element: Element) -> None:
        space = element.linearised()
        assert (space.b.shape, space.c.shape, space.d.shape) == ((space.order, 2), (1, space.order), (1, 2))
        assert space.uses_velocity == (Signal.VELOCITY in element.needs)

    def test_gives_finite_plain_floats(self, kind: str, element: Element) -> None:
        if isinstance(element, StaticElement):
            law = element.force
        else:
            assert isinstance(element, DynamicElement)
            law = bind(element.dynamics, 1e-3)
        for feedback in product([-0.1, 0.0, 0.1], repeat=len(element.needs)):
            force = law(*feedback)
            assert type(force) is float
            assert math.isfinite(force)

    def test_hides_no_number_that_is_none(self, kind: str, element: Element) -> None:
        law = element.force if isinstance(element, StaticElement) else bind(element.linearised(), 1e-3)
        assert math.isnan(law(*[math.nan] * len(element.needs)))

    def test_gives_the_force_of_its_linearisation_in_contact(self, kind: str, element: Element) -> None:
        """Slope of a static force somewhere in contact; a dynamic element is linear and says so."""
        space = element.linearised()
        if isinstance(element, DynamicElement):
            np.testing.assert_array_equal(space.a, element.dynamics.a)
            return
        assert isinstance(element, StaticElement)
        inside = next(x for x in (-0.05, 0.05) if element.force(x, *[0.0] * (len(element.needs) - 1)))
        at = [inside, 0.0][: len(element.needs)]
        for place, expected in enumerate(space.d[0][: len(at)]):
            ahead, behind = ([*at[:place], at[place] + step, *at[place + 1 :]] for step in (1e-4, -1e-4))
            assert (element.force(*ahead) - element.force(*behind)) / 2e-4 == pytest.approx(expected)

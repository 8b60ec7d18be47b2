"""Contract of every element: run over all of the registry, each kind with its sheet of claims."""

import math
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import grimp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from haptic_fieldbus.scenes import element as element_module
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.registry import ELEMENTS
from haptic_fieldbus.testing import axis_count, check_element
from tests.cases import Test, every
from tests.lanes import examples
from tests.scenes.sheet import Array, Motion, Sheet, forces, given_to_the_hand

NOT_ELEMENTS = {
    "__init__", "catalogue", "element", "element_checks", "files", "own", "own_faults", "parameter_changes",
    "registry", "scene",
}  # fmt: skip
SHEETS: dict[str, Sheet] = {}
for _kind in ELEMENTS:
    if find_spec(f"tests.scenes.sheets.{_kind}") is not None:  # a test below says which one is missing
        SHEETS[_kind] = import_module(f"tests.scenes.sheets.{_kind}").SHEET
EXAMPLES = {
    f"{kind}-{number}": (kind, example)
    for kind, sheet in SHEETS.items()
    for number, example in enumerate(sheet.examples)
}
EVERY_EXAMPLE = pytest.mark.thorough("long motions of every example", quick=tuple(f"{kind}-0" for kind in ELEMENTS))
FURTHER, FASTER = 1e-9, 1e-6
"""[m], [m/s]: the steps of difference quotients."""
SMOOTH = 2e-5
"""[s]; the period that stands for continuous time."""


def each_example(claims: Callable[[str, AnyElement], object]) -> Callable[[Test], Test]:
    """Run a test for each example that `claims` is true of, so that none passes for want of anything to hold it to."""
    chosen = {name: case for name, case in EXAMPLES.items() if claims(*case)}
    return every(("kind", "element"), chosen.values(), ids=list(chosen))


of_every_example = each_example(lambda kind, element: True)


@st.composite
def motions(draw: st.DrawFn, sheet: Sheet, period: float, steps: int, axes: int) -> Motion:
    """Three sines around a place within reach, of 0.5 to 40 Hz, for each axis."""
    middle, amplitude = sheet.reach
    time = period * np.arange(steps)
    position, velocity = np.zeros((steps, axes)), np.zeros((steps, axes))
    for axis in range(axes):
        position[:, axis] += middle + draw(st.floats(-amplitude, amplitude))
        for _ in range(3):
            size = draw(st.floats(0.0, amplitude / 3.0))
            turn = 2.0 * math.pi * draw(st.floats(0.5, 40.0))
            phase = draw(st.floats(0.0, 2.0 * math.pi))
            position[:, axis] += size * np.sin(turn * time + phase)
            velocity[:, axis] += size * turn * np.cos(turn * time + phase)
    return Motion(period, position.squeeze(), velocity.squeeze())


def moved_on(element: AnyElement, motion: Motion, axis: int, way: float, speed: float) -> Array:
    """The force at the end of a motion when one axis is then moved by so much, and sped up."""
    position = np.concatenate([motion.position, motion.position[-1:]])
    velocity = np.concatenate([motion.velocity, motion.velocity[-1:]])
    position[-1] += way * np.eye(axis_count(element))[axis].squeeze()
    velocity[-1] += speed * np.eye(axis_count(element))[axis].squeeze()
    return np.atleast_1d(forces(element, Motion(motion.period, position, velocity))[-1])


def test_every_kind_has_a_sheet() -> None:
    sheets = {path.stem for path in (Path(__file__).parent / "sheets").glob("*.py")} - {"__init__"}
    for kind in ELEMENTS:
        assert kind in sheets, f"add tests/scenes/sheets/{kind}.py with the claims of the new kind"
    assert sheets == set(ELEMENTS), "remove the sheets of kinds that there are no more"


def test_every_module_beside_them_is_listed() -> None:
    modules = {path.stem for path in Path(element_module.__file__).parent.glob("*.py")} - NOT_ELEMENTS
    listed = {module.rsplit(".", 1)[-1] for module, _ in ELEMENTS.values()}
    for module in modules:
        assert module in listed, f"add a line for {module} to ELEMENTS in haptic_fieldbus/scenes/registry.py"
    assert modules == listed, "remove the lines of modules that there are no more"


def test_one_element_never_imports_another() -> None:
    """By any way round; what several need stands in `numerics`."""
    graph = grimp.build_graph("haptic_fieldbus", exclude_type_checking_imports=False, cache_dir=None)
    elements = {module for module, _ in ELEMENTS.values()}
    for element in elements:
        assert graph.find_upstream_modules(element).isdisjoint(elements), element


class TestEveryElement:
    @of_every_example
    def test_is_what_the_registry_names(self, kind: str, element: AnyElement) -> None:
        module, name = ELEMENTS[kind]
        assert type(element) is getattr(import_module(module), name)

    @of_every_example
    def test_is_named_as_its_kind_unless_told(self, kind: str, element: AnyElement) -> None:
        assert element.name == kind

    @of_every_example
    def test_can_be_written_in_a_file_and_nothing_else_can(self, kind: str, element: AnyElement) -> None:
        adapter = TypeAdapter(type(element))
        values = adapter.dump_python(element)
        assert adapter.validate_python(values) == element
        with pytest.raises(ValueError, match="unheard_of"):
            adapter.validate_python({**values, "unheard_of": 1})

    @of_every_example
    def test_is_linearised_to_the_slopes_that_its_force_has_there(self, kind: str, element: AnyElement) -> None:
        """Linear model by which stability is judged, beside difference quotients of the law; states stand still."""
        motion, way = SHEETS[kind].stiffest(element)
        before = moved_on(element, motion, 0, 0.0, 0.0)
        for column in range(2 * axis_count(element)):
            step = way * (FASTER if column % 2 else FURTHER)  # positions and velocities by turns
            steps = (0.0, step) if column % 2 else (step, 0.0)
            found = (moved_on(element, motion, column // 2, *steps) - before) / step
            expected = element.linearised().d[:, column]
            np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-4)

    @of_every_example
    def test_keeps_the_contract_that_others_hold_theirs_to(self, kind: str, element: AnyElement) -> None:
        check_element(element, SHEETS[kind].reach)


@EVERY_EXAMPLE
@pytest.mark.parametrize(("kind", "element"), EXAMPLES.values(), ids=EXAMPLES)
class TestEveryMotion:
    @settings(max_examples=examples(15))
    @given(data=st.data())
    def test_jumps_by_no_more_than_it_says(self, kind: str, element: AnyElement, data: st.DataObject) -> None:
        sheet = SHEETS[kind]
        motion = data.draw(motions(sheet, SMOOTH, 2000, axis_count(element)))
        changes = np.abs(np.diff(forces(element, motion), axis=0))
        per_length, per_speed, per_second = sheet.steepness(element)
        ways = np.abs(motion.moves).reshape(len(changes), -1).sum(axis=1)
        turns = np.abs(np.diff(motion.velocity, axis=0)).reshape(len(changes), -1).sum(axis=1)
        smooth = per_length * ways + per_speed * turns + per_second * SMOOTH
        allowed = smooth + sheet.jump(element, float(np.abs(motion.velocity).max()))
        assert (changes.reshape(len(changes), -1).max(axis=1) <= allowed * (1.0 + 1e-9) + 1e-9).all()

    @settings(max_examples=examples(15))
    @given(data=st.data())
    def test_gives_no_more_energy_than_it_says(self, kind: str, element: AnyElement, data: st.DataObject) -> None:
        sheet = SHEETS[kind]
        motion = data.draw(motions(sheet, SMOOTH, 5000, axis_count(element)))
        force = forces(element, motion)
        exchanged = float(np.sum(np.abs(force[1:] * motion.moves)))
        given_away = given_to_the_hand(motion, force, held=False)
        assert given_away <= sheet.continuous(element, motion) + 1e-3 * exchanged + 1e-12

    @settings(max_examples=examples(15))
    @given(data=st.data())
    def test_gives_no_more_energy_than_it_says_when_sampled(
        self, kind: str, element: AnyElement, data: st.DataObject
    ) -> None:
        sheet = SHEETS[kind]
        motion = data.draw(motions(sheet, 1e-3, 400, axis_count(element)))
        given_away = given_to_the_hand(motion, forces(element, motion), held=True)
        bound = sheet.sampled(element, motion)
        assert given_away <= bound + 1e-9 * abs(bound) + 1e-12


@each_example(lambda kind, element: getattr(element, "stiffness", 0.0))
def test_an_element_is_linearised_with_the_stiffness_that_it_names(kind: str, element: Any) -> None:
    """Stability varies `stiffness`; so what it varies must act."""
    assert element.stiffness > 0.0
    assert np.abs(element.linearised().d).max() > 0.0 or element.linearised().order


@each_example(lambda kind, element: SHEETS[kind].silent(element))
def test_an_element_is_silent_where_it_says_so(kind: str, element: AnyElement) -> None:
    for motion in SHEETS[kind].silent(element):
        np.testing.assert_array_equal(forces(element, motion), 0.0)


@each_example(lambda kind, element: SHEETS[kind].signs(element))
def test_an_element_pushes_the_way_that_it_says(kind: str, element: AnyElement) -> None:
    for motion, sign in SHEETS[kind].signs(element):
        assert np.sign(forces(element, motion)[-1]) == sign

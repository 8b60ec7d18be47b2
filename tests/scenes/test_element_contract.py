"""Contract of every element: run over all of the registry, each kind with its sheet of claims."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import grimp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes import element as element_module
from haptic_fieldbus.scenes.element import (
    AnyElement,
    CouplingElement,
    DynamicElement,
    MemoryElement,
    StaticElement,
    Varying,
    is_varying,
)
from haptic_fieldbus.scenes.registry import ELEMENTS
from haptic_fieldbus.signals import Signal
from tests.cases import Test, every
from tests.lanes import examples
from tests.margins.own_drawn import BoundedPolynomial, Stated
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


def axes_of(element: AnyElement) -> int:
    return 2 if isinstance(element, CouplingElement) else 1


def law(element: Any) -> Any:
    return element.begin(1e-3) if isinstance(element, CouplingElement) else law_of(element, 1e-3)


def feedback(element: AnyElement, values: list[float]) -> Any:
    """All combinations of the values for the signals that it needs; time goes on."""
    signals = element.needs * axes_of(element)
    for number, combination in enumerate(product(values, repeat=len(signals))):
        yield [
            1_000_000 * number if signal is Signal.ELAPSED_NS else value
            for signal, value in zip(signals, combination, strict=True)
        ]


def moved_on(element: AnyElement, motion: Motion, axis: int, way: float, speed: float) -> Array:
    """The force at the end of a motion when one axis is then moved by so much, and sped up."""
    position = np.concatenate([motion.position, motion.position[-1:]])
    velocity = np.concatenate([motion.velocity, motion.velocity[-1:]])
    position[-1] += way * np.eye(axes_of(element))[axis].squeeze()
    velocity[-1] += speed * np.eye(axes_of(element))[axis].squeeze()
    return np.atleast_1d(forces(element, Motion(motion.period, position, velocity))[-1])


def contradictions(element: Any, reach: tuple[float, float]) -> list[str]:
    """Places within reach where the force of an element at rest is steeper than its bounds, or than `linearised`."""
    if not isinstance(element, StaticElement) or Signal.POSITION not in element.needs:
        return []
    middle, amplitude = reach
    felt = law(element)

    def force(position: float) -> float:
        return float(felt(*[position if signal is Signal.POSITION else 0 for signal in element.needs]))

    stated, found = -float(element.linearised().d[0, 0]), []
    for share in np.linspace(-1.0, 1.0, 997) + 1e-4 / math.sqrt(2.0):
        x = middle + amplitude * share
        slope = (force(x - FURTHER) - force(x + FURTHER)) / (2.0 * FURTHER)
        low, high = element.local(x - FURTHER, x + FURTHER).stiffness if is_varying(element) else (-math.inf, stated)
        slack = 1e-3 * abs(stated) + 1e-4
        if not low - slack <= slope <= high + slack:
            found.append(f"at {x}: slope {slope}, stated {low} to {high}")
    return found


def test_a_force_that_contradicts_what_is_stated_is_refused() -> None:
    """A spring that hardens beyond what `linearised` says, and one whose bounds leave its hardening out."""
    hardening = Stated(lambda x: -100.0 * x - 2e5 * x**3, 100.0)
    assert contradictions(hardening, (0.0, 0.03))
    assert not contradictions(replace(hardening, stated=700.0), (0.0, 0.03))
    bounded = BoundedPolynomial("a", 100.0, 0.0, 100.0, cube=2e3)
    assert not contradictions(bounded, (0.0, 0.03))

    class Lying(BoundedPolynomial):
        def slope(self, away: float) -> float:
            return 1.0

    assert contradictions(Lying("a", 100.0, 0.0, 100.0, cube=2e3), (0.0, 0.03))


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
    def test_is_a_frozen_dataclass_named_as_its_kind_unless_told(self, kind: str, element: AnyElement) -> None:
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(element, "name", "another")  # noqa: B010 - an assignment would not pass the type checker
        assert element.name == kind

    @of_every_example
    def test_can_be_written_in_a_file_and_nothing_else_can(self, kind: str, element: AnyElement) -> None:
        adapter = TypeAdapter(type(element))
        values = adapter.dump_python(element)
        assert adapter.validate_python(values) == element
        with pytest.raises(ValueError, match="unheard_of"):
            adapter.validate_python({**values, "unheard_of": 1})

    @of_every_example
    def test_is_of_one_kind_of_law(self, kind: str, element: AnyElement) -> None:
        kinds = (StaticElement, MemoryElement, DynamicElement, CouplingElement)
        assert sum(isinstance(element, each) for each in kinds) == 1

    @of_every_example
    def test_needs_signals_of_motion_only_and_each_once(self, kind: str, element: AnyElement) -> None:
        assert set(element.needs) <= {Signal.POSITION, Signal.VELOCITY, Signal.ELAPSED_NS}
        assert len(set(element.needs)) == len(element.needs)

    @of_every_example
    def test_is_linearised_to_forces_from_positions_and_velocities(self, kind: str, element: AnyElement) -> None:
        space, axes = element.linearised(), axes_of(element)
        assert (space.b.shape, space.c.shape, space.d.shape) == (
            (space.order, 2 * axes),
            (axes, space.order),
            (axes, 2 * axes),
        )
        assert Signal.VELOCITY in element.needs or not space.uses_velocity

    @of_every_example
    def test_is_linearised_to_the_slopes_that_its_force_has_there(self, kind: str, element: AnyElement) -> None:
        """Linear model by which stability is judged, beside difference quotients of the law; states stand still."""
        motion, way = SHEETS[kind].stiffest(element)
        before = moved_on(element, motion, 0, 0.0, 0.0)
        for column in range(2 * axes_of(element)):
            step = way * (FASTER if column % 2 else FURTHER)  # positions and velocities by turns
            steps = (0.0, step) if column % 2 else (step, 0.0)
            found = (moved_on(element, motion, column // 2, *steps) - before) / step
            expected = element.linearised().d[:, column]
            np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-4)

    @of_every_example
    def test_is_nowhere_steeper_than_it_says(self, kind: str, element: AnyElement) -> None:
        assert contradictions(element, SHEETS[kind].reach) == []

    @each_example(lambda kind, element: is_varying(element))
    def test_its_bounds_hold_between_any_two_places(self, kind: str, element: Varying) -> None:
        (middle, amplitude), random = SHEETS[kind].reach, np.random.default_rng(11)
        felt = law(element)
        rest = [0.0] * (len(element.needs) - 1)
        for low, high in np.sort(middle + amplitude * random.uniform(-1.5, 1.5, (12, 2))).tolist():
            bounds, x = element.local(low, high), np.linspace(low, high, 300)
            force = np.array([felt(float(each), *rest) for each in x])
            slope = -np.diff(force) / np.diff(x)
            slack = 1e-6 * (1.0 + np.abs(bounds.stiffness).max()), 1e-9 * (1.0 + np.abs(force).max())
            assert bounds.stiffness[0] - slack[0] <= slope.min() <= slope.max() <= bounds.stiffness[1] + slack[0]
            assert bounds.force[0] - slack[1] <= force.min() <= force.max() <= bounds.force[1] + slack[1]

    @of_every_example
    def test_gives_finite_plain_floats_at_any_finite_motion(self, kind: str, element: AnyElement) -> None:
        call = law(element)
        for values in feedback(element, [-1e3, -0.1, 0.0, 5e-324, 0.1, 1e3]):
            found = call(*values)
            for force in found if isinstance(found, tuple) else (found,):
                assert type(force) is float
                assert math.isfinite(force)

    @of_every_example
    def test_starts_afresh_each_time(self, kind: str, element: AnyElement) -> None:
        first = [law(element)(*values) for values in feedback(element, [-0.01, 0.02])]
        assert first == [law(element)(*values) for values in feedback(element, [-0.01, 0.02])]
        again = law(element)
        assert again(*next(iter(feedback(element, [-0.01, 0.02])))) == first[0]


@EVERY_EXAMPLE
@pytest.mark.parametrize(("kind", "element"), EXAMPLES.values(), ids=EXAMPLES)
class TestEveryMotion:
    @settings(max_examples=examples(15))
    @given(data=st.data())
    def test_jumps_by_no_more_than_it_says(self, kind: str, element: AnyElement, data: st.DataObject) -> None:
        sheet = SHEETS[kind]
        motion = data.draw(motions(sheet, SMOOTH, 2000, axes_of(element)))
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
        motion = data.draw(motions(sheet, SMOOTH, 5000, axes_of(element)))
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
        motion = data.draw(motions(sheet, 1e-3, 400, axes_of(element)))
        given_away = given_to_the_hand(motion, forces(element, motion), held=True)
        bound = sheet.sampled(element, motion)
        assert given_away <= bound + 1e-9 * abs(bound) + 1e-12


@each_example(lambda kind, element: getattr(element, "stiffness", 0.0))
def test_an_element_is_linearised_with_the_stiffness_that_it_names(kind: str, element: Any) -> None:
    """Stability varies `stiffness`; so what it varies must act."""
    assert element.stiffness > 0.0
    assert np.abs(element.linearised().d).max() > 0.0 or element.linearised().order


@each_example(lambda kind, element: set(element.needs) & {Signal.POSITION, Signal.VELOCITY})
def test_an_element_that_needs_motion_hides_no_number_that_is_none(kind: str, element: AnyElement) -> None:
    signals = element.needs * axes_of(element)
    found = law(element)(*[0 if signal is Signal.ELAPSED_NS else math.nan for signal in signals])
    assert np.isnan(found).any()


@each_example(lambda kind, element: set(element.needs) & {Signal.POSITION, Signal.VELOCITY})
def test_an_element_takes_a_motion_without_end(kind: str, element: AnyElement) -> None:
    """Judge of the result is the cycle, which trips on a force that is not finite."""
    count = axes_of(element)
    for end in (math.inf, -math.inf):
        felt = law(element)
        for value in (0.0, end, 0.0):
            felt(*[0 if signal is Signal.ELAPSED_NS else value for signal in element.needs * count])


@each_example(lambda kind, element: SHEETS[kind].silent(element))
def test_an_element_is_silent_where_it_says_so(kind: str, element: AnyElement) -> None:
    for motion in SHEETS[kind].silent(element):
        np.testing.assert_array_equal(forces(element, motion), 0.0)


@each_example(lambda kind, element: SHEETS[kind].signs(element))
def test_an_element_pushes_the_way_that_it_says(kind: str, element: AnyElement) -> None:
    for motion, sign in SHEETS[kind].signs(element):
        assert np.sign(forces(element, motion)[-1]) == sign

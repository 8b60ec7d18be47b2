"""Leaving out, proved: each library scene imports, maps and runs exactly what is written down here."""

import pkgutil

import pytest

from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.registry import ELEMENTS
from tests.golden.left_out import FOLDER, PLAIN, observed, text_of

NOT_FOR_A_WALL = (
    "cycle.tachometer",
    "margins.coupled",
    "numerics.relaxation",
    "numerics.condition",
    "numerics.estimators",
    "numerics.integrators",
    "numerics.relaxation",
    "numerics.waves",
    "planning.coupled_plan",
)
"""Modules and folders of the package that other scenes, or other drives, need."""
MOST_CALLS_OF_A_WALL = 10
"""Of functions of the package in a period; the hand waits for each of them."""


@pytest.mark.thorough("starts a process for each scene", quick=("wall",))
@pytest.mark.parametrize("scene", scene_names())
def test_a_scene_uses_what_it_used_before_and_no_more(scene: str) -> None:
    path = FOLDER / f"{scene}.txt"
    assert path.exists(), f"new scene: python -m tests.golden writes {path.name}; read it, then commit it"
    assert text_of(scene) == path.read_text(encoding="utf-8")


def test_no_golden_text_is_left_over() -> None:
    found = {path.stem for path in FOLDER.glob("*.txt")}
    assert found <= set(scene_names()), "python -m tests.golden removes what is left over"


@pytest.mark.parametrize("module", NOT_FOR_A_WALL)
def test_a_wall_alone_imports_nothing_that_only_other_scenes_need(module: str) -> None:
    pkgutil.resolve_name(f"haptic_fieldbus.{module}")  # or nothing is proved
    imported = observed(PLAIN).imported
    assert [name for name in imported if f"{name}.".startswith(f"{module}.")] == []


def test_a_wall_alone_imports_one_element() -> None:
    elements = {module.removeprefix("haptic_fieldbus.") for module, _ in ELEMENTS.values()}
    assert elements & set(observed(PLAIN).imported) == {"scenes.wall"}


def test_a_wall_alone_maps_one_quantity_each_way_and_its_echo_beside_the_state_of_the_drive() -> None:
    objects = [address.partition(":")[0] for address in observed(PLAIN).mapped]
    assert objects == ["6041h", "6064h", "6077h", "6040h", "6071h"]


def test_a_wall_alone_takes_few_calls_a_period() -> None:
    assert observed(PLAIN).most_calls <= MOST_CALLS_OF_A_WALL

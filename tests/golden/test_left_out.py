"""Leaving out, proved: each library scene imports, maps and runs exactly what is written down here."""

import pytest

from haptic_fieldbus.scenes.catalogue import scene_names
from tests.golden.left_out import FOLDER, text_of


@pytest.mark.parametrize("scene", scene_names())
def test_a_scene_uses_what_it_used_before_and_no_more(scene: str) -> None:
    path = FOLDER / f"{scene}.txt"
    assert path.exists(), f"new scene: python -m tests.golden writes {path.name}; read it, then commit it"
    assert text_of(scene) == path.read_text(encoding="utf-8")


def test_no_golden_text_is_left_over() -> None:
    assert {path.stem for path in FOLDER.glob("*.txt")} == set(scene_names())


def test_a_wall_alone_uses_no_estimator_no_integrator_no_tissue_and_seven_functions_a_period() -> None:
    text = text_of("wall")
    for part in ("estimators", "integrators", "tissue", "maxwell", "friction", "coupled", "6077h"):
        assert part not in text
    assert text.partition("functions of a period\n")[2].count("\n") <= 7

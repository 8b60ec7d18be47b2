"""What `plan` says of each library scene, and of each profile, is what was read and found good."""

from pathlib import Path

import pytest

from haptic_fieldbus.scenes.catalogue import scene_names
from tests.golden.plans import (
    FOLDER,
    PROFILES,
    REFERENCE_PROFILE,
    SCENES,
    cases,
    further_profiles,
    planned,
    text_of,
)


@pytest.mark.parametrize("path", cases(), ids=lambda path: str(path.relative_to(FOLDER)))
def test_the_plan_reads_as_before(path: Path) -> None:
    assert path.exists(), f"new: python -m tests.golden writes {path.name}; read it, then commit it"
    assert text_of(*cases()[path]) == path.read_text(encoding="utf-8")


def test_no_golden_text_is_left_over() -> None:
    found = {*SCENES.glob("*.txt"), *PROFILES.glob("*.txt")}
    assert found <= set(cases()), "python -m tests.golden removes what is left over"


@pytest.mark.thorough("every scene on each further drive")
@pytest.mark.parametrize("profile", further_profiles())
def test_every_scene_renders_the_same_elements_on_each_drive(profile: str) -> None:
    """A drive decides how position and velocity are known and how force is sent, not what a hand is to feel."""
    for scene in scene_names():
        assert elements(scene, profile) == elements(scene, REFERENCE_PROFILE), scene


def elements(scene: str, profile: str) -> list[str]:
    """The steps of a plan that render an element."""
    return [step for step in planned(scene, profile).steps if "element: " in step]

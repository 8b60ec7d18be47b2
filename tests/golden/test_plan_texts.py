"""Output of `plan` for each library scene and each profile is the text that was read and found good."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.report.texts import announcement
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.cli.command import counted
from tests.golden.plans import FOLDER, PROFILES, REFERENCE_PROFILE, SCENES, cases, further_profiles, planned, text_of

LEAST = 20
"""Scenes that every drive can have."""


@pytest.mark.parametrize("path", cases(), ids=lambda path: str(path.relative_to(FOLDER)))
def test_the_plan_reads_as_before(path: Path) -> None:
    """A run begins with four short lines on it, besides caps and warnings."""
    assert path.exists(), f"new: python -m tests.golden writes {path.name}; read it, then commit it"
    assert text_of(*cases()[path]) == path.read_text(encoding="utf-8")
    keys = [key for key, _ in counted(announcement(planned(*cases()[path])))]
    assert keys == ["scene", "bench", "sends", "limit"]


@pytest.mark.thorough("each text once more for each kind of processor")
@pytest.mark.parametrize("kernel", ["Haswell", "Nehalem"])
def test_the_plan_reads_alike_on_another_processor(kernel: str) -> None:
    """OpenBLAS rounds differently on each kind of processor; no search may end elsewhere for that."""
    program = (
        "from tests.golden.plans import cases, text_of\n"
        "print(*(path.name for path, case in cases().items() if text_of(*case) != path.read_text(encoding='utf-8')))"
    )
    environment = os.environ | {"OPENBLAS_CORETYPE": kernel}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_no_golden_text_is_left_over() -> None:
    found = {*SCENES.glob("*.txt"), *PROFILES.glob("*.txt")}
    assert found <= set(cases()), "python -m tests.golden removes what is left over"


@pytest.mark.thorough("every scene on each further drive")
@pytest.mark.parametrize("profile", further_profiles())
def test_every_scene_renders_the_same_elements_on_each_drive(profile: str) -> None:
    """A drive decides how position and velocity are known and how force is sent, not what a hand is to feel."""
    same = [scene for scene in scene_names() if elements(scene, profile) is not None]
    assert len(same) >= LEAST, "scenes that this drive cannot have: of turning knobs, of axes that are coupled"
    for scene in same:
        assert elements(scene, profile) == elements(scene, REFERENCE_PROFILE), scene


def elements(scene: str, profile: str) -> list[str] | None:
    """The steps of a plan that render an element; None where there is no plan."""
    try:
        return [step for step in planned(scene, profile).steps if "element: " in step]
    except PlanError:
        return None

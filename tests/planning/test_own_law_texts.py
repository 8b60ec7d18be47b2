"""Statements of a plan and a refusal about elements without bounds of their own."""

from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus import Scene, SceneAxis, Workspace, plan, stability
from haptic_fieldbus.errors import UnstableSceneError
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.signals import Signal
from tests.margins.own_drawn import Remembering, Stated

BOTH = (Signal.POSITION, Signal.VELOCITY)
MEMORY = (
    "remembering: checked by linearised() alone (0.05 N·m/rad), because its force depends on memory and elapsed time"
)
STEEP = "more than linearised() states (0.05 N·m/rad)"


def scene(*elements: Any) -> Scene:
    return Scene("own", "own", (SceneAxis("a", Workspace.ROTARY),), elements)


def told(*elements: Any) -> str:
    return explain(plan(scene(*elements)))


def test_a_spring_is_told_with_its_steepest_place() -> None:
    text = told(Stated(lambda x: -0.05 * x, 0.05))
    assert "own: force read at " in text
    assert " places from -10000 rad to 10000 rad; steepest 0.05 N·m/rad at " in text
    assert "linearised" not in text


def test_a_force_that_depends_on_more_is_told() -> None:
    text = told(Stated(lambda x, v: -0.05 * x - 1e-5 * v, 0.05, BOTH), Remembering())
    assert "; read at rest, because it also depends on velocity" in text
    assert MEMORY in text


def test_a_refusal_says_how_steep_the_force_is() -> None:
    planned = plan(scene(Stated(lambda x: -0.05 * x - 1e4 * x**3, 0.05)))
    assert STEEP in explain(planned)
    with pytest.raises(UnstableSceneError, match=r"own: force read at .* steepest 35.* N·m/rad at .*linearised"):
        check_stable(planned)


def test_a_refusal_says_that_a_force_pushes_away_without_end() -> None:
    planned = plan(scene(Stated(lambda x: -0.05 * x + 0.05 * x**3, 0.05), Remembering()))
    with pytest.raises(UnstableSceneError) as caught:
        check_stable(planned)
    assert "its force away from rest grows without bound; limits.position of the rig stops the handle" in str(
        caught.value
    )
    assert MEMORY not in str(caught.value)


def test_json_has_them() -> None:
    judged = plan(scene(Stated(lambda x: -0.05 * x, 0.05))).stability
    assert judged is not None
    found: Any = judged.to_json()["own_laws"]
    (law,) = found
    page = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "compatibility.md").read_text(encoding="utf-8")
    keys = ", ".join(f"`{key}`" for key in law)
    assert f"| `stability: own_laws[]` | {keys} |" in page
    assert (law["element"], law["places"] > 100, law["beyond"], law["runs_off"]) == ("own", True, [], False)
    assert stability("wall").own_laws == ()

"""The torque error of coupled axes: what the loop computed is found again from what it recorded of both."""

from pathlib import Path

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing import summary
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.assessing.summary import AxisAssessment, Run
from haptic_fieldbus.assessing.torque_error import ErrorFigures
from haptic_fieldbus.report.drawing import save
from haptic_fieldbus.report.plot import draw_run
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import endless_rig, scene_of

SHAFT = Coupling(("left", "right"), stiffness=200.0)


def splits(monkeypatch: pytest.MonkeyPatch, *elements: AnyElement) -> list[ErrorFigures]:
    """Of each axis in their order."""
    found: list[ErrorFigures] = []
    summarise = summary.summarise

    def watched(run: Run, axes: list[AxisAssessment], elapsed: float) -> Result:
        found.extend(axis.figures for axis in axes if axis.figures is not None)
        return summarise(run, axes, elapsed)

    monkeypatch.setattr(summary, "summarise", watched)
    scene = scene_of(*elements)
    run(scene, endless_rig(scene), duration=1.2)
    return found


@pytest.mark.thorough("renders six scenes for seconds", quick=("shaft",))
@pytest.mark.parametrize(
    "elements",
    [
        (SHAFT,),
        (Coupling(("right", "left"), stiffness=200.0, damping=0.4, ratio=-0.5), Wall("left", 200.0, 0.01)),
        (SHAFT, Damper("left", 1.0)),
        (SHAFT, Damper("right", 1.0)),
        (SHAFT, SprungMass("right", 100.0, 0.2)),
        (SHAFT, Coupling(("right", "foot"), stiffness=100.0, damping=0.2, name="second"), Wall("foot", 100.0)),
    ],
    ids=["shaft", "reversed and damped", "left damped", "right damped", "virtual mass", "three in a row"],
)
def test_what_was_recorded_gives_the_recorded_forces(
    elements: tuple[AnyElement, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = splits(monkeypatch, *elements)
    assert len(found) >= 2
    for each in found:
        assert each.replay_difference < 1e-9
        assert sum(each.by_source.values()) == pytest.approx(1.0, abs=1e-9)
        assert each.rms < 0.2, "the ideal follows what was rendered"


@pytest.mark.thorough("renders a coupled scene")
def test_an_axis_names_the_sources_that_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = splits(monkeypatch, SHAFT, Damper("left", 1.0))
    assert "estimator" in left.by_source
    assert "estimator" not in right.by_source


@pytest.mark.thorough("draws a run")
def test_the_picture_names_each_axis(tmp_path: Path) -> None:
    shaft = scene_of(SHAFT)
    save(draw_run(run(shaft, endless_rig(shaft), duration=1.0)), tmp_path / "shaft.svg")
    text = (tmp_path / "shaft.svg").read_text(encoding="utf-8")
    assert "left: whole run" in text
    assert "right: whole run" in text
    wall = scene_of(Wall("handle", 300.0))
    save(draw_run(run(wall, endless_rig(wall), duration=1.0)), tmp_path / "wall.svg")
    assert "<!-- whole run -->" in (tmp_path / "wall.svg").read_text(encoding="utf-8")

"""A run that is assessed part by part has the figures and the traces of a run assessed as a whole."""

from typing import Any

import numpy as np
import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing import summary
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.assessing.summary import AxisAssessment, Run
from haptic_fieldbus.assessing.torque_error import ErrorFigures
from haptic_fieldbus.report.plot import first_force
from tests.builders import endless_rig

CASES: dict[str, dict[str, Any]] = {
    "wall": {"scene": "wall"},
    "memory": {"scene": "lugre"},
    "virtual mass": {"scene": "sprung_mass"},
    "changed": {
        "scene": "spring",
        "changes": [(0.9, {"spring.stiffness": 300.0}), (1.3, {"spring.stiffness": 100.0})],
    },
    "changed virtual mass": {"scene": "sprung_mass", "changes": [(1.0, {"sprung_mass.mass": 0.2})]},
    "coupled": {"scene": "teleoperation"},
    "estimated": {"scene": "damped_wall"},
    "wave": {"scene": "sine"},
}


def assessed(monkeypatch: pytest.MonkeyPatch, part: int, behind: int, **task: Any) -> tuple[Result, list[ErrorFigures]]:
    """Of a run of 1.6 s that is assessed by parts of so many periods."""
    found: list[ErrorFigures] = []
    summarise = summary.summarise

    def watched(run: Run, axes: list[AxisAssessment], elapsed: float) -> Result:
        found.extend(axis.figures for axis in axes if axis.figures is not None)
        return summarise(run, axes, elapsed)

    with monkeypatch.context() as patch:
        patch.setattr(summary, "PART", part)
        patch.setattr(summary, "BEHIND", behind)
        patch.setattr(summary, "summarise", watched)
        return run(duration=1.6, **task), found


@pytest.mark.thorough("renders scenes of each kind twice", quick=1)
@pytest.mark.parametrize("task", CASES.values(), ids=CASES.keys())
def test_parts_add_up_to_the_whole(task: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    whole, of_whole = assessed(monkeypatch, 15_000, 500, **task)
    parts, of_parts = assessed(monkeypatch, 217, 100, **task)
    assert len(of_parts) == len(of_whole) >= 1
    for one, other in zip(of_whole, of_parts, strict=True):
        assert one.unit == other.unit
        assert list(one.by_source) == list(other.by_source)
        assert dict(other.by_source) == pytest.approx(dict(one.by_source), abs=1e-9)
        for name in ("rms", "max", "energy_generated", "ideal_rms_contact", "error_rms_contact"):
            assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-9, abs=1e-12), name
        assert max(one.replay_difference, other.replay_difference) < 1e-9
    assert parts.verdict == whole.verdict
    assert parts.cycles == whole.cycles == 1600
    for mine, theirs in zip(parts.traces, whole.traces, strict=True):
        for name in ("times", "position", "force", "ideal", "sample_times", "samples"):
            np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name), rtol=0, atol=1e-9, err_msg=name)


@pytest.mark.thorough("renders a run of 3 s twice")
def test_the_traces_of_a_long_run_lose_no_spike_and_keep_the_first_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, thinned = run("wall", endless_rig("wall"), duration=3.0, hand="tap").traces[0], None
    monkeypatch.setattr(summary, "WHOLE", 1000)
    monkeypatch.setattr(summary, "BINS", 50)
    thinned = run("wall", endless_rig("wall"), duration=3.0, hand="tap").traces[0]
    assert whole.ideal is not None
    assert thinned.ideal is not None
    assert len(thinned.times) < len(whole.times) / 4
    for name in ("position", "force", "ideal", "samples"):
        one, other = getattr(whole, name), getattr(thinned, name)
        assert (one.min(), one.max()) == (other.min(), other.max()), name
    error, kept = whole.force - whole.ideal, thinned.force - thinned.ideal
    assert (error.min(), error.max()) == (kept.min(), kept.max())
    window = first_force(whole)
    assert window is not None
    assert first_force(thinned) == pytest.approx(window)
    near, shown = ((each.times >= window[0]) & (each.times <= window[1]) for each in (whole, thinned))
    np.testing.assert_array_equal(whole.force[near], thinned.force[shown])

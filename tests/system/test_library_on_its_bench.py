"""Every scene of the library, run as a newcomer runs it: with its own hand, for ten seconds, on the shipped bench."""

import pytest

from haptic_fieldbus import plan, run
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.signals import Workspace

TRAVEL = 0.1
"""[m] to each side of the middle, the free way of the shipped bench."""
FELT = 0.01
"""Share of the rated force; ten steps of the target torque. A scene that gives less is not shown by its hand."""


@pytest.mark.parametrize("scene", scene_names())
def test_the_shipped_bench_has_a_limited_way_where_it_is_linear(scene: str) -> None:
    for axis in plan(scene).axes:
        assert axis.limits.position == ((-TRAVEL, TRAVEL) if axis.workspace is Workspace.LINEAR else None)


@pytest.mark.thorough("every scene of the library for ten seconds", quick=("sprung_mass", "inertia"))
@pytest.mark.parametrize("scene", scene_names())
def test_a_scene_with_its_own_hand_stays_on_the_bench_and_is_felt(scene: str) -> None:
    result = run(scene, duration=10.0)
    assert result.trips == ()
    assert result.cycles == 10_000
    assert result.plan is not None
    felt = 0.0
    for trace, axis in zip(result.traces, result.plan.axes, strict=True):
        felt = max(felt, abs(trace.force).max() / axis.rated_effort)
        if axis.workspace is Workspace.LINEAR:
            assert -TRAVEL <= trace.position.min() < trace.position.max() <= TRAVEL
    assert felt > FELT


def test_a_hand_that_leaves_the_bench_ends_the_run() -> None:
    # Nothing holds a free mass against six newtons: within a second the handle is at the end of its way.
    with pytest.raises(SafetyTripError, match=r"position .*0\.1"):
        run("sprung_mass", hand="push", duration=10.0)

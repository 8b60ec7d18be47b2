"""Every scene of the library, run as a newcomer runs it: with its own hand, for ten seconds, on the shipped bench."""

import math
import re

import pytest

from haptic_fieldbus import plan, run
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.signals import Workspace
from tests.cases import every

TRAVEL = 0.1
"""[m] to each side of the middle, the free way of the shipped bench."""
FELT = 0.01
"""Share of the rated force; ten steps of the target torque. A scene that gives less is not shown by its hand."""


@every("scene", scene_names())
def test_the_shipped_bench_has_a_limited_way_where_it_is_linear(scene: str) -> None:
    for axis in plan(scene).axes:
        assert axis.limits.position == ((-TRAVEL, TRAVEL) if axis.workspace is Workspace.LINEAR else None)


@pytest.mark.thorough("every scene of the library for ten seconds", quick=1)
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
        for stop in (each for each in result.plan.scene.of_axis(axis.name) if isinstance(each, EndStop)):
            # As far into a stop as the motor pushes back.
            into = axis.limits.effort / stop.stiffness
            assert stop.lower - into < trace.position.min() < trace.position.max() < stop.upper + into
    assert felt > FELT


def test_a_hand_that_leaves_the_bench_ends_the_run() -> None:
    # Nothing holds a free mass against six newtons: within a second the handle is at the end of its way.
    with pytest.raises(SafetyTripError, match=r"position .*0\.1"):
        run("sprung_mass", hand="push", duration=10.0)


@pytest.mark.thorough("a run of 30 s")
def test_a_wall_that_is_leant_on_for_longer_scores_the_same() -> None:
    """Most of it is rest, which counts for nothing."""
    short, long = (run("wall", duration=duration).torque_error for duration in (3.0, 30.0))
    assert short is not None
    assert long is not None
    assert (short.contact, short.contact_s) == pytest.approx((long.contact, long.contact_s), rel=0.1)


@pytest.mark.thorough("a run of 3 s")
def test_a_knob_that_is_pushed_says_what_its_motor_cannot_give() -> None:
    result = run("knob_menu", hand="push", duration=3.0)
    (told,) = (re.search(r"the motor applied ([\d.]+) of the ([\d.]+) N·m requested", each) for each in result.warnings)
    assert result.plan is not None
    (axis,), (trace,) = result.plan.axes, result.traces
    assert told is not None
    assert float(told[1]) == pytest.approx(axis.limits.effort, rel=1e-2)
    # At the stop, 300°, the menu itself is a crest and asks for nothing.
    beyond = max(abs(trace.position.max() - math.radians(300.0)), abs(trace.position.min() + math.radians(20.0)))
    assert float(told[2]) == pytest.approx(0.3 * beyond, rel=0.25)
    assert float(told[2]) > axis.limits.effort
    assert result.torque_error is not None
    shares = result.torque_error.by_source
    assert max(shares, key=lambda name: abs(shares[name])) == "limits"

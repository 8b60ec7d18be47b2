"""Library scenes on drives that are too slow for them: softened until the planner takes them, so that they are tested.

Each library scene is stable on the shipped bench with the generic drive. A drive with a longer delay bears less, and a
run of such a scene is refused before there is torque. A test of what happens under torque takes the softened scene.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from haptic_fieldbus import api
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.element import AnyElement, abilities
from haptic_fieldbus.scenes.scene import Scene

STEPS = 8
"""Elements that may need to be softened, one after the other; no scene of the library needs so many."""


def unstable(plan: Plan) -> AxisPlan | None:
    """Return the first axis that the planner calls unstable; None when there is none."""
    return next((each for each in plan.axes if each.stability and each.stability.verdict is Verdict.UNSTABLE), None)


def softened(
    name: str,
    drive: str,
    rate: float | None = 1000.0,
    settings: Mapping[str, float] | None = None,
    bus: str | None = None,
) -> str | Scene:
    """Return the name when the planner calls the scene stable, else the scene with its stiffest elements softened.

    Each of them gets half of its limit. Raises as `api.plan`, and ValueError for a scene that stays unstable.
    """
    plan = api.plan(name, drive=drive, bus=bus, rate=rate, settings=settings)
    if unstable(plan) is None:
        return name
    for _ in range(STEPS):
        axis = unstable(plan)
        if axis is None:
            return plan.scene
        if axis.group is None or axis.group.stiffest is None:  # no stiffness, so nothing to soften
            break
        plan = api.plan(_softer(plan.scene, axis), drive=drive, bus=bus, rate=rate)
    raise ValueError(f"{name} on {drive} stays unstable")


def _softer(scene: Scene, axis: AxisPlan) -> Scene:
    """Return the scene with half the limit, or half its stiffness where nothing is stable, for its stiffest element."""
    assert axis.group is not None
    assert axis.stability is not None
    stiffest: Any = axis.group.stiffest
    half = (axis.stability.stiffness_limit.stable or stiffest.stiffness) / 2.0
    graded = abilities(stiffest).with_stiffness is not None
    soft: AnyElement = stiffest.with_stiffness(half) if graded else replace(stiffest, stiffness=half)
    return replace(scene, elements=tuple(soft if each == stiffest else each for each in scene.elements))

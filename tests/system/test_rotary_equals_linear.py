"""A scene at a lever of one metre is the scene along a line: every shipped scene, from octets to octets.

A motor turn moves a linear handle by 2π metres, so that one radian is one metre and one newton metre is one newton.
"""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.cycle.cycle import Cycle, decoded_columns
from haptic_fieldbus.drive.rig import Limits, LinearMechanism, Rig, RotaryMechanism
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Workspace
from tests.builders import plan_of, rig_of

MECHANISMS = {
    Workspace.LINEAR: LinearMechanism("linear", 2 * math.pi),
    Workspace.ROTARY: RotaryMechanism("rotary"),
}
COUNTS = 400_000
"""A revolution: fine enough that the handle moves smoothly through detents of some millimetres."""
SCENES = [
    name for name in scene_names() if not any(hasattr(element, "workspace") for element in load_scene(name).elements)
]
"""A weight is for linear axes and a pendulum for rotary ones."""


def in_workspace(scene: Scene, workspace: Workspace) -> tuple[Scene, Rig]:
    moved = replace(scene, axes=tuple(SceneAxis(axis.name, workspace) for axis in scene.axes))
    limits = Limits(effort=1000.0, speed=100.0)
    changes = {"mechanism": MECHANISMS[workspace], "encoder_counts_per_revolution": COUNTS, "limits": limits}
    return moved, rig_of(moved, **changes, rated_torque=1000.0)


def forces(plan: Plan) -> list[list[float]]:
    """Of every axis in every period, along two swings of 40 mm."""
    cycle, names = Cycle(plan), decoded_columns(plan)
    places = [cycle.columns.index(f"{axis.name}.force") for axis in plan.axes]
    found = []
    for number in range(3000):
        counts = round(0.04 * math.sin(2 * math.pi * number / 1500) / (2 * math.pi) * COUNTS)
        known = {"t_ns": number * plan.period_ns}
        for lag, axis in enumerate(plan.axes):
            known |= {f"{axis.name}.statusword": 0x0637, f"{axis.name}.position counts": counts // (lag + 1)}
        cycle(plan.image.input.pack(*(known.get(name, 0) for name in names)))
        found.append([cycle.row[place] for place in places])
    assert cycle.trip is None
    return found


@pytest.mark.thorough("renders every scene twice", quick=1)
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_the_same_on_a_line_and_on_a_lever_of_one_metre(name: str) -> None:
    versions = [in_workspace(load_scene(name), workspace) for workspace in Workspace]
    along, around = (forces(plan_of(scene, rig=rig)) for scene, rig in versions)
    largest = max(abs(force) for row in along for force in row)
    assert largest > 0.0
    for left, right in zip(along, around, strict=True):
        assert right == pytest.approx(left, rel=1e-12, abs=1e-12 * largest)

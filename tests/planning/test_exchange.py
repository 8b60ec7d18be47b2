"""The way in which a plan exchanges feedback and set-points: the one that bears the stiffest scene on this bench."""

from dataclasses import replace
from typing import Any

from haptic_fieldbus.drive.rig import Rig, default_axis
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.live_changes import plan_change
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.scenes.damper import Damper
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.builders import scene_of
from tests.protocols.modbus.lines import with_line

LIGHT: dict[str, Any] = {"inertia": 4e-6, "viscous_damping": 1e-3}
"""A handle that its friction stops within a period of a slow line: half a period and the delay do not say it all."""


def planned(
    *elements: Element, functions: tuple[int, ...] = (3, 16, 23), rate: float | None = None, **axis: Any
) -> Plan:
    handle = default_axis(Workspace.LINEAR, bus="line", node=1, profile="drive")
    rig = Rig({"line": parse_bus("sim-modbus-rtu@19200").section}, {"handle": replace(handle, **axis)})
    return compile_plan(scene_of(*elements), rig, {"drive": with_line(answer_time=1e-3, functions=functions)}, rate)


def limit(plan: Plan) -> float:
    return (plan.stability and plan.stability.stiffness_limit.stable) or 0.0


def way(plan: Plan) -> tuple[str, float]:
    return plan.buses[0].traffic.exchange, plan.rate


def test_is_that_of_the_stiffest_scene_at_a_rate_of_its_own() -> None:
    wall = Wall("handle", 100.0)
    free, one, two = (planned(wall, functions=each, **LIGHT) for each in ((3, 16, 23), (23,), (3, 16)))
    assert limit(two) > limit(one)
    assert way(free) == way(two) == ("FC3 then FC16", 27.0)
    assert limit(free) == limit(two)
    damped = Wall("handle", 100.0, damping=2.0)
    alone = [limit(planned(damped, functions=each, **LIGHT)) for each in ((23,), (3, 16))]
    assert limit(planned(damped, **LIGHT)) == max(alone)


def test_is_the_first_of_the_protocol_where_no_limit_is_known() -> None:
    """Half a period and the delay: 1.5 periods of 25 ms by function 23; half of 37 ms and 20 ms by two requests."""
    unknown = planned(Wall("handle", 100.0), **LIGHT | {"inertia": None})
    assert unknown.stability is None
    assert way(unknown) == ("FC23", 40.0)
    assert way(planned(Damper("handle", 1.0), **LIGHT)) == ("FC23", 40.0), "nothing is stiff"


def test_stays_that_of_a_run_when_its_scene_changes() -> None:
    running = planned(Wall("handle", 100.0), rate=20.0, **LIGHT)
    changed = plan_change(running, running, {"wall.stiffness": 80.0}).plan
    assert changed.buses is running.buses
    assert changed.rate == 20.0

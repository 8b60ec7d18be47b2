"""The description of a run for a page: axes, parameters with their limits, the law that is felt, and units."""

import contextlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from haptic_fieldbus.cycle.laws import at_rest
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.margins.group import Group
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.explain import limit_text
from haptic_fieldbus.planning.live_changes import missing
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.recordings.tables import UNITS
from haptic_fieldbus.report.texts import bench_text, scene_text
from haptic_fieldbus.scenes.element import AnyElement, abilities
from haptic_fieldbus.scenes.registry import parameters, place_names, quantities
from haptic_fieldbus.scenes.scene import Scene, axes_of
from haptic_fieldbus.signals import Signal, Workspace

Json = dict[str, Any]
MOTION = {Signal.POSITION, Signal.VELOCITY}
LAW_POINTS = 401
"""Places at which the force of the scene is told."""
OF_AXIS = {"age_ns": "ns", "position counts": "counts"}
OF_RUN = {"t": "s", "lateness_us": "µs", "compute_us": "µs", "energy": "J", "t_ns": "ns"}
SPAN = {Workspace.LINEAR: 0.06, Workspace.ROTARY: math.pi}
"""Half of the travel that is shown where neither the rig nor the scene limits it [m or rad]."""
FROM_ZERO = {
    "m": 0.01, "rad": 0.5, "s": 1.0, "N": 4.0, "N·m": 0.2, "N/m": 500.0, "N·m/rad": 0.5, "N·s/m": 5.0,
    "N·m·s/rad": 0.01, "kg": 1.0, "kg·m²": 1e-4, "Hz": 20.0,
}  # fmt: skip
"""Upper end of the scale of a parameter that is 0, by its unit."""
MOST_STEPS = 200
"""Largest number of steps of a slider, but for one at each end; at least 80, unless whole numbers are fewer."""
ROUNDING = 1e-9
"""Relative tolerance of an end that is a whole multiple of the step but for rounding."""
BEYOND_LIMIT, BEYOND_VALUE = 1.25, 4.0
"""Upper end of a scale, as a multiple of the limit, or of the value where there is none."""


def describe(plan: Plan, running: Plan) -> Json:
    """Return what a page needs to know of a plan, as JSON; `running` is that with which the run began."""
    limits = limits_of_parameters(plan)
    return {
        "scene": plan.scene.name,
        "scene_text": scene_text(plan),
        "bench": bench_text(plan),
        "simulated": plan.simulated,
        "rate": plan.rate,
        "bus_load": max(bus.traffic.load for bus in plan.buses),
        "energy_limit": _finite(min(axis.limits.energy for axis in plan.axes)),
        "limits": [
            limit_text(axis.stability) for axis in plan.axes
            if axis.group is None or axis.group.reference_axis == axis.name
        ],
        "axes": [_axis(plan, axis) for axis in plan.axes],
        "parameters": [_parameter(plan, running, *each, limits.get(each[0])) for each in values_of(plan.scene).items()],
        "units": OF_RUN | {
            f"{axis.name}.{name}": unit for axis in plan.axes
            for name, unit in (OF_AXIS | UNITS[axis.workspace.value]).items()
        },
    }  # fmt: skip


def limits_of_parameters(plan: Plan) -> dict[str, float]:
    """Return the limit of each parameter that has one, by `element.parameter`: stable for every value that is open.

    These are the stiffness of the stiffest element of each axis, or the parameters from which it follows.
    """
    judged = [(axis.group, axis.stability.limit.value) for axis in plan.axes if axis.group and axis.stability]
    return {name: value for each in judged for name, value in _limits(*each).items()}


def _limits(group: Group, limit: float) -> dict[str, float]:
    element = group.stiffest
    if element is None or not 0.0 < limit < math.inf:
        return {}
    graded = abilities(element).with_stiffness
    if graded is None:
        return {f"{element.name}.stiffness": limit}
    softer, names = graded(limit), quantities(type(element))
    changed = {name: getattr(softer, name) for name in names if getattr(softer, name) != getattr(element, name)}
    return {f"{element.name}.{name}": value for name, value in changed.items() if isinstance(value, float)}


def _axis(plan: Plan, axis: AxisPlan) -> Json:
    low, high = _travel(axis)
    return {
        "name": axis.name,
        "rotary": axis.workspace is Workspace.ROTARY,
        "effort_unit": axis.workspace.effort_unit,
        "drive": axis.profile.title,
        "travel": [low, high],
        "effort": axis.limits.effort,
        "law": _law(axis, plan.period, low, high),
        "whole": len(_static(axis)) == len(axis.elements) and not axis.couplings,
        "surfaces": [each for element in axis.elements for each in _surfaces(element)],
        "partner": next((name for each in axis.couplings for name in each.axes if name != axis.name), None),
    }


def _travel(axis: AxisPlan) -> tuple[float, float]:
    """Return the places between which the handle is shown [m or rad].

    These are the limits of the rig; of a much longer travel only the part around all places of the scene.
    """
    places = [abs(getattr(each, name)) for each in axis.elements for name in place_names(type(each))]
    span = max(SPAN[axis.workspace], 1.5 * max((place for place in places if math.isfinite(place)), default=0.0))
    limits = axis.rig.limits.position
    low, high = (-span, span) if limits is None else limits
    return (low if low >= -2.0 * span else -span), (high if high <= 2.0 * span else span)


def _law(axis: AxisPlan, period: float, low: float, high: float) -> list[float | None]:
    """Return the force on a handle at rest at places from `low` to `high`; none where no element is without memory."""
    known, field, step = _static(axis), at_rest(axis.elements, period), (high - low) / (LAW_POINTS - 1)
    return [_finite(field(low + step * number)) if known else None for number in range(LAW_POINTS)]


def _static(axis: AxisPlan) -> list[AnyElement]:
    """Return the elements whose force follows from the motion alone."""
    return [each for each in axis.elements if hasattr(type(each), "force") and each.needs and {*each.needs} <= MOTION]


def _surfaces(element: AnyElement) -> Iterator[Json]:
    """Yield the surfaces of an element that has some, with the side of its material."""
    if abilities(element).penetration is not None:
        for name in place_names(type(element)):
            side = getattr(element, "side", "negative" if name == "lower" else "positive")
            yield {"at": getattr(element, name), "side": side, "name": element.name}


def values_of(scene: Scene) -> dict[str, float]:
    """Return the values of all parameters of a scene that are finite numbers, by `element.parameter`."""
    found = {f"{each.name}.{name}": getattr(each, name) for each in scene.elements for name in parameters(type(each))}
    return {name: value for name, value in found.items() if type(value) in (int, float) and math.isfinite(value)}


def _parameter(plan: Plan, running: Plan, name: str, value: float, limit: float | None) -> Json:
    """Return value, unit and scale of a parameter, and why the run cannot change it, empty where it can."""
    element = next(each for each in plan.scene.elements if each.name == name.partition(".")[0])
    parameter, axis = name.partition(".")[2], plan.axis(axes_of(element)[0])
    quantity = quantities(type(element)).get(parameter)
    unit = quantity.unit(axis.workspace) if quantity else ""
    high = BEYOND_LIMIT * limit if limit else BEYOND_VALUE * abs(value) or FROM_ZERO.get(unit, 1.0)
    is_place = parameter in place_names(type(element))
    low, high = _travel(axis) if is_place else (min(0.0, BEYOND_VALUE * value), high)
    low, high, step = round_scale(min(low, value), max(high, value), isinstance(value, int))
    others = {type(value)(each) for each in (low, 0.5 * (low + high), high)} - {value}
    fixed = _fixed(running, element, parameter, others)
    told = {"name": name, "value": value, "limit": limit, "unit": unit, "fixed": fixed}
    return {**told, "low": low, "high": high, "step": step}


SMALLEST_STEP = 1e-300


def round_scale(low: float, high: float, whole: bool) -> tuple[float, float, float]:
    """Return the ends of a scale and the step of its slider, 1, 2 or 5 · 10ⁿ; the ends are whole multiples of it."""
    least = max((high - low) / MOST_STEPS, 1.0 if whole else SMALLEST_STEP)
    power = 10.0 ** math.floor(math.log10(least))
    step = next(each * power for each in (1.0, 2.0, 5.0, 10.0) if each * power >= least * (1.0 - ROUNDING))
    low, high = math.floor(low / step + ROUNDING) * step, math.ceil(high / step - ROUNDING) * step
    return float(exactly(low)), float(exactly(high)), float(exactly(step))


def _fixed(running: Plan, element: Any, parameter: str, others: Iterable[float]) -> str:
    """Return what the loop lacks for each other value of a parameter; empty when it lacks nothing for one of them."""
    found = []
    for value in others:
        with contextlib.suppress(HapticFieldbusError, ValueError):
            other = replace(element, **{parameter: value})
            found.append([each for name in axes_of(other) for each in missing(running.axis(name), other)])
    return found[0][0] if found and all(found) else ""


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def base_command(arguments: list[str]) -> list[str]:
    """Return a command line without the options of the view and of the parameters, which a page adds anew.

    That of `demo` is that of the same run.
    """
    if arguments[:1] == ["demo"]:
        return ["run", "wall", "--hand", "none"]
    kept: list[str] = []
    words = iter(arguments)
    for word in words:
        if word in ("--set", "--view-host", "--view-port"):
            next(words, None)
        elif not word.startswith(("--set=", "--view")):
            kept.append(word)
    return kept

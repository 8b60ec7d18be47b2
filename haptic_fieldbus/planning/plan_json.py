"""A plan as the JSON object that the command line prints; its keys are a contract."""

from typing import cast

from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.limit_table import limit_rows
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.sign_probe import is_checked, sign_probe
from haptic_fieldbus.planning.ways import way_limits
from haptic_fieldbus.protocols.registry import TRAFFIC_KEYS
from haptic_fieldbus.protocols.traffic import Json


def plan_json(plan: Plan) -> dict[str, Json]:
    """Return the object that `plan --json` prints; delays and ages in s."""
    delay = plan.delay
    return {
        **summary_json(plan),
        **_traffic_json(plan),
        "bus_load": plan.bus_load,
        "delay_s": {
            "bus": delay.bus,
            "compute": delay.compute,
            "drive": delay.drive,
            "torque_loop": delay.torque_loop,
            "total": delay.total,
        },
        "ways": [way.to_json() for way in way_limits(plan)],
        "couplings": [
            {"name": each.name, "age_s": {on: dict(ages) for on, ages in each.ages.items()}}
            for each in plan.coupling_ages
        ],
        "limits": [row for axis in plan.axes for row in _limits_json(axis, plan.period)],
        "guards": [guard.to_json() for guard in plan.guards],
        "sign": [_sign_json(axis, plan.period) for axis in plan.axes],
        "stability": None if plan.stability is None else cast(Json, plan.stability.to_json()),
        "modules": list(plan.modules),
        "deadlines": [each.to_json() for each in plan.deadlines],
    }


def summary_json(plan: Plan) -> dict[str, Json]:
    return {
        "mapped": list(plan.mapped),
        "left_out": [{"what": left_out.what, "why": left_out.why} for left_out in plan.left_out],
        "assumed": list(plan.assumed),
    }


def _traffic_json(plan: Plan) -> dict[str, Json]:
    """Return the process data exchanged, by the key of each protocol; None for a protocol that no axis uses."""
    # All keys are present from the start: the keys of the object do not depend on the bench.
    found: dict[str, Json] = dict.fromkeys(TRAFFIC_KEYS.values())
    for axis in plan.axes:
        for key, rows in axis.traffic.to_json(axis.rig.bus).items():
            before = found.get(key)
            found[key] = [*(before if isinstance(before, list) else ()), *rows]
    return found


def _sign_json(axis: AxisPlan, period: float) -> dict[str, Json]:
    """Return how the sign of an axis is seen; None for what is not known, or not needed."""
    probe = sign_probe(axis, period)
    return {
        "axis": axis.name,
        "pulses": [] if probe is None else [[stage.effort, stage.periods * period] for stage in probe.stages],
        "bound": None if probe is None else axis.limits.unseen,
        "checked": None if probe is None else is_checked(axis),
        "travel": None if probe is None else probe.travel,
        "farthest": None if probe is None else probe.farthest,
        "least_s": None if probe is None else probe.time,
        "permitted_until_then": None if probe is None else probe.holding,
    }


def _limits_json(axis: AxisPlan, period: float) -> list[Json]:
    return [
        {
            "axis": axis.name,
            "limit": row.name,
            "value": row.value,
            "unit": row.unit,
            "reaction": row.reaction.value,
            "after_s": row.time,
        }
        for row in limit_rows(axis, period)
    ]

"""New values for a scene that runs: checked, compiled and judged as those of a new run, before anything changes.

What a run maps, estimates and integrates was decided before its first period, and stays: a change that needs more asks
for a new run.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from haptic_fieldbus.errors import PlanError, UnstableSceneError, UsageError
from haptic_fieldbus.margins.linear import ROUNDING
from haptic_fieldbus.margins.transition import SHARES, mixed
from haptic_fieldbus.numerals import percent
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.planning.settings import settled
from haptic_fieldbus.planning.verdicts import grouped
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal

RAMP = 0.1
"""[s]; from the old values to the new."""
MISSING = {
    Signal.VELOCITY: "velocity, which this run does not estimate",
    Signal.TORQUE_ACTUAL: "torque actual, which this run does not map",
    Signal.ELAPSED_NS: "the time, which this run does not count",
}


@dataclass(frozen=True)
class Change:
    """New values that passed every check; `settings` are as the scene has them, in SI."""

    settings: Mapping[str, Setting]
    plan: Plan
    """The running plan with these values."""
    time: float = 0.0
    """When it is to begin [s from operation enabled]; one that is asked for in a run begins at once."""


@dataclass(frozen=True)
class Applied:
    """A change and when it came into force."""

    change: Change
    time: float
    """When the ramp began [s from operation enabled]."""
    after_ns: int
    """Latch instant of the last period with the old values alone."""
    periods: int
    """Length of the ramp."""


def plan_change(
    running: Plan, last: Plan, settings: Mapping[str, Setting], *, force: bool = False, time: float = 0.0
) -> Change:
    """Settings on top of `last`, the plan of the change before, for a loop that was made for `running`.

    Raises SceneError, UsageError or PlanError as a new run would; UnstableSceneError unless `force`, also where both
    ends are stable and the way between is not. Nothing is touched.
    """
    if not settings:
        raise UsageError('a change names what it changes, such as {"wall.stiffness": 800.0}')

    wanted = settled(last.scene, settings)
    plan = _compiled(running, wanted.scene)
    if wanted.part is not None:
        plan = _compiled(running, wanted.at(plan.stability))
    refused = dict.fromkeys(_beyond(running, plan))
    if refused:
        raise PlanError("\n".join(f"{sentence}: start a new run" for sentence in refused))
    if not force:
        check_stable(plan, running=True)
        _check_transition(last, plan)
    return Change({setting: _value(plan.scene, setting) for setting in settings}, plan, time)


def _compiled(running: Plan, scene: Scene) -> Plan:
    """The scene on the bench of the running loop, by its methods."""
    profiles = {axis.rig.profile: axis.profile for axis in running.axes}
    method = next((axis.method for axis in running.axes if axis.method), None)
    estimator = next((axis.estimator for axis in running.axes if axis.estimator and not axis.integrates), None)
    return compile_plan(scene, running.rig, profiles, running.rate, method=method, estimator=estimator)


def _beyond(running: Plan, plan: Plan) -> Iterator[str]:
    """What elements need and the loop has not."""
    for axis, wanted in zip(running.axes, plan.axes, strict=True):
        for element in _forces(wanted):
            for signal in element.needs:
                if signal not in axis.needs and signal in MISSING:
                    yield f"{element.name} needs {MISSING[signal]}"


def _check_transition(before: Plan, after: Plan) -> None:
    """Both ends are stable; the mixes between them must be so too."""
    changing = {new.name for old, new in zip(before.axes, after.axes, strict=True) if _forces(old) != _forces(new)}
    for share in SHARES:
        axes = [
            replace(
                new,
                elements=mixed(old.elements, new.elements, share),
                couplings=mixed(old.couplings, new.couplings, share),
            )
            for old, new in zip(before.axes, after.axes, strict=True)
        ]
        groups = [group for group in grouped(axes, after.period) if changing & {each.name for each in group.members}]
        if any(group.growth() > 1.0 + ROUNDING for group in groups):
            raise UnstableSceneError(
                "the way to these values is unstable on this bench, though both ends are not: it is with "
                f"{percent(share, 3)} of the new and the rest of the old. Go by other values"
            )


def _forces(axis: AxisPlan) -> tuple[AnyElement, ...]:
    return (*axis.elements, *axis.couplings)


def _value(scene: Scene, setting: str) -> Setting:
    name, _, parameter = setting.rpartition(".")
    value: Setting = next(getattr(element, parameter) for element in scene.elements if element.name == name)
    return value

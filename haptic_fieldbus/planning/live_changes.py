"""New values for a scene that runs: checked, compiled and judged as for a new run, before anything changes.

The mapped and estimated signals of a run, and the judgement of its energy, are fixed before its first period. A change
that needs further signals, or whose energy could not be judged, needs a new run and is refused.

While old forces fade out and new forces fade in, the loop has both. With the share w of the new elements and 1 − w of
the old, the force is the sum. The loop is again linear and is judged as any other. For two walls the mix is a wall with
a stiffness and damping in between; elements with virtual states contribute the states of both. The share is constant
for each judgement. A ramp of a tenth of a second is slow compared with the loop, but this is no proof for a changing
share.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from haptic_fieldbus.errors import PlanError, UnstableSceneError, UsageError
from haptic_fieldbus.margins.linear import ROUNDING
from haptic_fieldbus.numerals import percent
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import scaled
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.compile import compile_plan, grouped
from haptic_fieldbus.planning.energy import unbounded
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.refusal import check_stable
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import at_limit, settled
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement, Local, is_varying
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal

SHARES = tuple(eighth / 8 for eighth in range(1, 8))
"""Shares of the new elements at which the transition is judged."""


@dataclass(frozen=True)
class Faded:
    """An element, or a coupling, with a share of its force, for the judgement of stability alone."""

    element: Any
    share: float

    @property
    def needs(self) -> tuple[Signal, ...]:
        return tuple(self.element.needs)

    @property
    def name(self) -> str:
        return str(self.element.name)

    @property
    def axis(self) -> str:
        return str(self.element.axis)

    @property
    def axes(self) -> tuple[str, ...]:
        return tuple(self.element.axes)

    def linearised(self) -> StateSpace:
        return scaled(self.element.linearised(), self.share)


@dataclass(frozen=True)
class FadedDynamic(Faded):
    """A faded element whose virtual states an integrator steps."""

    @property
    def dynamics(self) -> StateSpace:
        return scaled(self.element.dynamics, self.share)


@dataclass(frozen=True)
class FadedVarying(Faded):
    """A faded element that is judged at all places."""

    def local(self, lower: float, upper: float) -> Local:
        """Return the bounds of the element with its share of force, stiffness and damping."""
        whole: Local = self.element.local(lower, upper)
        force, stiffness = ((self.share * low, self.share * high) for low, high in (whole.force, whole.stiffness))
        return Local(force, stiffness, self.share * whole.damping, whole.loss)

    def places(self, lower: float, upper: float, effort: float) -> tuple[float, ...]:
        """Return the places of the element."""
        return tuple(self.element.places(lower, upper, effort))


def _kind_of(element: AnyElement) -> type[Faded]:
    if isinstance(element, DynamicElement):
        return FadedDynamic
    return FadedVarying if is_varying(element) else Faded


def mixed(before: Sequence[AnyElement], after: Sequence[AnyElement], share: float) -> tuple[Any, ...]:
    """Return the mixed elements: unchanged elements once, changed elements twice, the new one with this share.

    `before` and `after` have the same length and order.
    """
    mix: list[Any] = []
    for old, new in zip(before, after, strict=True):
        if new == old:
            mix.append(new)
        else:
            kind = _kind_of(new)
            mix += [kind(old, 1.0 - share), kind(new, share)]
    return tuple(mix)


RAMP = 0.1
"""Time from the old values to the new ones, unless given [s]."""
MISSING = {
    Signal.VELOCITY: "velocity, which this run does not estimate",
    Signal.TORQUE_ACTUAL: "torque actual, which this run does not map",
    Signal.ELAPSED_NS: "the time, which this run does not count",
}
"""Signals that a run may lack, in the words of a refusal; the position is never missing."""


@dataclass(frozen=True)
class Change:
    """New values that passed all checks; `settings` are the values that the new scene has, in SI."""

    settings: Mapping[str, Setting]
    plan: Plan
    """The running plan with these values."""
    time: float = 0.0
    """Scheduled begin [s from operation enabled]; 0 for a change requested during the run, which begins at once."""


@dataclass(frozen=True)
class RampingChange:
    """A change whose ramp has begun."""

    change: Change
    time: float
    """Begin of the ramp [s from operation enabled]."""
    after_ns: int
    """Latch instant of the last period with the old values alone."""
    periods: int
    """Length of the ramp in periods."""
    due: float = 0.0
    """Time from which the change was tried [s from operation enabled]: a repeated run has it scheduled for that."""


def plan_change(
    running: Plan, last: Plan, settings: Mapping[str, Setting], *, force: bool = False, time: float = 0.0
) -> Change:
    """Return the change that applies `settings` to `last`, the plan after the previous change; nothing is changed yet.

    `running` is the plan at the start of the loop, `time` the scheduled begin [s from operation enabled]. Raises
    SceneError, UsageError or PlanError as a new run would, and PlanError for a signal that the loop lacks. Raises
    UnstableSceneError when a new run with these values would be refused, or when a mix of old and new elements is
    unstable. With `force` it is raised only for a run on a real bus without a force cap.
    """
    if not settings:
        raise UsageError('a change names what it changes, such as {"wall.stiffness": 800.0}')

    task = Task(last.scene, settings=settings)
    scene, part = settled(task)
    plan = _compiled(running, scene)
    if part is not None:  # a part of the limit, which is known from the first plan
        plan = _compiled(running, at_limit(task, scene, part, plan.stability))
    # A sentence occurs once, however many axes it is about.
    refused = dict.fromkeys(_beyond(running, plan))
    if refused:
        raise PlanError("\n".join(f"{sentence}: start a new run" for sentence in refused))
    is_capped = running.simulated or all(axis.forced for axis in running.axes)
    if not (force and is_capped):
        check_stable(plan, running=True)
        _check_transition(last, plan)
    elements = {element.name: element for element in plan.scene.elements}
    named = {setting: setting.rpartition(".") for setting in settings}
    return Change({each: getattr(elements[name], key) for each, (name, _, key) in named.items()}, plan, time)


def _compiled(running: Plan, scene: Scene) -> Plan:
    """Return the plan of `scene` on the bench of the running loop, with its exchange, integrator and estimator."""
    profiles = {axis.rig.profile: axis.profile for axis in running.axes}
    method = next((axis.method for axis in running.axes if axis.method), None)
    # Method and estimator are the same on all axes that have one; a tachometer cannot be chosen, so it is left out.
    estimator = next((axis.estimator for axis in running.axes if axis.estimator and not axis.integrates), None)
    return compile_plan(
        scene, running.rig, profiles, running.rate, method=method, estimator=estimator, buses=running.buses,
        forced=any(axis.forced for axis in running.axes),
    )  # fmt: skip


def _beyond(running: Plan, plan: Plan) -> Iterator[str]:
    """Yield a sentence for each signal that an element needs and the running loop lacks, and for each lost guard."""
    for axis, wanted in zip(running.axes, plan.axes, strict=True):
        if math.isfinite(axis.limits.energy):
            for name in unbounded(wanted):
                yield f"{name} could then apply any force by itself, but this run limits the energy"
        for element in _forces(wanted):
            yield from missing(axis, element)


def missing(running: AxisPlan, element: AnyElement) -> Iterator[str]:
    """Yield a sentence for each signal that an element needs and the loop of a running axis lacks."""
    for signal in element.needs:
        if signal not in running.needs and signal in MISSING:
            yield f"{element.name} needs {MISSING[signal]}"


def _check_transition(before: Plan, after: Plan) -> None:
    """Raise UnstableSceneError when a mix of two stable sets of elements, old and new, is unstable."""
    changing = {new.name for old, new in zip(before.axes, after.axes, strict=True) if _forces(old) != _forces(new)}
    for share in SHARES:
        axes = []
        for old, new in zip(before.axes, after.axes, strict=True):
            couplings = mixed(old.couplings, new.couplings, share)
            axes.append(replace(new, elements=mixed(old.elements, new.elements, share), couplings=couplings))
        # Groups without a change need not be judged again.
        groups = [group for group in grouped(axes, after.period) if changing & {each.name for each in group.members}]
        if any(group.growth() > 1.0 + ROUNDING for group in groups):
            raise UnstableSceneError(
                "the change to these values is unstable on this bench, though both ends are stable: a mix of old "
                f"values and {percent(share, 3)} of the new ones is unstable. Use intermediate values"
            )


def _forces(axis: AxisPlan) -> tuple[AnyElement, ...]:
    """Return all elements and couplings that act on an axis."""
    return (*axis.elements, *axis.couplings)

"""From a scene, a rig and a rate to the smallest loop that renders it.

needs → providers → prune → lay out → budget → stability → steps. Nothing here talks to a drive; a plan is a value.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from haptic_fieldbus.axis_plan import AxisPlan, draft_axis, judged
from haptic_fieldbus.drive.budget import COMPUTE_NS, NODE_HEARTBEAT_MS, Delay, Exchange, check_load, heartbeat_every
from haptic_fieldbus.drive.image import ImageLayout, lay_out_image
from haptic_fieldbus.drive.pdo import Pdo
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.explain import explain
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.scenes.element import DynamicElement
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal

MASTER_NODES = range(127, 0, -1)
"""Our own node-ID, for the heartbeat: the first that no drive has."""


@dataclass(frozen=True)
class LeftOut:
    """Something that this scene does without, and why."""

    what: str
    why: str


@dataclass(frozen=True)
class Plan:
    """Everything that one period needs, decided before the first."""

    scene: Scene
    rig: Rig
    rate: float
    bitrate: int
    axes: tuple[AxisPlan, ...]
    image: ImageLayout
    bus_load: float
    heartbeat_every: int
    left_out: tuple[LeftOut, ...]
    steps: tuple[str, ...]
    modules: tuple[str, ...]
    master_node: int
    node_heartbeat_ms: int = NODE_HEARTBEAT_MS
    compute_ns: int = COMPUTE_NS

    @property
    def period(self) -> float:
        """[s]."""
        return self.period_ns * 1e-9

    @property
    def period_ns(self) -> int:
        return round(1e9 / self.rate)

    @property
    def pdos(self) -> tuple[Pdo, ...]:
        return tuple(pdo for axis in self.axes for pdo in axis.tpdos + axis.rpdos)

    @property
    def mapped(self) -> tuple[str, ...]:
        """Mapped objects such as `6064h:00 position actual value`, each once."""
        return tuple(dict.fromkeys(str(entry) for pdo in self.pdos for entry in pdo.entries))

    @property
    def delay(self) -> Delay:
        """The longest of all axes."""
        return max((axis.delay for axis in self.axes), key=lambda delay: delay.total)

    @property
    def stability(self) -> Stability | None:
        """The axis with the smallest margin; None when a bench is unknown."""
        known = [axis.stability for axis in self.axes if axis.stability is not None]
        if len(known) < len(self.axes):
            return None
        return min(known, key=lambda stability: math.inf if stability.margin is None else stability.margin)

    def explain(self) -> str:
        """The plan in words; the golden text of a scene on a profile."""
        return explain(self)


def compile_plan(
    scene: Scene,
    rig: Rig,
    profiles: Mapping[str, DriveProfile],
    rate: float,
    *,
    method: str | None = None,
    estimator: str | None = None,
) -> Plan:
    """Compile `scene` for `rig` at `rate` [Hz]; `profiles` holds those that the rig names.

    Raises PlanError (and its kinds) when it cannot be rendered, SceneError when the scene does not fit the rig.
    """
    drafts = [draft_axis(scene, axis, rig, profiles, method, estimator) for axis in scene.axes]
    bitrate = rig.bus[_only_bus(rig, scene)].bitrate
    exchange = Exchange(
        tuple(pdo for draft in drafts for pdo in draft.tpdos),
        tuple(pdo for draft in drafts for pdo in draft.rpdos),
        bitrate,
    )
    period = round(1e9 / rate) * 1e-9
    deadline = min(draft.profile.link_loss.deadline for draft in drafts)
    every = heartbeat_every(deadline, rate)
    load = exchange.load(rate, every, len(drafts))
    check_load(exchange, rate, load)
    axes = tuple(judged(draft, exchange, period) for draft in drafts)
    return Plan(
        scene=scene,
        rig=rig,
        rate=rate,
        bitrate=bitrate,
        axes=axes,
        image=lay_out_image([(axis.tpdos, axis.rpdos) for axis in axes]),
        bus_load=load,
        heartbeat_every=every,
        left_out=tuple(_left_out(axes)),
        steps=tuple(step for axis in axes for step in _steps(axis, f"{axis.name}: " if len(axes) > 1 else "")),
        modules=_modules(axes),
        master_node=next(node for node in MASTER_NODES if node not in {axis.node for axis in axes}),
    )


def _only_bus(rig: Rig, scene: Scene) -> str:
    names = {rig.axis[axis.name].bus for axis in scene.axes}
    if len(names) != 1:
        raise PlanError(f"{scene.name}: its axes are on several buses ({', '.join(sorted(names))}); one is supported")
    return names.pop()


def _steps(axis: AxisPlan, prefix: str) -> Iterator[str]:
    """The straight line from decode to encode, as `cycle` binds it."""
    yield f"{prefix}link: trip on lost feedback, emergency or restart"
    yield f"{prefix}power state: statusword → controlword"
    yield f"{prefix}position: counts → {axis.workspace.length_unit}, speed check"
    if axis.estimator:
        yield f"{prefix}velocity: {axis.estimator}{_judged_as(axis.estimator)}"
    for element in axis.elements:
        how = f", {axis.method}" if isinstance(element, DynamicElement) else ""
        yield f"{prefix}element: {element.name}{how}"
    yield f"{prefix}limits: finite, fade-in, effort, slew"
    yield f"{prefix}encode: {axis.workspace.effort_unit} → target torque"


def _judged_as(estimator: str) -> str:
    """A remark where the estimator is no linear system, so that its stability is judged with another."""
    from haptic_fieldbus.numerics.estimators import judged_as

    other = judged_as(estimator)
    return "" if other is None else f" (not linear: stability is judged with {other})"


def _left_out(axes: tuple[AxisPlan, ...]) -> Iterator[LeftOut]:
    if not any(axis.estimator for axis in axes):
        yield LeftOut("velocity", "no element asks for it")
        yield LeftOut("estimator", "without velocity there is nothing to estimate")
    if not any(Signal.TORQUE_ACTUAL in pdo.signals for axis in axes for pdo in axis.tpdos):
        yield LeftOut("torque actual", "no element asks for it")
    if not any(axis.method for axis in axes):
        yield LeftOut("integrator", "no element has virtual states")
        yield LeftOut("virtual states", "no element has any")


def _modules(axes: tuple[AxisPlan, ...]) -> tuple[str, ...]:
    """Modules of this package that only some scenes need, as far as this one does."""
    modules = {type(element).__module__ for axis in axes for element in axis.elements}
    if any(axis.estimator for axis in axes):
        modules.add("haptic_fieldbus.numerics.estimators")
    if any(axis.method for axis in axes):
        modules.add("haptic_fieldbus.numerics.integrators")
    return tuple(sorted(modules))

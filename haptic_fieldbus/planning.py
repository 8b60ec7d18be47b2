"""From a scene, a rig and a rate to the smallest loop that renders it.

needs → providers → prune → lay out → budget → stability → steps. Nothing here talks to a drive; a plan is a value.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from haptic_fieldbus.axis_plan import AxisPlan, draft_axis, judged
from haptic_fieldbus.drive.budget import (
    COMPUTE_NS,
    NODE_HEARTBEAT_MS,
    Delay,
    Exchange,
    check_load,
    heartbeat_every,
    highest_rate,
)
from haptic_fieldbus.drive.image import ImageLayout, lay_out_image
from haptic_fieldbus.drive.pdo import Pdo
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.explain import explain
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.scenes.element import DynamicElement, MemoryElement
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:  # a scene without couplings does without it
    from haptic_fieldbus.coupled_plan import CouplingAges

MASTER_NODES = range(127, 0, -1)
"""Our own node-ID, for the heartbeat: the first that no drive has."""


@dataclass(frozen=True)
class LeftOut:
    """Something that this scene does without, and why."""

    what: str
    why: str


@dataclass(frozen=True)
class BusPlan:
    """One bus of a plan, by its name in the rig: bit rate [bit/s], share in use, names of the axes on it."""

    name: str
    bitrate: int
    load: float
    heartbeat_every: int
    """Periods between two of our heartbeats."""
    axes: tuple[str, ...]


@dataclass(frozen=True)
class Plan:
    """Everything that one period needs, decided before the first."""

    scene: Scene
    rig: Rig
    rate: float
    buses: tuple[BusPlan, ...]
    """In the order in which the axes name them."""
    axes: tuple[AxisPlan, ...]
    image: ImageLayout
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
    def bitrate(self) -> int:
        """[bit/s]; of the slowest bus."""
        return min(bus.bitrate for bus in self.buses)

    @property
    def bus_load(self) -> float:
        """Of the fullest bus."""
        return max(bus.load for bus in self.buses)

    @property
    def heartbeat_every(self) -> int:
        """Periods between two of our heartbeats, on the bus where they are most frequent."""
        return min(bus.heartbeat_every for bus in self.buses)

    def on(self, bus: BusPlan) -> "Plan":
        """The part of one bus: its axes, and their places in the one process image."""
        at = [position for position, axis in enumerate(self.axes) if axis.name in bus.axes]
        image = replace(self.image, axes=tuple(self.image.axes[position] for position in at))
        return replace(self, buses=(bus,), axes=tuple(self.axes[position] for position in at), image=image)

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
        """That of `weakest`."""
        return None if self.weakest is None else self.weakest.stability

    @property
    def weakest(self) -> AxisPlan | None:
        """The axis with the smallest margin, told by the first of those that are judged together; None when a bench is
        unknown."""
        margins = [axis.stability.margin for axis in self.axes if axis.stability is not None]
        if len(margins) < len(self.axes):
            return None
        place = min(range(len(margins)), key=lambda place: _margin(margins[place]))
        return self.told_by(self.axes[place])

    def told_by(self, axis: AxisPlan) -> AxisPlan:
        """The axis in whose units the verdict on an axis is: of a coupling its first."""
        name = axis.name if axis.judged_with is None else axis.judged_with.axes[0]
        return next(each for each in self.axes if each.name == name)

    @property
    def coupling_ages(self) -> "tuple[CouplingAges, ...]":
        """How old the forces of each coupling are on its axes."""
        if not self.scene.couplings:
            return ()
        from haptic_fieldbus.coupled_plan import ages

        return tuple(ages(self.scene.couplings, self.axes, self.rig))

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
    period = round(1e9 / rate) * 1e-9
    scene = scene.at_period(period)
    drafts = [draft_axis(scene, axis, rig, profiles, method, estimator) for axis in scene.axes]
    exchanges = _exchanges(drafts, rig)
    buses = _buses(drafts, exchanges, rate)
    _check_loads(buses, exchanges, rate)
    axes = tuple(judged(draft, exchanges[draft.rig.bus], period) for draft in drafts)
    if scene.couplings:
        from haptic_fieldbus.coupled_plan import judged_together

        axes = judged_together(axes, scene.couplings, period)
    return Plan(
        scene=scene,
        rig=rig,
        rate=rate,
        buses=buses,
        axes=axes,
        image=lay_out_image([(axis.tpdos, axis.rpdos) for axis in axes]),
        left_out=tuple(_left_out(axes)),
        steps=tuple(step for axis in axes for step in _steps(axis, f"{axis.name}: " if len(axes) > 1 else "")),
        modules=_modules(axes),
        master_node=next(node for node in MASTER_NODES if node not in {axis.node for axis in axes}),
    )


def _margin(margin: float | None) -> float:
    return math.inf if margin is None else margin


def _exchanges(drafts: list[AxisPlan], rig: Rig) -> dict[str, Exchange]:
    """The traffic of each bus; all start together, and who has its feedback first waits for the last."""
    alone = {
        name: Exchange(
            tuple(pdo for draft in drafts if draft.rig.bus == name for pdo in draft.tpdos),
            tuple(pdo for draft in drafts if draft.rig.bus == name for pdo in draft.rpdos),
            rig.bus[name].bitrate,
        )
        for name in dict.fromkeys(draft.rig.bus for draft in drafts)
    }
    last = max(exchange.feedback_time for exchange in alone.values())
    return {name: replace(exchange, waiting=last - exchange.feedback_time) for name, exchange in alone.items()}


def _buses(drafts: list[AxisPlan], exchanges: Mapping[str, Exchange], rate: float) -> tuple[BusPlan, ...]:
    buses = []
    for name, exchange in exchanges.items():
        members = [draft for draft in drafts if draft.rig.bus == name]
        every = heartbeat_every(min(draft.profile.link_loss.deadline for draft in members), rate)
        load = exchange.load(rate, every, len(members))
        buses.append(BusPlan(name, exchange.bitrate, load, every, tuple(draft.name for draft in members)))
    return tuple(buses)


def _check_loads(buses: tuple[BusPlan, ...], exchanges: Mapping[str, Exchange], rate: float) -> None:
    """Only the fullest bus need be looked at: a rate that it can carry fits all."""
    fullest = min(buses, key=lambda bus: highest_rate(exchanges[bus.name], rate, bus.load))
    check_load(exchanges[fullest.name], rate, fullest.load, fullest.name if len(buses) > 1 else "")


def _steps(axis: AxisPlan, prefix: str) -> Iterator[str]:
    """The straight line from decode to encode, as `cycle` binds it."""
    yield f"{prefix}link: trip on lost feedback, emergency or restart"
    yield f"{prefix}power state: statusword → controlword"
    yield from (f"{prefix}{step}" for step in (_integrated(axis) if axis.integrates else _estimated(axis)))
    for element in (*axis.elements, *axis.couplings):
        how = f", {axis.method}" if isinstance(element, DynamicElement) else ""
        yield f"{prefix}element: {element.name}{how}"
    yield f"{prefix}limits: finite, fade-in, effort, slew"
    yield f"{prefix}encode: {axis.workspace.effort_unit} → target torque"


def _estimated(axis: AxisPlan) -> Iterator[str]:
    """Motion of the handle from the encoder."""
    yield f"position: counts → {axis.workspace.length_unit}, speed check"
    if axis.estimator:
        yield f"velocity: {axis.estimator}{_judged_as(axis.estimator)}"


def _integrated(axis: AxisPlan) -> Iterator[str]:
    """Motion of the handle from the drive's own velocity."""
    unit, step, drift = axis.workspace.length_unit, abs(axis.velocity_unit), axis.limits.drift
    yield f"velocity: as the drive reads it, in steps of {step:.3g} {unit}/s, speed check"
    yield (
        f"position: velocity → {unit} by the trapezoid; drift trip when it may be off by {drift:.3g} {unit}, "
        f"after {2 * drift / step:.3g} s"
    )


def _judged_as(estimator: str) -> str:
    """A remark where the estimator is no linear system, so that its stability is judged with another."""
    from haptic_fieldbus.numerics.estimators import judged_as

    other = judged_as(estimator)
    return "" if other is None else f" (not linear: stability is judged with {other})"


def _left_out(axes: tuple[AxisPlan, ...]) -> Iterator[LeftOut]:
    for axis in axes:
        offered = axis.profile.offers()
        if Signal.VELOCITY in offered and not axis.integrates:
            why = "the filter behind it is not known; what is estimated from position has known dynamics"
            yield LeftOut(str(offered[Signal.VELOCITY]), f"{axis.profile.title} offers it, but {why}")
    if not any(_estimates(axis) for axis in axes):
        if any(axis.integrates for axis in axes):
            yield LeftOut("estimator", "the drive reads velocity itself")
        else:
            yield LeftOut("velocity", "no element asks for it")
            yield LeftOut("estimator", "without velocity there is nothing to estimate")
    if not any(Signal.TORQUE_ACTUAL in pdo.signals for axis in axes for pdo in axis.tpdos):
        yield LeftOut("torque actual", "no element asks for it")
    if not any(axis.method for axis in axes):
        remembers = any(isinstance(element, MemoryElement) for axis in axes for element in axis.elements)
        why = "what elements remember, they step by themselves" if remembers else "no element has virtual states"
        yield LeftOut("integrator", why)
        if not remembers:
            yield LeftOut("virtual states", "no element has any")


def _estimates(axis: AxisPlan) -> bool:
    return axis.estimator is not None and not axis.integrates


def _modules(axes: tuple[AxisPlan, ...]) -> tuple[str, ...]:
    """Modules of this package that only some scenes need, as far as this one does."""
    modules = {type(element).__module__ for axis in axes for element in (*axis.elements, *axis.couplings)}
    if any(_estimates(axis) for axis in axes):
        modules.add("haptic_fieldbus.numerics.estimators")
    if any(axis.integrates for axis in axes):
        modules.add("haptic_fieldbus.tachometer_axis")
    if any(axis.method for axis in axes):
        modules.add("haptic_fieldbus.numerics.integrators")
    return tuple(sorted(modules))

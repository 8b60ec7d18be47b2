"""From a scene, a rig and a rate to the smallest loop that renders it.

needs → providers → prune → lay out → budget → stability → steps.
"""

from collections.abc import Iterator, Mapping

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan, draft_axis
from haptic_fieldbus.planning.image import lay_out_image
from haptic_fieldbus.planning.plan import BusPlan, LeftOut, Plan
from haptic_fieldbus.planning.verdicts import with_delay, with_verdicts
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.protocols.traffic import BusTraffic
from haptic_fieldbus.scenes.element import DynamicElement, MemoryElement
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal


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
    buses = _buses(drafts, rig, rate)
    delays = {axis: bus.traffic.delay(axis) for bus in buses for axis in bus.axes}
    axes = with_verdicts([with_delay(draft, delays[draft.name], period) for draft in drafts], period)
    return Plan(
        scene=scene,
        rig=rig,
        rate=rate,
        buses=buses,
        axes=axes,
        image=lay_out_image([axis.traffic for axis in axes]),
        left_out=tuple(_left_out(axes)),
        steps=tuple(step for axis in axes for step in _steps(axis, f"{axis.name}: " if len(axes) > 1 else "")),
        modules=_modules(axes),
    )


def _buses(drafts: list[AxisPlan], rig: Rig, rate: float) -> tuple[BusPlan, ...]:
    """In the order in which the axes name them; all start together, and who has its feedback first waits for the last.

    Raises BusOverloadError; only the fullest bus need be looked at, for a rate that it can carry fits all.
    """
    names = dict.fromkeys(draft.rig.bus for draft in drafts)
    alone = {name: _traffic(name, drafts, rig, rate, 0.0) for name in names}
    last = max(traffic.feedback_time for traffic in alone.values())
    together = {name: _traffic(name, drafts, rig, rate, last - alone[name].feedback_time) for name in names}
    fullest = min(together, key=lambda name: together[name].highest_rate)
    together[fullest].check(fullest if len(together) > 1 else "")
    return tuple(
        BusPlan(name, rig.bus[name].protocol, traffic, tuple(draft.name for draft in drafts if draft.rig.bus == name))
        for name, traffic in together.items()
    )


def _traffic(name: str, drafts: list[AxisPlan], rig: Rig, rate: float, waiting: float) -> BusTraffic:
    members = {draft.name: (draft.profile, draft.traffic) for draft in drafts if draft.rig.bus == name}
    return protocol_named(rig.bus[name].protocol).bus_traffic(rig.bus[name], members, rate, waiting)


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
        yield f"velocity: {axis.estimator}{_linear_note(axis.estimator)}"


def _integrated(axis: AxisPlan) -> Iterator[str]:
    """Motion of the handle from the drive's own velocity."""
    unit, step, drift = axis.workspace.length_unit, abs(axis.velocity_unit), axis.limits.drift
    yield f"velocity: as the drive reads it, in steps of {in_unit(step, f'{unit}/s')}, speed check"
    yield (
        f"position: velocity → {unit} by the trapezoid; drift trip when it may be off by {in_unit(drift, unit)}, "
        f"after {rounded(2 * drift / step)} s"
    )


def _linear_note(estimator: str) -> str:
    """A remark where the estimator is no linear system, so that its stability is judged with another."""
    from haptic_fieldbus.numerics.estimators import linear_stand_in

    other = linear_stand_in(estimator)
    return "" if other is None else f" (not linear: stability is judged with {other})"


def _left_out(axes: tuple[AxisPlan, ...]) -> Iterator[LeftOut]:
    for axis in axes:
        offered = axis.profile.offers()
        if Signal.VELOCITY in offered and not axis.integrates:
            why = "the filter behind it is not known; what is estimated from position has known dynamics"
            yield LeftOut(offered[Signal.VELOCITY].address, f"{axis.profile.title} offers it, but {why}")
    if not any(_estimates(axis) for axis in axes):
        if any(axis.integrates for axis in axes):
            yield LeftOut("estimator", "the drive reads velocity itself")
        else:
            yield LeftOut("velocity", "no element asks for it")
            yield LeftOut("estimator", "without velocity there is nothing to estimate")
    if not any(mapped.signal is Signal.TORQUE_ACTUAL for axis in axes for mapped in axis.incoming):
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
        modules.add("haptic_fieldbus.cycle.tachometer")
    if any(axis.method for axis in axes):
        modules.add("haptic_fieldbus.numerics.integrators")
    return tuple(sorted(modules))

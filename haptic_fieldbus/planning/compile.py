"""Compilation of a scene, a rig and a rate to the smallest loop that renders the scene.

The order is: needs → providers → prune → lay out → budget → stability → steps. Needs are the union over the elements
and what safety always needs, which is the position and the echo of the set-points; a signal that nothing needs is
neither mapped nor decoded nor estimated.
"""

import math
from collections.abc import Iterator, Mapping

from haptic_fieldbus.drive.profile import STANDARD, DriveProfile
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan, draft_axis
from haptic_fieldbus.planning.encoder_probe import encoder_probe
from haptic_fieldbus.planning.energy import unbounded, with_energy_limits
from haptic_fieldbus.planning.exchange import plan_buses
from haptic_fieldbus.planning.guards import CAPPED, unguarded
from haptic_fieldbus.planning.image import lay_out_image
from haptic_fieldbus.planning.plan import BusPlan, LeftOut, Plan
from haptic_fieldbus.planning.sign_probe import check_steps, sign_probe, sign_text
from haptic_fieldbus.planning.verdicts import on_bus, with_verdicts
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.scenes.element import DynamicElement, MemoryElement
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal


def compile_plan(
    scene: Scene,
    rig: Rig,
    profiles: Mapping[str, DriveProfile],
    rate: float | None,
    *,
    method: str | None = None,
    estimator: str | None = None,
    buses: tuple[BusPlan, ...] = (),
) -> Plan:
    """Return the plan of `scene` on `rig` at `rate` [Hz]; `profiles` maps the names in the rig to their profiles.

    Without a rate it is the lowest of those that the buses have by themselves. `buses` are those of another plan of the
    same needs, whose rate and exchange are kept.

    Raises PlanError (SignalUnavailableError, ImageTooLargeError, BusOverloadError) when the scene cannot be rendered,
    SceneError when its workspace is not that of the rig, RigError for a zero that the drive cannot have, UsageError for
    an unknown protocol, method or estimator and for a negative stiffness. A loop that is unstable is returned all the
    same: `refusal.check_stable` refuses it.
    """

    def drafts_of(timed: Scene) -> list[AxisPlan]:
        return [draft_axis(timed, axis, rig, profiles, method, estimator) for axis in timed.axes]

    def drafts_at(period: float | None) -> list[AxisPlan]:
        return drafts_of(scene if period is None else scene.at_period(period))

    buses = buses or plan_buses(drafts_at, rig, rate)
    rate = buses[0].traffic.rate
    period = round(1e9 / rate) * 1e-9  # whole nanoseconds, as the loop keeps it
    timed = scene.at_period(period)
    drafts = drafts_of(timed)  # of the elements of the plan's own scene, not of copies
    for draft in drafts:
        check_steps(draft)
    traffic = {axis: bus.traffic for bus in buses for axis in bus.axes}
    seen = [on_bus(draft, traffic[draft.name], period) for draft in drafts]
    axes = with_energy_limits(with_verdicts(seen, period), timed.couplings)
    return Plan(
        scene=timed,
        rig=rig,
        rate=rate,
        buses=buses,
        axes=axes,
        image=lay_out_image([axis.traffic for axis in axes]),
        left_out=tuple(_left_out(axes, rig)),
        steps=tuple(
            step
            for axis in axes
            for step in _steps(axis, f"{axis.name}: " if len(axes) > 1 else "", period, controlled=timed.controlled)
        ),
        modules=_modules(axes, period),
    )


def _steps(axis: AxisPlan, prefix: str, period: float, *, controlled: bool) -> Iterator[str]:
    """Yield the steps of an axis from decoding to encoding in words, in the order in which `cycle` binds them."""
    yield f"{prefix}link: trip on lost feedback, emergency or restart"
    yield f"{prefix}power state: statusword → controlword"
    yield from (f"{prefix}{step}" for step in (_integrated(axis) if axis.integrates else _estimated(axis)))
    if axis.profile.echo is not None:
        yield (
            f"{prefix}echo: {axis.profile.echo.value} against what was sent, needed by safety; trip when they differ "
            f"for {rounded(1e3 * axis.limits.echo)} ms"
        )
    probe = sign_probe(axis, period)
    if probe is not None:
        yield f"{prefix}sign: {sign_text(axis, probe)}"
    if math.isfinite(axis.limits.energy):
        yield f"{prefix}energy: what is given against what was stored and what the hold leaks"
    for element in (*axis.elements, *axis.couplings):
        how = f", {axis.method}" if isinstance(element, DynamicElement) else ""
        yield f"{prefix}element: {element.name}{how}"
    if controlled:
        yield f"{prefix}passivity controller: damping, while more is given than was stored"
    yield f"{prefix}limits: finite, fade-in, effort, slew"
    yield f"{prefix}encode: {axis.workspace.effort_unit} → target torque"


def _estimated(axis: AxisPlan) -> Iterator[str]:
    """Yield the steps that derive the handle's motion from the encoder."""
    yield f"position: counts → {axis.workspace.length_unit}, speed check"
    if axis.estimator:
        yield f"velocity: {axis.estimator}{_linear_note(axis.estimator)}"


def _integrated(axis: AxisPlan) -> Iterator[str]:
    """Yield the steps that derive the handle's motion from the drive's own velocity."""
    # The drift grows by half a step of velocity for all the time that passes, so it takes 2·drift/step seconds.
    unit, step, drift = axis.workspace.length_unit, abs(axis.velocity_unit), axis.limits.drift
    yield f"velocity: as the drive reads it, in steps of {in_unit(step, f'{unit}/s')}, speed check"
    yield (
        f"position: velocity → {unit} by the trapezoid; drift trip when it may be off by {in_unit(drift, unit)}, "
        f"after {rounded(2 * drift / step)} s"
    )


def _linear_note(estimator: str) -> str:
    """Return a remark when the estimator is not linear, so that stability is judged with another one; else empty."""
    # Imported here, because a plan without velocity needs no estimator.
    from haptic_fieldbus.numerics.estimators import linear_stand_in

    other = linear_stand_in(estimator)
    return "" if other is None else f" (not linear: stability is judged with {other})"


def _left_out(axes: tuple[AxisPlan, ...], rig: Rig) -> Iterator[LeftOut]:
    """Yield the parts that the plan does without, each with the reason."""
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
    for axis in axes:
        if _asks(axis, rig):
            why = "is a profile of no particular drive: a run asks the drive, and then plans with what it has"
            yield LeftOut("objects that the drive lacks", f"{axis.profile.title} {why}")
        if axis.profile.echo is None:
            why = "does not show what it was sent (torque.echo of its profile)"
            yield LeftOut("echo of the set-points", f"{axis.profile.title} {why}; {CAPPED}")
        why = unguarded(axis.profile, axis.rig)
        if why:
            yield LeftOut("guard", f"{why}; {CAPPED}, and a person must cut the power (emergency_stop of the rig)")
    for name in dict.fromkeys(name for axis in axes for name in unbounded(axis)):
        yield LeftOut("energy ledger", f"{name} may give any force by itself, so no energy can be called too much")
    if not any(axis.method for axis in axes):
        remembers = any(isinstance(element, MemoryElement) for axis in axes for element in axis.elements)
        why = "what elements remember, they step by themselves" if remembers else "no element has virtual states"
        yield LeftOut("integrator", why)
        if not remembers:
            yield LeftOut("virtual states", "no element has any")


def _asks(axis: AxisPlan, rig: Rig) -> bool:
    """Return True when a run asks the drive which objects of its profile it has."""
    bus, drive = rig.bus[axis.rig.bus], axis.profile.drive
    return drive.evidence == STANDARD and not bus.simulated and protocol_named(bus.protocol).fits_profiles


def _estimates(axis: AxisPlan) -> bool:
    """Return True when the velocity is estimated from the position, and not read from the drive."""
    return axis.estimator is not None and not axis.integrates


def _modules(axes: tuple[AxisPlan, ...], period: float) -> tuple[str, ...]:
    """Return the names of the optional modules of this package that the plan imports, sorted."""
    modules = {type(element).__module__ for axis in axes for element in (*axis.elements, *axis.couplings)}
    if any(_estimates(axis) for axis in axes):
        modules.add("haptic_fieldbus.numerics.estimators")
    if any(axis.integrates for axis in axes):
        modules.add("haptic_fieldbus.cycle.tachometer")
    if any(encoder_probe(axis, period) for axis in axes):
        modules.add("haptic_fieldbus.cycle.standstill")
    if any(axis.method for axis in axes):
        modules.add("haptic_fieldbus.numerics.integrators")
    return tuple(sorted(modules))

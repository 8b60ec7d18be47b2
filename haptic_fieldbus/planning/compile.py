"""Compilation of a scene, a rig and a rate to the smallest loop that renders the scene.

The order is: needs → providers → prune → lay out → budget → stability → steps. The needs are the signals of all
elements, plus the signals for safety: position and echo of the set-points. Any other signal is not mapped, decoded or
estimated.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.drive.profile import STANDARD, DriveProfile
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.margins import Basis, Plant
from haptic_fieldbus.margins.closed_loop import keeping
from haptic_fieldbus.margins.group import Group, Member, groups_of
from haptic_fieldbus.margins.plant import COUPLING_SHARES, Ranges, exact_bench
from haptic_fieldbus.margins.stiffness_map import EVERYWHERE
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning.axis_plan import AxisPlan, draft_axis
from haptic_fieldbus.planning.encoder_probe import encoder_probe
from haptic_fieldbus.planning.energy import unbounded, with_energy_limits
from haptic_fieldbus.planning.guards import CAPPED, unguarded
from haptic_fieldbus.planning.image import lay_out_image
from haptic_fieldbus.planning.known_bench import KnownBench, lags_of, measured_times
from haptic_fieldbus.planning.limits import AGE_SHARE, echo_time, load_of
from haptic_fieldbus.planning.plan import BusPlan, LeftOut, Plan
from haptic_fieldbus.planning.sign_probe import check_steps, sign_probe, sign_text
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.protocols.traffic import BusTraffic, Delay
from haptic_fieldbus.scenes.element import DynamicElement, MemoryElement
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal

# Ranges of the values of an axis; the limit of the axis is the smallest over all of them (`margins.plant`).


def ranges_of(profile: DriveProfile, delay: Delay, bench: KnownBench, *, compliant: bool) -> Ranges:
    """Return the ranges of an axis with this drive, delay and bench, with or without a compliant coupling."""
    if bench.basis is Basis.SIMULATED:
        return exact_bench(lags_of(profile), delay.range, bench.basis)
    times = measured_times(bench, profile, delay, lags_of(profile))
    lags, total = (lags_of(profile), None) if times is None else (times.lags, times.totals)
    ranges = Ranges(lags, delay.range, *bench.shares, basis=bench.basis, total=total)
    return replace(ranges, coupling=COUPLING_SHARES) if compliant else ranges


# Delays and verdicts of the axes of a plan; coupled axes are judged together.

KEPT = 64
"""Number of groups that are kept with their verdicts, for further plans of the same scene on the same bench."""


def _itself(group: Group) -> Group:
    return group


_known = keeping(KEPT, _itself)
"""Return the equal group of an earlier plan, with its verdicts; otherwise this group."""


def on_bus(draft: AxisPlan, traffic: BusTraffic, period: float) -> AxisPlan:
    """Return the axis with the values that follow from its bus: delay, limits of age and echo, plant."""
    age, echo, plant = AGE_SHARE * traffic.guard(draft.name), echo_time(draft.profile.echo, period), draft.plant
    if plant is not None and draft.integrates:
        # At rest an integrated position is a multiple of one velocity step times one period.
        plant = replace(plant, resolution=abs(draft.velocity_unit) * period, tachometer=True)
    found = replace(draft, traffic=traffic.of(draft.name), delay=traffic.delay(draft.name), plant=plant)
    limits = replace(draft.limits, age=age, echo=echo)
    return replace(found, limits=limits, other_masters=traffic.other_masters(draft.name))


def with_verdicts(axes: Sequence[AxisPlan], period: float) -> tuple[AxisPlan, ...]:
    """Return the axes with the verdicts on their groups; an axis has none when a bench in its group is unknown.

    Raises UsageError for a stiffness, method or estimator that cannot be judged.
    """
    found = {axis.name: axis for axis in axes}
    for each in grouped(axes, period):
        for name, verdict in _known(each).stabilities().items():
            found[name] = replace(found[name], stability=verdict, group=each)
    return tuple(found.values())


def grouped(axes: Sequence[AxisPlan], period: float) -> Iterator[Group]:
    """Yield the groups of coupled axes; a group in which a bench is unknown is left out."""
    members = [_member(axis, axis.plant) for axis in axes if axis.plant is not None]
    couplings = tuple(dict.fromkeys(each for axis in axes for each in axis.couplings))
    return groups_of(members, couplings, period)


def _member(axis: AxisPlan, plant: Plant) -> Member:
    """Return the axis as its loop is judged; with a compliant coupling the plant is the motor alone."""
    # A tachometer does not measure the load, so its axis is judged as a rigid one.
    load = None if axis.integrates else load_of(axis.rig, plant)
    times, delay = measured_times(axis.bench, axis.profile, axis.delay, lags_of(axis.profile)), axis.delay.transport
    if times is not None:
        plant, delay = replace(plant, torque_lag=times.lag), times.delay
    return Member(
        axis.name,
        plant if load is None else replace(plant, mass=plant.mass - load.mass),
        delay,
        axis.elements,
        axis.method,
        _estimator(axis),
        () if load is None else (load,),
        ranges_of(axis.profile, axis.delay, axis.bench, compliant=load is not None),
        axis.limits.effort,
        axis.limits.position or EVERYWHERE,
        axis.workspace.stiffness_unit,
    )


def _estimator(axis: AxisPlan) -> str:
    """Return the estimator with which stability is judged; an axis without one gets the default."""
    return axis.estimator or (TACHOMETER if axis.integrates else DEFAULT_ESTIMATOR)


# Exchange of a plan with its drives: the rate, the wait of each bus for the others, and the way of its exchange.
#
# A bus may have several ways to exchange feedback and set-points. The plan takes the way with the largest stable
# stiffness on this bench. If all are equal or unknown (no stiffness, an unknown bench), it takes the protocol's first
# way.

Drafts = Callable[[float | None], list[AxisPlan]]
"""Function from a period [s], or None for no period, to the drafts of all axes."""
Ways = Callable[[float | None, float], Sequence[BusTraffic]]
"""Function from a rate [Hz], or None, and the time for which feedback waits [s] to the ways of exchange of a bus."""
_ROUNDS = 2
"""Number of iterations for the waits of several buses."""


def plan_buses(drafts_at: Drafts, rig: Rig, rate: float | None) -> tuple[BusPlan, ...]:
    """Return the buses with their traffic at `rate` [Hz], in the order of the axes.

    Without a rate the default rate of the chosen exchange is used; with several buses the lowest default. All buses
    begin together. Computing begins when the slowest bus has its feedback; the others wait for it. Raises
    BusOverloadError when a bus cannot carry this.
    """
    drafts = drafts_at(None)
    buses: dict[str, Ways] = {}
    for name in dict.fromkeys(draft.rig.bus for draft in drafts):
        members = {draft.name: (draft.profile, draft.traffic) for draft in drafts if draft.rig.bus == name}
        buses[name] = partial(protocol_named(rig.bus[name].protocol).ways, rig.bus[name], members)
    # First without a wait: the waits follow from the feedback times, and these can change with a wait.
    together = _together(buses, dict.fromkeys(buses, 0.0), drafts_at, rate)
    for _ in range(_ROUNDS):
        last = max(traffic.feedback_time for traffic in together.values())
        waits = {name: last - traffic.feedback_time for name, traffic in together.items()}
        together = _together(buses, waits, drafts_at, rate) if any(waits.values()) else together
    # A rate that the fullest bus can carry fits all buses, so the rate in its error is right for all.
    fullest = min(together, key=lambda name: together[name].highest_rate)
    together[fullest].check(fullest if len(together) > 1 else "")
    return tuple(
        BusPlan(name, rig.bus[name].protocol, traffic, tuple(draft.name for draft in drafts if draft.rig.bus == name))
        for name, traffic in together.items()
    )


def _together(
    buses: Mapping[str, Ways], waits: Mapping[str, float], drafts_at: Drafts, rate: float | None
) -> dict[str, BusTraffic]:
    """Return the traffic of each bus with the largest stability margin; of equal ones the first.

    `waits` is the time for which the feedback of a bus waits for other buses [s].
    """
    if rate is None and len(buses) > 1:
        slowest = min(ways(None, waits[name])[0].rate for name, ways in buses.items())
        rate = 1e3 / math.ceil(1e3 / slowest)  # a period in whole milliseconds, which every drive accepts
    possible = {name: ways(rate, waits[name]) for name, ways in buses.items()}
    chosen = {name: each[0] for name, each in possible.items()}
    for name, each in possible.items():
        if len(each) > 1:
            margins = [_margin({**chosen, name: way}, drafts_at) for way in each]
            chosen[name] = each[margins.index(max(margins))]
    return chosen


def _margin(traffics: Mapping[str, BusTraffic], drafts_at: Drafts) -> float:
    """Return the smallest margin (nominal stability limit divided by stiffness) of all axes; ∞ when none is known."""
    period = round(1e9 / next(iter(traffics.values())).rate) * 1e-9
    axes = [on_bus(draft, traffics[draft.rig.bus], period) for draft in drafts_at(period)]
    return min((group.rough_margin() for group in grouped(axes, period)), default=math.inf)


def compile_plan(
    scene: Scene,
    rig: Rig,
    profiles: Mapping[str, DriveProfile],
    rate: float | None,
    *,
    method: str | None = None,
    estimator: str | None = None,
    buses: tuple[BusPlan, ...] = (),
    forced: bool = False,
) -> Plan:
    """Return the plan of `scene` on `rig` at `rate` [Hz]; `profiles` maps the names in the rig to their profiles.

    Without a rate the lowest default rate of the buses is used. `buses` are the buses of another plan with the same
    needs; their rate and exchange are kept. A `forced` plan is above its limit, so its force is capped.

    Raises PlanError (SignalUnavailableError, ImageTooLargeError, BusOverloadError) when the scene cannot be rendered,
    SceneError when its workspace is not that of the rig, RigError for a zero that the drive cannot have, UsageError for
    an unknown protocol, method or estimator and for a negative stiffness. An unstable loop is returned too:
    `refusal.check_stable` refuses it.
    """

    def drafts_of(timed: Scene) -> list[AxisPlan]:
        return [draft_axis(timed, axis, rig, profiles, method, estimator, forced=forced) for axis in timed.axes]

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
    steps = [(axis.name, step) for axis in axes for step in _steps(axis, period, controlled=timed.controlled)]
    return Plan(
        scene=timed,
        rig=rig,
        rate=rate,
        buses=buses,
        axes=axes,
        image=lay_out_image([axis.traffic for axis in axes]),
        left_out=tuple(_left_out(axes, rig)),
        steps=tuple(f"{name}: {step}" if len(axes) > 1 else step for name, step in steps),
        modules=_modules(axes, period),
    )


def _steps(axis: AxisPlan, period: float, *, controlled: bool) -> Iterator[str]:
    """Yield the steps of an axis from decoding to encoding in words, in the order in which `cycle` binds them."""
    yield "link: trips on lost feedback, emergency or restart"
    yield "power state: statusword → controlword"
    yield from _integrated(axis) if axis.integrates else _estimated(axis)
    if axis.profile.echo is not None:
        differing = f"trips if they differ for {rounded(1e3 * axis.limits.echo)} ms"
        yield f"echo: compares {axis.profile.echo.value} with the sent set-point; {differing}"
    probe = sign_probe(axis, period)
    if probe is not None:
        yield f"sign: {sign_text(axis, probe)}"
    if math.isfinite(axis.limits.energy):
        yield "energy: trips when the loop puts out more than was stored plus the sampling leak"
    for element in (*axis.elements, *axis.couplings):
        how = f", {axis.method}" if isinstance(element, DynamicElement) else ""
        yield f"element: {element.name}{how}"
    if controlled:
        yield "passivity controller: damps when the loop puts out more than was stored"
    yield "limits: finite, fade-in, effort, slew"
    yield f"encode: {axis.workspace.effort_unit} → target torque"


def _estimated(axis: AxisPlan) -> Iterator[str]:
    """Yield the steps that derive the handle's motion from the encoder."""
    yield f"position: counts → {axis.workspace.length_unit}, speed check"
    if axis.estimator:
        yield f"velocity: {axis.estimator}{_linear_note(axis)}"


def _integrated(axis: AxisPlan) -> Iterator[str]:
    """Yield the steps that derive the handle's motion from the drive's own velocity."""
    # The drift grows by half a step of velocity for all the time that passes, so it takes 2·drift/step seconds.
    unit, step, drift = axis.workspace.length_unit, abs(axis.velocity_unit), axis.limits.drift
    yield f"velocity: as the drive reads it, in steps of {in_unit(step, f'{unit}/s')}, speed check"
    yield (
        f"position: velocity → {unit} by the trapezoidal rule; trips when uncertain by {in_unit(drift, unit)}, after "
        f"{rounded(2 * drift / step)} s"
    )


def _linear_note(axis: AxisPlan) -> str:
    """Return a remark when the estimator is not linear, so that stability is judged with another one; else empty."""
    # Imported here, because a plan without velocity needs no estimator.
    from haptic_fieldbus.numerics.estimators import linear_stand_in

    other, group = linear_stand_in(_estimator(axis)), axis.group
    still = ", and with the velocity 0" if group and any(each.loses_velocity for each in group.members) else ""
    return "" if other is None else f" (not linear: stability is checked with {other}{still})"


def _left_out(axes: tuple[AxisPlan, ...], rig: Rig) -> Iterator[LeftOut]:
    """Yield the parts that the plan omits, each with the reason."""
    for axis in axes:
        offered = axis.profile.offers()
        if Signal.VELOCITY in offered and not axis.integrates:
            why = "the filter of the drive is unknown; a velocity estimated from position has known dynamics"
            yield LeftOut(offered[Signal.VELOCITY].address, f"{axis.profile.title} offers it, but {why}")
    if not any(_estimates(axis) for axis in axes):
        if any(axis.integrates for axis in axes):
            yield LeftOut("estimator", "the drive reports velocity itself")
        else:
            yield LeftOut("velocity", "no element needs it")
            yield LeftOut("estimator", "no velocity, so nothing to estimate")
    if not any(mapped.signal is Signal.TORQUE_ACTUAL for axis in axes for mapped in axis.incoming):
        yield LeftOut("torque actual", "no element needs it")
    for axis in axes:
        bus = rig.bus[axis.rig.bus]
        is_generic = axis.profile.drive.evidence == STANDARD
        if is_generic and not bus.simulated and protocol_named(bus.protocol).fits_profiles:
            why = "is a generic profile: the run reads the drive's objects and plans with those"
            yield LeftOut("objects that the drive lacks", f"{axis.profile.title} {why}")
        if axis.profile.echo is None:
            why = "does not return its set-points (torque.echo of its profile)"
            yield LeftOut("echo of the set-points", f"{axis.profile.title} {why}; {CAPPED}")
        if why := unguarded(axis.profile, axis.rig):
            stop = "and an emergency stop must cut the power (emergency_stop of the rig)"
            yield LeftOut("guard", f"{why}; {CAPPED}, {stop}")
    for name in dict.fromkeys(name for axis in axes for name in unbounded(axis)):
        yield LeftOut("energy ledger", f"{name} can apply any force by itself, so the energy has no limit")
    if not any(axis.method for axis in axes):
        remembers = any(isinstance(element, MemoryElement) for axis in axes for element in axis.elements)
        why = "elements with a memory step it themselves" if remembers else "no element has virtual states"
        yield LeftOut("integrator", why)
        if not remembers:
            yield LeftOut("virtual states", "no element has any")


def _estimates(axis: AxisPlan) -> bool:
    """Return True when the velocity is estimated from the position, and not read from the drive."""
    return axis.estimator is not None and not axis.integrates


def _modules(axes: tuple[AxisPlan, ...], period: float) -> tuple[str, ...]:
    """Return the names of the optional modules of this package that the plan imports, sorted."""
    modules = {type(element).__module__ for axis in axes for element in (*axis.elements, *axis.couplings)}
    optional = {
        "numerics.estimators": map(_estimates, axes),
        "numerics.integrators": (axis.method for axis in axes),
        "cycle.tachometer": (axis.integrates for axis in axes),
        "cycle.standstill": (encoder_probe(axis, period) for axis in axes),
    }
    return tuple(sorted({*modules, *(f"haptic_fieldbus.{name}" for name, needed in optional.items() if any(needed))}))

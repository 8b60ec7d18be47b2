"""One axis of a plan: mapped signals, units, limits, delay, and the verdict on its sampled loop."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR, DEFAULT_METHOD
from haptic_fieldbus.drive.profile import DriveProfile, MappedSignal, PowerTable
from haptic_fieldbus.drive.rig import Rig, RigAxis, default_axis, velocity_step
from haptic_fieldbus.errors import Fault, PlanError, RigError, SceneError, SignalUnavailableError
from haptic_fieldbus.margins import Basis, Plant, Stability
from haptic_fieldbus.margins.group import Group
from haptic_fieldbus.numerals import in_unit, percent, rounded
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning.guards import cap_reason, check_guarded
from haptic_fieldbus.planning.image import STATUSWORD, canonical
from haptic_fieldbus.planning.known_bench import KnownBench, known_bench, only_simulated, with_evidence
from haptic_fieldbus.planning.limits import (
    GAP_SHARE,
    HOLDING_SHARE,
    LARGEST_MISSING_SHARE,
    EffortLimits,
    check_places,
    limits_of,
    plant_of,
    position_steps,
    rated_effort,
    torque_unit,
)
from haptic_fieldbus.protocols.protocol import FieldbusProtocol
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.protocols.traffic import AxisTraffic, Delay, OtherMasters
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, DynamicElement, Element
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Signal, Workspace

ALWAYS_OUT = (Signal.CONTROLWORD, Signal.TARGET_TORQUE)
"""Signals sent to each drive, whatever the scene."""
PROVIDERS = {
    Signal.POSITION: (Signal.POSITION, Signal.VELOCITY),
    Signal.VELOCITY: (Signal.POSITION, Signal.VELOCITY),
    Signal.TORQUE_ACTUAL: (Signal.TORQUE_ACTUAL,),
    Signal.TORQUE_DEMAND: (Signal.TORQUE_DEMAND,),
    Signal.TARGET_ASKED: (Signal.TARGET_ASKED,),
}
"""Signal → signals of the drive that can provide it, the best first.

A velocity estimated from position has known dynamics, while the filter behind the drive's own velocity is unknown. A
position integrated from velocity drifts.
"""


@dataclass(frozen=True)
class AxisPlan:
    """One axis of a plan."""

    name: str
    node: int
    workspace: Workspace
    profile: DriveProfile
    rig: RigAxis
    power: PowerTable
    traffic: AxisTraffic
    elements: tuple[Element, ...]
    couplings: tuple[CouplingElement, ...]
    """Couplings of the scene that act on this axis and another one."""
    estimator: str | None
    """Velocity estimator; `TACHOMETER` when the drive's own velocity is read, None when no velocity is needed."""
    method: str | None
    """Name of the integrator; None when no element has virtual states."""
    limits: EffortLimits
    effort_unit: float
    """One step of the drive's target torque in the workspace [N or N·m]."""
    shown_unit: float
    """One step of the drive's torque actual value in the workspace [N or N·m]; without one a step of the target."""
    demand_unit: float
    """One step of the drive's torque demand in the workspace [N or N·m]; without one a step of the target."""
    rated_effort: float
    """Effort at the motor's rated torque, or at its rated current if that is less, in the workspace [N or N·m]."""
    steps_per_revolution: float
    """Position steps of the drive in one revolution of the motor; encoder counts when it offers no position."""
    delay: Delay
    plant: Plant | None
    """Motor and mechanism in the workspace; None when inertia, damping or friction is unknown."""
    bench: KnownBench
    """Values of motor and mechanism, measured or stated, and their origin."""
    sign_known: bool
    """Whether the motor direction is known, so that no test is needed before force (`sign_probe`)."""
    stability: Stability | None = None
    """Verdict on `group`, in the units of this axis; None when a bench of the group is unknown."""
    group: Group | None = None
    """This axis and all axes coupled with it; None when a bench among them is unknown."""
    forced: bool = False
    """True: the force is capped, because the scene is rendered above its limit."""
    bus_name: str = "the bus"
    """Bus of the axis as people name it: `modbus-tcp:10.0.0.1`."""
    other_masters: OtherMasters | None = None
    """Detection of set-points of another master; None if the bus receives its messages."""

    @property
    def needs(self) -> tuple[Signal, ...]:
        """Signals that elements and couplings need, each once."""
        return tuple(dict.fromkeys(signal for each in (*self.elements, *self.couplings) for signal in each.needs))

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        """Signals received from the drive, in the order of the cycle."""
        return canonical(self.traffic.incoming)

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        """Signals sent to the drive, in the order of the cycle."""
        return canonical(self.traffic.outgoing)

    def place_of(self, signal: Signal) -> int:
        """Return the index of a mapped signal in the values that the codec of this axis decodes (`planning.image`)."""
        return STATUSWORD + [mapped.signal for mapped in self.incoming].index(signal)

    @property
    def resolution(self) -> float:
        """One step of position in the workspace [m or rad]."""
        return 2 * math.pi * self.rig.mechanism.ratio / self.steps_per_revolution

    @property
    def position_unit(self) -> float:
        """One step of position in the workspace, with the sign of the mechanism [m or rad]."""
        return self.resolution * self.rig.mechanism.sign

    @property
    def integrates(self) -> bool:
        """True when the drive offers no position, so that the position is integrated from its velocity."""
        return Signal.POSITION not in self.profile.offers()

    @property
    def cap(self) -> str:
        """Force cap in words, with value and reason; empty without a cap, or if the limit of the rig is lower."""
        reason = cap_reason(self.profile, self.rig, self.bench.unknown)
        reason = reason or ("the scene is above its limit (--force)" if self.forced else "")
        if not reason or self.limits.effort < self.limits.holding:
            return ""
        value = in_unit(self.limits.effort, self.workspace.effort_unit)
        return f"{self.workspace.effort_name} limited to {value} ({percent(HOLDING_SHARE)} of rated torque): {reason}"

    @cached_property
    def largest_stretch(self) -> float:
        """Factor by which gaps in the feedback may divide the stiffness limit; infinity without a margin above 1.

        The nominal margin varies a single stiffness. Several elements, and damped ones, are therefore judged by the age
        of their forces: gaps make all forces older, by Σ(s² − s)/Σs periods at most (`margins.linear`).
        """
        margin, group = None if self.stability is None else self.stability.nominal_margin, self.group
        if margin is not None and margin <= 1.0:
            return math.inf
        alone = group is None or len(group.couplings) + sum(len(each.elements) for each in group.members) == 1
        if group is None or (alone and Signal.VELOCITY not in self.needs):
            return math.inf if margin is None else 1.0 + GAP_SHARE * (margin - 1.0)
        ages = {each.name: 0.5 * group.period + each.delay + each.plant.torque_lag for each in group.members}
        # No gaps make a force older than this: the loop trips before.
        most = LARGEST_MISSING_SHARE * self.limits.age
        wanted = math.inf if margin is None else (margin - 1.0) * min(ages.values())
        further = group.further_age(min(wanted, most))
        return 1.0 + GAP_SHARE * (wanted if further == most else further) / ages[self.name]

    @property
    def velocity_unit(self) -> float:
        """One step of the drive's own velocity in the workspace, with the sign of the mechanism [m/s or rad/s]."""
        mechanism, unit = self.rig.mechanism, self.profile.offers()[Signal.VELOCITY].unit
        return velocity_step(unit, self.rig.encoder_counts_per_revolution) * mechanism.ratio * mechanism.sign


def draft_axis(
    scene: Scene,
    scene_axis: SceneAxis,
    rig: Rig,
    profiles: Mapping[str, DriveProfile],
    method: str | None,
    estimator: str | None,
    *,
    forced: bool = False,
) -> AxisPlan:
    """Return the plan of one axis without delay and verdict, which need the traffic of all axes: see `compile`.

    Raises PlanError when the rig lacks the axis or a value of the torque scaling, when neither watchdog nor emergency
    stop would take the torque away, or when the drive cannot render the scene (SignalUnavailableError,
    ImageTooLargeError). Raises SceneError when rig and scene differ in the workspace, RigError for a fixed zero of a
    drive without a position, UsageError for an unknown protocol.
    """
    axis = rig.axis.get(scene_axis.name)
    if axis is None:
        raise PlanError(
            f"{scene.name} needs the axis {scene_axis.name!r}; the rig {rig.source} has: {', '.join(rig.axis)}. Use "
            f"--axis {scene_axis.name}=NAME for another one"
        )
    profile = profiles[axis.profile]
    if not profile.drive.usable:  # the profile only documents why the drive cannot render force
        raise PlanError(f"{profile.title} is not usable for force: {profile.sources.get('drive.usable', profile.name)}")
    _check_workspace(scene, scene_axis, axis)
    _check_zero(scene_axis.name, rig, profile)
    check_guarded(scene_axis.name, profile, axis)
    elements = scene.of_axis(scene_axis.name)
    couplings = tuple(coupling for coupling in scene.couplings if scene_axis.name in coupling.axes)
    _check_coupled(scene_axis.name, couplings, profile)
    incoming = _incoming((*elements, *couplings), scene_axis.name, profile)
    effort_unit = torque_unit(Signal.TARGET_TORQUE, profile, axis)
    rated, steps = rated_effort(axis, profile.offers()[Signal.TARGET_TORQUE].unit), position_steps(profile, axis)
    simulated = only_simulated(rig.bus[axis.bus])
    bench = with_evidence(known_bench(rig, scene_axis.name, profile), axis, simulated=simulated)
    protocol, plant = _protocol(profile, rig, axis), plant_of(bench, axis, profile, steps)
    capped = forced or bool(cap_reason(profile, axis, bench.unknown))
    limits = limits_of(axis, rated, effort_unit, plant, scene_axis.workspace, capped=capped)
    if limits.effort < effort_unit * (1.0 - 1e-9):
        effort = scene_axis.workspace.effort_unit
        raise PlanError(
            f"axis {scene_axis.name}: one step of the torque of {profile.title} is {rounded(effort_unit)} {effort}; "
            f"expected at most the limit of the axis, {rounded(limits.effort)} {effort}, or no force is possible"
        )
    check_places(scene, scene_axis.name, rig, elements, limits)
    needs_velocity = any(Signal.VELOCITY in each.needs for each in (*elements, *couplings))
    velocity_from = (estimator or DEFAULT_ESTIMATOR) if _offers_position(profile) else TACHOMETER
    return AxisPlan(
        name=scene_axis.name,
        node=axis.node,
        workspace=scene_axis.workspace,
        profile=profile,
        rig=axis,
        power=protocol.power_table(profile),
        traffic=protocol.axis_traffic(axis, rig.bus[axis.bus], profile, incoming, ALWAYS_OUT),
        elements=elements,
        couplings=couplings,
        estimator=velocity_from if needs_velocity else None,
        method=(method or DEFAULT_METHOD) if any(isinstance(element, DynamicElement) for element in elements) else None,
        limits=limits,
        forced=forced,
        effort_unit=effort_unit,
        shown_unit=torque_unit(Signal.TORQUE_ACTUAL, profile, axis),
        demand_unit=torque_unit(Signal.TORQUE_DEMAND, profile, axis),
        rated_effort=rated,
        steps_per_revolution=steps,
        delay=Delay(0.0, 0.0, 0.0, 0.0),  # until the traffic of all axes is known
        plant=plant,
        bench=replace(bench, basis=Basis.SIMULATED) if has_shipped_values(rig, scene_axis.name) else bench,
        # On a real bench a cable may have been swapped since.
        sign_known=axis.seen.sign is not None and rig.bus[axis.bus].simulated,
        bus_name=protocol.bus_name(rig.bus[axis.bus]).text,
    )


def has_shipped_values(rig: Rig, name: str) -> bool:
    """Return whether an axis has the values of the shipped bench on a simulated bus; they are then exact."""
    axis, section = rig.axis[name], rig.bus[rig.axis[name].bus]
    shipped = default_axis(axis.mechanism.workspace, bus=axis.bus, node=axis.node, profile=axis.profile)
    return not rig.source and only_simulated(section) and _bench_values(axis) == _bench_values(shipped)


def _bench_values(axis: RigAxis) -> tuple[object, ...]:
    """Return the values of motor and mechanism from which the limit of an axis follows."""
    ratio, coupling = abs(axis.mechanism.ratio), axis.simulation.coupling
    return ratio, axis.inertia, axis.viscous_damping, axis.coulomb_friction, coupling, axis.identified


def _check_workspace(scene: Scene, scene_axis: SceneAxis, axis: RigAxis) -> None:
    wanted = scene_axis.workspace
    if axis.mechanism.workspace is not wanted:
        units = f"({wanted.effort_unit}, {wanted.length_unit})"
        message = f"the scene is {wanted.value} {units} but the rig's mechanism is {axis.mechanism.kind}"
        raise SceneError(scene.source or scene.name, [Fault(f"axis.{scene_axis.name}.workspace", message)])


def _check_zero(name: str, rig: Rig, profile: DriveProfile) -> None:
    """Refuse an encoder count as zero for a drive without a position: an integrated position has its own start."""
    zero = rig.axis[name].mechanism.zero
    if not _offers_position(profile) and zero != "start":
        why = f"{profile.title} reports velocity only, so it has no encoder count for the zero"
        fault = Fault(f"axis.{name}.mechanism.zero", f'{zero}; expected "start": {why}')
        raise RigError(rig.source or "the rig", [fault])


def _check_coupled(name: str, couplings: tuple[CouplingElement, ...], profile: DriveProfile) -> None:
    """Refuse a coupling to a position that drifts: its force would grow without a motion of the hands."""
    if couplings and not _offers_position(profile):
        raise PlanError(
            f"{couplings[0].name} couples axis {name}, but {profile.title} reports velocity only, and the integrated "
            "position drifts; a coupling needs drives that report position"
        )


def _offers_position(profile: DriveProfile) -> bool:
    return Signal.POSITION in profile.offers()


def _incoming(elements: tuple[AnyElement, ...], axis: str, profile: DriveProfile) -> tuple[Signal, ...]:
    """Return the signals to map: statusword, and providers of position, echo and each signal that elements need."""
    offered, incoming = profile.offers(), [Signal.STATUSWORD]
    # The position is always mapped, because the limits of the axis need it.
    asking = {Signal.POSITION: "the position check"}
    for element in elements:
        asking.update({signal: element.name for signal in element.needs if signal not in asking})
    if profile.echo is not None:
        asking.setdefault(profile.echo, "the check that set-points act")
    for signal in filter(asking.__contains__, PROVIDERS):  # ELAPSED_NS comes from the header, not from the drive
        provider = next((each for each in PROVIDERS[signal] if each in offered), None)
        if provider is None:
            needing = f"{asking[signal]} on axis {axis} needs {signal.value}"
            raise SignalUnavailableError(f"{needing}, but {profile.title} does not offer it, and it cannot be derived")
        incoming.append(provider)
    return tuple(dict.fromkeys(incoming))


def _protocol(profile: DriveProfile, rig: Rig, axis: RigAxis) -> FieldbusProtocol:
    """Return the protocol of the axis' bus; raises PlanError when the drive speaks another one or the bus has none."""
    section = rig.bus[axis.bus]
    if not section.protocol:
        raise PlanError(f"the bus {axis.bus} of the rig has no protocol; in Python use CanSection for a CAN bus")
    protocol = protocol_named(section.protocol)
    if profile.drive.protocol != protocol.name:
        own = protocol_named(profile.drive.protocol).simulated_bus(profile)
        raise PlanError(
            f"{profile.title} speaks {profile.drive.protocol}, but the bus {axis.bus} is {protocol.name}; simulate it "
            f"with --bus {own}"
        )
    return protocol

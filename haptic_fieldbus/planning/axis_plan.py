"""One axis of a plan: what it maps, its limits, and whether its sampled loop is stable."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR, DEFAULT_METHOD
from haptic_fieldbus.drive.power import PowerTable
from haptic_fieldbus.drive.profile import DriveProfile, MappedSignal
from haptic_fieldbus.drive.rig import Rig, RigAxis
from haptic_fieldbus.drive.units import (
    COUNTS,
    TORQUE_UNITS,
    needed_for,
    steps_per_revolution,
    torque_step,
    velocity_step,
)
from haptic_fieldbus.errors import Fault, PlanError, RigError, SceneError, SignalUnavailableError
from haptic_fieldbus.margins import Plant, Stability
from haptic_fieldbus.margins.group import Group
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.planning.image import canonical
from haptic_fieldbus.planning.limits import DRIFT_TURNS, SLEW_TIME, SPEED_LIMIT, EffortLimits
from haptic_fieldbus.protocols.protocol import FieldbusProtocol
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.protocols.traffic import AxisTraffic, Delay
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, DynamicElement, Element
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Signal, Workspace

UNKNOWN_BENCH_EFFORT = 0.05
"""Share of rated torque that is allowed on a bench whose plant is unknown."""
ALWAYS_OUT = (Signal.CONTROLWORD, Signal.TARGET_TORQUE)
PROVIDERS = {
    Signal.POSITION: (Signal.POSITION, Signal.VELOCITY),
    Signal.VELOCITY: (Signal.POSITION, Signal.VELOCITY),
    Signal.TORQUE_ACTUAL: (Signal.TORQUE_ACTUAL,),
}
"""What gives a signal that a drive may offer, the best first: a velocity estimated from position has dynamics that are
known, a drive's own has a filter that is not; a position integrated from velocity drifts."""
"""Here, not imported from `numerics`: a scene that needs neither must not import them. Tests compare."""


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
    """Those of the scene that act on this axis and another."""
    estimator: str | None
    """`TACHOMETER` where the drive's own velocity is read; None where the scene needs no velocity."""
    method: str | None
    limits: EffortLimits
    effort_unit: float
    """One step of the drive's target torque in the workspace [N or N·m]."""
    rated_effort: float
    """What the motor may give for ever, in the workspace [N or N·m]."""
    steps_per_revolution: float
    """Of the drive's position, for one of the motor; of a drive without one, encoder counts."""
    delay: Delay
    plant: Plant | None
    stability: Stability | None = None
    group: Group | None = None
    """The axes that hang together with this one, which `stability` is about; None where a bench is unknown."""

    @property
    def needs(self) -> tuple[Signal, ...]:
        """What elements and couplings ask for, each once."""
        return tuple(dict.fromkeys(signal for each in (*self.elements, *self.couplings) for signal in each.needs))

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        """What is mapped, in the order of the cycle."""
        return canonical(self.traffic.incoming)

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        """The same of what is sent."""
        return canonical(self.traffic.outgoing)

    @property
    def resolution(self) -> float:
        """One step of position in the workspace [m or rad]."""
        return 2 * math.pi * self.rig.mechanism.ratio / self.steps_per_revolution

    @property
    def position_unit(self) -> float:
        """The same with the mechanism's sign."""
        return self.resolution * self.rig.mechanism.sign

    @property
    def integrates(self) -> bool:
        """Whether the drive offers no position, so that it is integrated from its velocity."""
        return Signal.POSITION not in self.profile.offers()

    @property
    def velocity_unit(self) -> float:
        """One step of the drive's own velocity in the workspace, with the mechanism's sign [m/s or rad/s]."""
        mechanism, unit = self.rig.mechanism, self.profile.offers()[Signal.VELOCITY].unit
        return velocity_step(unit, self.rig.encoder_counts_per_revolution) * mechanism.ratio * mechanism.sign


def draft_axis(
    scene: Scene,
    scene_axis: SceneAxis,
    rig: Rig,
    profiles: Mapping[str, DriveProfile],
    method: str | None,
    estimator: str | None,
) -> AxisPlan:
    """All but delay and stability, which need the traffic of all axes: `verdicts` adds them."""
    axis = rig.axis.get(scene_axis.name)
    if axis is None:
        raise PlanError(
            f"{scene.name} needs the axis {scene_axis.name!r}; the rig {rig.source} has: {', '.join(rig.axis)}"
        )
    profile = profiles[axis.profile]
    _check_usable(profile)
    _check_workspace(scene, scene_axis, axis)
    _check_zero(scene_axis.name, rig, profile)
    elements = scene.of_axis(scene_axis.name)
    couplings = tuple(coupling for coupling in scene.couplings if scene_axis.name in coupling.axes)
    _check_coupled(scene_axis.name, couplings, profile)
    incoming = _incoming((*elements, *couplings), scene_axis.name, profile)
    effort_unit, rated, steps = _effort_unit(profile, axis), _rated_effort(axis), _steps(profile, axis)
    protocol, plant = _protocol(profile, rig, axis), _plant(axis, profile, steps)
    return AxisPlan(
        name=scene_axis.name,
        node=axis.node,
        workspace=scene_axis.workspace,
        profile=profile,
        rig=axis,
        power=protocol.power_table(profile),
        traffic=protocol.axis_traffic(axis, profile, incoming, ALWAYS_OUT),
        elements=elements,
        couplings=couplings,
        estimator=_estimator(estimator, profile) if _needed((*elements, *couplings), Signal.VELOCITY) else None,
        method=(method or DEFAULT_METHOD) if any(isinstance(element, DynamicElement) for element in elements) else None,
        limits=_limits(axis, rated if plant else UNKNOWN_BENCH_EFFORT * rated, scene_axis.workspace),
        effort_unit=effort_unit,
        rated_effort=rated,
        steps_per_revolution=steps,
        delay=Delay(0.0, 0.0, 0.0, 0.0),
        plant=plant,
    )


def _check_usable(profile: DriveProfile) -> None:
    if not profile.drive.usable:
        raise PlanError(f"{profile.title} is not usable for force: {profile.sources.get('drive.usable', profile.name)}")


def _check_workspace(scene: Scene, scene_axis: SceneAxis, axis: RigAxis) -> None:
    if axis.mechanism.workspace is not scene_axis.workspace:
        message = (
            f"the scene is {scene_axis.workspace.value} ({scene_axis.workspace.effort_unit}, "
            f"{scene_axis.workspace.length_unit}) but the rig's mechanism is {axis.mechanism.kind}"
        )
        raise SceneError(scene.source or scene.name, [Fault(f"axis.{scene_axis.name}.workspace", message)])


def _check_zero(name: str, rig: Rig, profile: DriveProfile) -> None:
    """An integrated position counts from where it began."""
    zero = rig.axis[name].mechanism.zero
    if not _offers_position(profile) and zero != "start":
        message = f'{zero}; expected "start": {profile.title} offers velocity only, and no encoder count to begin at'
        raise RigError(rig.source or "the rig", [Fault(f"axis.{name}.mechanism.zero", message)])


def _check_coupled(name: str, couplings: tuple[CouplingElement, ...], profile: DriveProfile) -> None:
    """What drifts against another axis pulls at it, and neither hand could tell from what."""
    if couplings and not _offers_position(profile):
        raise PlanError(
            f"{couplings[0].name} ties axis {name} to another one, but {profile.title} offers velocity only, and a "
            "position that is integrated from it drifts; a coupling needs drives that offer their position"
        )


def _estimator(name: str | None, profile: DriveProfile) -> str:
    return (name or DEFAULT_ESTIMATOR) if _offers_position(profile) else TACHOMETER


def _offers_position(profile: DriveProfile) -> bool:
    return Signal.POSITION in profile.offers()


def _needed(elements: tuple[AnyElement, ...], signal: Signal) -> bool:
    return any(signal in element.needs for element in elements)


def _incoming(elements: tuple[AnyElement, ...], axis: str, profile: DriveProfile) -> tuple[Signal, ...]:
    """What must be mapped: statusword, and what provides the position that safety needs and what elements ask for."""
    offered, incoming = profile.offers(), [Signal.STATUSWORD]
    asking = {Signal.POSITION: "the position check"}
    for element in elements:
        asking.update({signal: element.name for signal in element.needs if signal not in asking})
    for signal in filter(asking.__contains__, PROVIDERS):
        provider = next((each for each in PROVIDERS[signal] if each in offered), None)
        if provider is None:
            needing = f"{asking[signal]} on axis {axis} needs {signal.value}"
            raise SignalUnavailableError(f"{needing}, which {profile.title} neither offers nor derives")
        incoming.append(provider)
    return tuple(dict.fromkeys(incoming))


def _protocol(profile: DriveProfile, rig: Rig, axis: RigAxis) -> FieldbusProtocol:
    """Of the axis' bus, which its drive must speak."""
    section = rig.bus[axis.bus]
    if not section.protocol:
        raise PlanError(f"the bus {axis.bus} of the rig is of no protocol; in Python a CAN bus is a CanSection")
    protocol = protocol_named(section.protocol)
    if profile.drive.protocol != protocol.name:
        raise PlanError(
            f"{profile.title} speaks {profile.drive.protocol}, but the bus {axis.bus} is one of {protocol.name}"
        )
    return protocol


def _effort_unit(profile: DriveProfile, axis: RigAxis) -> float:
    """One step of target torque in the workspace; the unit of the profile with what the rig says of the motor."""
    unit = profile.offers()[Signal.TARGET_TORQUE].unit
    if unit not in TORQUE_UNITS:
        raise PlanError(f"{profile.title}: torque unit {unit!r} is not supported")
    step = torque_step(unit, axis)
    if step is None:
        raise PlanError(
            f"the rig's {needed_for(unit)} of node {axis.node} is unknown: torque cannot be scaled without it"
        )
    return step / axis.mechanism.ratio


def _rated_effort(axis: RigAxis) -> float:
    if axis.rated_torque is None:
        raise PlanError(f"the rig's rated_torque of node {axis.node} is unknown: torque cannot be limited without it")
    return 1000.0 * (axis.rated_torque / 1000.0 / axis.mechanism.ratio)  # as the steps of most drives count it


def _steps(profile: DriveProfile, axis: RigAxis) -> float:
    offered = profile.offers().get(Signal.POSITION)
    return steps_per_revolution(offered.unit if offered else COUNTS, axis.encoder_counts_per_revolution)


def _limits(axis: RigAxis, most: float, workspace: Workspace) -> EffortLimits:
    """Effort is bounded by the rig's limit, and by what the motor may give."""
    effort = min(axis.limits.effort or math.inf, most)
    return EffortLimits(
        effort=effort,
        speed=axis.limits.speed or SPEED_LIMIT[workspace.value],
        slew=effort / SLEW_TIME,
        position=axis.limits.position,
        drift=axis.limits.drift or 2 * math.pi * DRIFT_TURNS * axis.mechanism.ratio,
    )


def _plant(axis: RigAxis, profile: DriveProfile, steps: float) -> Plant | None:
    """The bench in the workspace; None when inertia or damping is unknown."""
    if axis.inertia is None or axis.viscous_damping is None:
        return None
    ratio = axis.mechanism.ratio
    return Plant(
        mass=axis.inertia / ratio**2,
        damping=axis.viscous_damping / ratio**2,
        coulomb=axis.coulomb_friction / ratio,
        resolution=2 * math.pi * ratio / steps,
        torque_lag=1.0 / (2 * math.pi * profile.timing.torque_bandwidth),
    )

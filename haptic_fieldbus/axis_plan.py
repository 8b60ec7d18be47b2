"""One axis of a plan: what it maps, its limits, and whether its sampled loop is stable."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from haptic_fieldbus.drive.budget import Delay, Exchange, delay_of
from haptic_fieldbus.drive.pdo import SYNCHRONOUS_TYPES, Direction, Pdo, lay_out
from haptic_fieldbus.drive.profile import DriveProfile, velocity_step
from haptic_fieldbus.drive.rig import Rig, RigAxis
from haptic_fieldbus.errors import Fault, PlanError, RigError, SceneError, SignalUnavailableError
from haptic_fieldbus.margins import Plant, Stability, contact, judge_contact
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import TACHOMETER
from haptic_fieldbus.safety import DRIFT_TURNS, SLEW_TIME, SPEED_LIMIT, EffortLimits
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
DEFAULT_ESTIMATOR = "backward-difference"
DEFAULT_METHOD = "exact-foh"
"""Here, not imported from `numerics`: a scene that needs neither must not import them. Tests compare."""


@dataclass(frozen=True)
class AxisPlan:
    """One axis of a plan; `effort_unit` is one step of the drive's target torque in the workspace [N or N·m]."""

    name: str
    node: int
    workspace: Workspace
    profile: DriveProfile
    rig: RigAxis
    tpdos: tuple[Pdo, ...]
    rpdos: tuple[Pdo, ...]
    elements: tuple[Element, ...]
    couplings: tuple[CouplingElement, ...]
    """Those of the scene that act on this axis and another."""
    estimator: str | None
    """`TACHOMETER` where the drive's own velocity is read; None where the scene needs no velocity."""
    method: str | None
    limits: EffortLimits
    effort_unit: float
    delay: Delay
    plant: Plant | None
    stability: Stability | None
    judged_with: CouplingElement | None = None
    """The coupling whose stiffness `stability` is about, of all axes that hang together; None: it is the axis' own."""

    @property
    def needs(self) -> tuple[Signal, ...]:
        """What elements and couplings ask for, each once."""
        return tuple(dict.fromkeys(signal for each in (*self.elements, *self.couplings) for signal in each.needs))

    @property
    def position_unit(self) -> float:
        """One encoder count in the workspace, with the mechanism's sign [m or rad]."""
        return self.rig.resolution * self.rig.mechanism.sign

    @property
    def integrates(self) -> bool:
        """Whether the drive offers no position, so that it is integrated from its velocity."""
        return self.profile.position is None

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
    """All but delay and stability, which need the traffic of all axes: `judged` adds them."""
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
    effort_unit = _effort_unit(profile, axis)
    return AxisPlan(
        name=scene_axis.name,
        node=axis.node,
        workspace=scene_axis.workspace,
        profile=profile,
        rig=axis,
        tpdos=_pdos(Direction.TPDO, profile, axis.node, incoming),
        rpdos=_pdos(Direction.RPDO, profile, axis.node, ALWAYS_OUT),
        elements=elements,
        couplings=couplings,
        estimator=_estimator(estimator, profile) if _needed((*elements, *couplings), Signal.VELOCITY) else None,
        method=(method or DEFAULT_METHOD) if any(isinstance(element, DynamicElement) for element in elements) else None,
        limits=_limits(axis, profile, scene_axis.workspace, effort_unit),
        effort_unit=effort_unit,
        delay=Delay(0.0, 0.0, 0.0, 0.0),
        plant=_plant(axis, profile),
        stability=None,
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
    if profile.position is None and zero != "start":
        message = f'{zero}; expected "start": {profile.title} offers velocity only, and no encoder count to begin at'
        raise RigError(rig.source or "the rig", [Fault(f"axis.{name}.mechanism.zero", message)])


def _check_coupled(name: str, couplings: tuple[CouplingElement, ...], profile: DriveProfile) -> None:
    """What drifts against another axis pulls at it, and neither hand could tell from what."""
    if couplings and profile.position is None:
        raise PlanError(
            f"{couplings[0].name} ties axis {name} to another one, but {profile.title} offers velocity only, and a "
            "position that is integrated from it drifts; a coupling needs drives that offer their position"
        )


def _estimator(asked: str | None, profile: DriveProfile) -> str:
    return TACHOMETER if profile.position is None else asked or DEFAULT_ESTIMATOR


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


def _pdos(direction: Direction, profile: DriveProfile, node: int, signals: tuple[Signal, ...]) -> tuple[Pdo, ...]:
    section = profile.pdo
    if direction is Direction.TPDO:
        kind, available = _fastest_tpdo_type(section.tpdo_types), section.tpdos
    else:
        kind, available = _fastest_rpdo_type(section.rpdo_types), section.rpdos
    offered = profile.offers()
    return lay_out(
        direction, offered, signals, node=node, transmission_type=kind, pdos=available, entries=section.entries
    )


def _fastest_tpdo_type(types: tuple[int, ...]) -> int:
    """Type 1 answers every SYNC: one latch instant for all axes, and the lowest delay."""
    if 1 not in types:
        raise PlanError(f"no TPDO transmission type of {types} answers every SYNC; 1 is needed")
    return 1


def _fastest_rpdo_type(types: tuple[int, ...]) -> int:
    """Event-driven acts on reception; a synchronous one waits for the next SYNC."""
    event_driven = [kind for kind in types if kind not in SYNCHRONOUS_TYPES]
    return max(event_driven) if event_driven else min(types)


def _effort_unit(profile: DriveProfile, axis: RigAxis) -> float:
    """One step of target torque in the workspace; the unit of the profile times the rig's rated torque."""
    if profile.torque.target.unit != "permille_of_rated_torque":
        raise PlanError(f"{profile.title}: torque unit {profile.torque.target.unit!r} is not supported")
    if axis.rated_torque is None:
        raise PlanError(f"the rig's rated_torque of node {axis.node} is unknown: torque cannot be scaled without it")
    return axis.rated_torque / 1000.0 / axis.mechanism.ratio


def _limits(axis: RigAxis, profile: DriveProfile, workspace: Workspace, effort_unit: float) -> EffortLimits:
    """Effort is bounded by the rig's limit and rated torque; on an unknown bench by a small share of it."""
    share = 1.0 if _plant(axis, profile) is not None else UNKNOWN_BENCH_EFFORT
    effort = min(axis.limits.effort or float("inf"), 1000.0 * effort_unit * share)
    return EffortLimits(
        effort=effort,
        speed=axis.limits.speed or SPEED_LIMIT[workspace.value],
        slew=effort / SLEW_TIME,
        position=axis.limits.position,
        drift=axis.limits.drift or 2 * math.pi * DRIFT_TURNS * axis.mechanism.ratio,
    )


def _plant(axis: RigAxis, profile: DriveProfile) -> Plant | None:
    """The bench in the workspace; None when inertia or damping is unknown."""
    if axis.inertia is None or axis.viscous_damping is None:
        return None
    ratio = axis.mechanism.ratio
    return Plant(
        mass=axis.inertia / ratio**2,
        damping=axis.viscous_damping / ratio**2,
        coulomb=axis.coulomb_friction / ratio,
        resolution=axis.resolution,
        torque_lag=1.0 / (2 * math.pi * profile.timing.torque_bandwidth),
    )


def judged(draft: AxisPlan, exchange: Exchange, period: float) -> AxisPlan:
    """The axis with its delay, and with the verdict on its sampled loop where the bench is known."""
    delayed = replace(draft, delay=delay_of(exchange, draft.profile, period), plant=_seen(draft, period))
    return replace(delayed, stability=stability_alone(delayed, period))


def _seen(axis: AxisPlan, period: float) -> Plant | None:
    """The bench as the loop sees it: at rest a position that is integrated is a multiple of a velocity step's way."""
    if axis.plant is None or not axis.integrates:
        return axis.plant
    return replace(axis.plant, resolution=abs(axis.velocity_unit) * period, tachometer=True)


def stability_alone(axis: AxisPlan, period: float) -> Stability | None:
    """The verdict on the axis alone; its limit is that of the stiffest element, all else kept."""
    if axis.plant is None:
        return None
    return judge_contact(axis.plant, period, axis.delay.transport, axis.elements, axis.method, judging_estimator(axis))


def judging_estimator(axis: AxisPlan) -> str:
    """The estimator that stability is judged with; where the axis has none, the one that it would have."""
    return axis.estimator or _estimator(None, axis.profile)


def environment_of(axis: AxisPlan, period: float, **changes: float) -> StateSpace:
    """The linearised elements of the axis as the loop runs them, x_k → F_k, the stiffest one changed."""
    return contact.environment_of(axis.elements, period, axis.method, judging_estimator(axis), **changes)


def stiffest_of(axis: AxisPlan) -> Element | None:
    """The element whose stiffness is the axis' largest; None when none has any."""
    return contact.stiffest_of(axis.elements)

"""The limits of an axis: what the plan grants, before any guard of the running cycle."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from haptic_fieldbus.defaults import DEFAULT_FADE_IN
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import (
    ABSOLUTE_TORQUE_UNITS,
    COUNTS,
    TORQUE_UNITS,
    Rig,
    RigAxis,
    is_current,
    metres_per_revolution,
    needed_for,
    steps_per_revolution,
    torque_step,
)
from haptic_fieldbus.errors import Fault, PlanError, SceneError
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.traffic import answer_time
from haptic_fieldbus.scenes.element import Element, is_varying
from haptic_fieldbus.scenes.registry import place_names
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal, Workspace

if TYPE_CHECKING:
    from haptic_fieldbus.margins.bodies import HungBody


# Scales of one axis: steps of torque and position, and motor and mechanism in the workspace of the handle.


def torque_unit(signal: Signal, profile: DriveProfile, axis: RigAxis) -> float:
    """Return one step of a torque in the workspace [N or N·m], that of the target when the drive does not offer it.

    Raises PlanError when the rig lacks its scale.
    """
    offered = profile.offers()
    return effort_step(offered.get(signal, offered[Signal.TARGET_TORQUE]).unit, profile, axis)


def effort_step(unit: str, profile: DriveProfile, axis: RigAxis) -> float:
    """Return one step of a torque in this unit, in the workspace [N or N·m]; raises PlanError as `torque_unit`."""
    if unit not in TORQUE_UNITS + ABSOLUTE_TORQUE_UNITS:
        raise PlanError(f"{profile.title}: torque unit {unit!r} is not supported")
    step = torque_step(unit, axis, profile.full_scale)
    if step is None:
        raise PlanError(
            f"node {axis.node}: {needed_for(unit, axis)} is missing in the rig; it is needed to scale the torque"
        )
    return step / axis.mechanism.ratio


def rated_effort(axis: RigAxis, unit: str = "") -> float:
    """Return the effort at the motor's rated torque, in the workspace [N or N·m].

    Where the drive takes a current (`unit` of its target) it is no more than that of the rated current, if the rig
    states it: the shares that are permitted are then shares of the current, whatever the torque constant is.

    Raises PlanError when the rated torque is unknown, or when friction leaves nothing of it.
    """
    rated = axis.rated_torque
    if rated is None:
        raise PlanError(f"node {axis.node}: rated_torque is missing in the rig; it is needed to limit the torque")
    if axis.coulomb_friction >= rated:
        raise PlanError(
            f"node {axis.node}: coulomb_friction ({exactly(axis.coulomb_friction)} N·m) must be below rated_torque ("
            f"{exactly(rated)} N·m), or the motor cannot move the handle. Is one of them in mN·m?"
        )
    if is_current(unit) and axis.rated_current is not None and axis.torque_constant is not None:
        rated = min(rated, axis.rated_current * axis.torque_constant)
    return 1000.0 * (rated / 1000.0 / axis.mechanism.ratio)  # exactly 1000 steps of 1 ‰


def position_steps(profile: DriveProfile, axis: RigAxis) -> float:
    """Return the position steps in one revolution of the motor; encoder counts when the drive offers no position.

    Raises PlanError for a motor that goes straight and turns in the rig.
    """
    offered = profile.offers().get(Signal.POSITION)
    unit = offered.unit if offered else COUNTS
    steps = steps_per_revolution(unit, axis.encoder_counts_per_revolution, metres_per_revolution(axis))
    if not steps:
        raise PlanError(f"{profile.title} reports its position in {unit}; the rig needs a linear mechanism")
    return steps


def load_of(axis: RigAxis, plant: Plant | None) -> "HungBody | None":
    """Return the load behind a compliant coupling, in the workspace; None for a rigid shaft or an unknown bench."""
    coupling = axis.simulation.coupling
    if coupling is None or plant is None:
        return None
    from haptic_fieldbus.margins.bodies import HungBody  # a rigid axis does without it

    square = axis.mechanism.ratio**2
    return HungBody(coupling.load_inertia / square, coupling.stiffness / square, coupling.damping / square)


def plant_of(axis: RigAxis, profile: DriveProfile, steps: float) -> Plant | None:
    """Return motor and mechanism in the workspace; None when inertia or damping is unknown."""
    if axis.inertia is None or axis.viscous_damping is None:
        return None
    # With x = ratio·θ and F = τ/ratio: J·θ̈ = τ becomes (J/ratio²)·ẍ = F.
    ratio = axis.mechanism.ratio
    return Plant(
        mass=axis.inertia / ratio**2,
        damping=axis.viscous_damping / ratio**2,
        coulomb=axis.coulomb_friction / ratio,
        resolution=2 * math.pi * ratio / steps,
        torque_lag=profile.torque_lag,
    )


SHORTEST_FADE_IN, LONGEST_FADE_IN = 0.1, 60.0
"""[s]; what may be asked for: a force that is there sooner is a kick."""
SLEW_TIME = 0.005
"""Shortest time in which the command goes from 0 to the effort limit [s]."""
SPEED_LIMIT = {"linear": 2.0, "rotary": 60.0}
"""[m/s or rad/s]; where a rig states none."""
FIRST_SHARE = 0.2
"""Share of rated torque that is recommended as a limit to a rig that states none, for the first runs."""
FIRST_SPEED = {"linear": 1.0, "rotary": 30.0}
"""[m/s or rad/s]; recommended likewise, half of what holds where a rig states none."""
HAND = {"linear": 500.0, "rotary": 25.0}
"""The largest force [N] or torque [N·m] that a hand is taken to exert, in a blow: from it follows which jump of the
encoder no motion can make. Chosen here, well above a push (some 200 N) and below a hammer."""
DRIFT_TURNS = 0.1
"""Revolutions of the motor that an integrated position may be uncertain by, where a rig states no limit: 12 s of
readings in whole revolutions a minute, each wrong by half of one."""
STALL_TIME = 90.0
"""[s]; so long counts may stand still under torque before the limit falls."""
HOLDING_SHARE = 0.05
"""Share of rated torque that a hand may be left alone with: after a stall, and without a guard that was proved."""
PULSE_SHARE = 0.15
"""Share of rated torque that is given at most before the sign is seen; more needs the permission of a person."""
PULSE_EFFORT = {"linear": 5.0, "rotary": 0.25}
"""[N or N·m] at the handle that is given at most before the sign is seen, as the rig describes the handle: what a
finger holds back. More needs the permission of a person."""
START_SHARE = 0.25
"""Share of the effort limit that a scene may ask for in its first period."""
ECHO_TIME, ECHO_PERIODS = 0.035, 3
"""[s] and periods, the longer of them: so long the drive may show another torque than it was sent."""
ECHO_STEPS = 1
"""Steps of target torque by which a torque demand may differ from what was sent."""
ECHO_SHARE = 0.03
"""Share of rated torque by which a torque actual value may differ from what was sent, for noise and ripple of the
current. Below `HOLDING_SHARE`: a torque that stands still unnoticed is one that a hand may be left alone with."""
FOREIGN_TIMES, FOREIGN_WITHIN = 3, 10.0
"""So many set-points of another master that are seen within this time [s] are a trip."""
FOREIGN_SHARE = HOLDING_SHARE
"""Share of rated torque by which a drive may show more torque than it was sent: what a hand may be left alone with."""
OVERSHOOT = 0.25
"""Share of a change of torque by which torque actual may overshoot it."""
FELT_SHARE = 0.08
"""Smallest change of a force that a hand can tell, as a share of the force.

Pang, Tan and Durlach measured 7 % from 2.5 to 10 N: Manual discrimination of force using active finger motion,
Perception & Psychophysics 49 (1991).
"""
ENERGY_LIMIT = 0.005
"""[J] that the loop may give beyond everything that is granted: at a handle of 0.6 kg 0.13 m/s."""
LARGEST_MISSING_SHARE = 0.2
"""Share of the samples of a second that may be missing, whatever the stability margin."""
GAP_SHARE = 0.9
"""Share of the stability margin above 1 that gaps in the feedback may use up at their worst timing; the rest damps."""
AGE_SHARE = 0.6
"""Share of the drive's own guard at which feedback is too old."""
SOON_SHARE = 0.5
"""Of that age, within which feedback comes back soon: the law of the scene goes on from where it was."""
LARGEST_SHIFT = {"linear": 0.02, "rotary": 0.5}
"""[m or rad] by which a scene may stand beside its place after gaps: the way of a fast hand, 1.3 m/s or 33 rad/s, in
the longest gap after which feedback comes back soon at 1 kHz. Chosen here."""
HELD_POWER = 0.002
"""Power [W] that the torque held in gaps may give to a hand on average, which it does not feel."""
HELD_ENERGY = 0.05
"""[J] that it may give beyond that power, in a single gap or in many: as much as a handle of 0.6 kg has at 0.4 m/s."""
HOLD_FADE = 0.01
"""Time in which the held torque fades to zero, from the second missing period on [s]; longer than the slew time."""


def fade_periods(period: float) -> int:
    """Return in how many periods held torque fades to zero, at least 1."""
    return max(1, round(HOLD_FADE / period))


def soon_periods(period: float, age: float) -> int:
    """Return for how many periods feedback that ends a run at an `age` [s] may be missing and still come back soon."""
    return math.floor(SOON_SHARE * age / period + 1e-9)


def doubt_time(period: float) -> float:
    """Return how long the drive may show another torque than it was sent, from the first sign of it on [s]."""
    return max(ECHO_TIME, ECHO_PERIODS * period)


def recent_time(period: float, age: float, lag: float) -> float:
    """Return for how long a target torque may be what a drive shows [s].

    That is the deadline of a doubt, the age at which feedback is a trip, and three times the lag of what shows it.
    """
    return doubt_time(period) + age + 3.0 * lag


def foreign_gap(period: float, every: int) -> float:
    """Return the time within which set-points of another master that are seen count as one [s].

    Three of them one after another take no longer than set-points may be without effect; a burst of noise is one.
    """
    return max(ECHO_TIME / ECHO_PERIODS, every * period)


def echo_time(echo: Signal | None, period: float) -> float:
    """Return the longest time until set-points without effect are noticed [s]; infinity without an echo.

    An echo that is asked for shows it by the second answer at the latest, and confirms it by another one in time.
    """
    if echo is None:
        return math.inf
    return doubt_time(period) + (2.0 * answer_time(period) if echo is Signal.TARGET_ASKED else 0.0)


@dataclass(frozen=True)
class EffortLimits:
    """Limits of one axis in its workspace."""

    effort: float
    """[N or N·m]"""
    speed: float
    """[m/s or rad/s]"""
    slew: float
    """Largest change of the effort [N/s or N·m/s]."""
    position: tuple[float, float] | None = None
    """Lower and upper limit [m or rad]; None: not limited."""
    fade_in: float = DEFAULT_FADE_IN
    """Time from operation enabled to full force [s]."""
    drift: float = math.inf
    """How far a position that is integrated from velocity may be uncertain."""
    acceleration: float = math.inf
    """[m/s² or rad/s²]; beyond it is no motion of motor, hand and inertia."""
    power: float = math.inf
    """[W] that the motor may give to the hand."""
    stall: float = math.inf
    """[s] for which counts may stand still under torque."""
    holding: float = math.inf
    """Effort that is permitted after a stall."""
    unseen: float = math.inf
    """Largest effort of all, that of pulses, before the sign is seen."""
    age: float = math.inf
    """[s]; oldest feedback with which force is rendered."""
    echo: float = math.inf
    """[s] for which the drive may show another torque than it was sent; infinity where it shows none."""
    shift: float = math.inf
    """How far the scene may stand beside its place after gaps in the feedback [m or rad]."""
    energy: float = math.inf
    """[J] that this axis and those that couplings tie to it may give of their own together; infinity: not judged."""
    forgiven: float = math.inf
    """[J] that these axes may give within a second because another force than that of the law is sent."""

    @property
    def before_sign(self) -> float:
        """Effort that the scene is permitted before the sign is seen [N or N·m]."""
        return min(self.effort, self.holding, self.unseen)

    def jump(self, period: float, resolution: float) -> float:
        """Return the largest second difference of the position [m or rad] that motion and encoder can make.

        Each of its three readings is up to half a count off, the middle one counts twice.
        """
        return self.acceleration * period**2 + 2.0 * resolution


def limits_of(
    axis: RigAxis, rated: float, step: float, plant: Plant | None, workspace: Workspace, *, capped: bool
) -> EffortLimits:
    """Return the limits of an axis: those of the rig, else those that follow from motor, hand and inertia.

    `rated` is the rated effort in the workspace [N or N·m], `step` one step of the drive's target torque. `plant` is
    None when inertia or damping is unknown. A `capped` effort is what a hand may be left alone with
    (`guards.cap_reason`).
    """
    limits = axis.limits
    effort = min(limits.effort or math.inf, HOLDING_SHARE * rated if capped else rated)
    unseen = min(effort, *permitted_unseen(axis, rated, workspace))
    possible = (effort + HAND[workspace.value]) / plant.mass if plant and plant.mass else math.inf
    return EffortLimits(
        effort=effort,
        speed=limits.speed or SPEED_LIMIT[workspace.value],
        slew=effort / SLEW_TIME,
        position=limits.position,
        drift=limits.drift or 2 * math.pi * DRIFT_TURNS * axis.mechanism.ratio,
        acceleration=limits.acceleration or possible,
        power=limits.power or math.inf,
        stall=limits.stall or STALL_TIME,
        holding=HOLDING_SHARE * rated,
        shift=LARGEST_SHIFT[workspace.value],
        unseen=math.floor(unseen / step + 1e-9) * step,
    )


def permitted_unseen(axis: RigAxis, rated: float, workspace: Workspace) -> tuple[float, float]:
    """Return both bounds on the effort before the sign is seen: a share of the rated effort, and one at the handle."""
    given = axis.permissions
    share = PULSE_SHARE if given.sign_pulse is None else given.sign_pulse
    return share * rated, PULSE_EFFORT[workspace.value] if given.sign_effort is None else given.sign_effort


def check_places(scene: Scene, name: str, rig: Rig, elements: tuple[Element, ...], limits: EffortLimits) -> None:
    """Refuse places that the handle cannot reach: such a wall would never be felt, or always with all of the force."""
    if limits.position is None:
        return
    low, high = limits.position
    wrong = [
        (f"{element.name}.{parameter}", place)
        for element in elements
        for parameter in place_names(type(element))
        if isinstance(place := getattr(element, parameter), float | int)
        and not low <= place <= high
        and not _felt(element, low if place < low else high, limits.effort)
    ]
    if wrong:
        unit = rig.axis[name].mechanism.workspace.length_unit
        bench = f"(limits.position in {rig.source})" if rig.source else "on this bench"
        told = f"expected {exactly(low)} to {exactly(high)} {unit}, the range of the axis {name} {bench}"
        faults = [Fault(key, f"{exactly(place)} {unit}; {told}{_in_thousandths(place, unit)}") for key, place in wrong]
        raise SceneError(scene.source or scene.name, faults)


def _felt(element: Element, end: float, effort: float) -> bool:
    """Return whether an element acts at an end of the range with less than the limit, as a preloaded spring does."""
    if not is_varying(element):
        return False
    there = element.local(end, end)
    return max(map(abs, there.force)) < effort and any((*there.force, *there.stiffness))


def _in_thousandths(place: float, unit: str) -> str:
    """Return how a place in mm or mrad is written, where a place in m or rad would be far; else nothing."""
    return f'; {exactly(place)} m{unit} is written "{exactly(place)} m{unit}"' if abs(place) >= 1.0 else ""

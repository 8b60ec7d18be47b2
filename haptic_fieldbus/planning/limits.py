"""The limits of an axis, as the plan sets them for the running cycle."""

import math
from dataclasses import dataclass, replace
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
from haptic_fieldbus.planning.known_bench import KnownBench
from haptic_fieldbus.protocols.traffic import answer_time
from haptic_fieldbus.scenes.element import Element, is_varying
from haptic_fieldbus.scenes.registry import place_names
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal, Workspace

if TYPE_CHECKING:
    from haptic_fieldbus.margins.bodies import HungBody


# Scales of one axis: steps of torque and position, and motor and mechanism in the workspace of the handle.


def torque_unit(signal: Signal, profile: DriveProfile, axis: RigAxis) -> float:
    """Return one step of a torque in the workspace [N or N·m]; one step of the target if the drive does not offer it.

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
        missing = f"{needed_for(unit, axis)} is missing in the rig"
        raise PlanError(f"node {axis.node}: {missing}; it is needed to scale the torque")
    return step / axis.mechanism.ratio


def rated_effort(axis: RigAxis, unit: str = "") -> float:
    """Return the effort at the motor's rated torque, in the workspace [N or N·m].

    If the target of the drive is a current (`unit`), and the rig states the rated current, the effort is at most that
    of the rated current. Permitted shares are then shares of the current, whatever the torque constant is.

    Raises PlanError when the rated torque is unknown, or not above friction.
    """
    rated = axis.rated_torque
    if rated is None:
        raise PlanError(f"node {axis.node}: rated_torque is missing in the rig; it is needed to limit the torque")
    if axis.coulomb_friction is not None and axis.coulomb_friction >= rated:
        raise PlanError(
            f"node {axis.node}: coulomb_friction ({exactly(axis.coulomb_friction)} N·m) must be below rated_torque ("
            f"{exactly(rated)} N·m), or the motor cannot move the handle. Is one of them in mN·m?"
        )
    if is_current(unit) and axis.rated_current is not None and axis.torque_constant is not None:
        rated = min(rated, axis.rated_current * axis.torque_constant)
    return 1000.0 * (rated / 1000.0 / axis.mechanism.ratio)  # exactly 1000 steps of 1 ‰


def position_steps(profile: DriveProfile, axis: RigAxis) -> float:
    """Return the position steps in one revolution of the motor; encoder counts when the drive offers no position.

    Raises PlanError when the drive reports its position as a length, but the mechanism of the rig is not linear.
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
    from haptic_fieldbus.margins.bodies import HungBody  # not needed for a rigid axis

    square = axis.mechanism.ratio**2
    return HungBody(coupling.load_inertia / square, coupling.stiffness / square, coupling.damping / square)


def plant_of(bench: KnownBench, axis: RigAxis, profile: DriveProfile, steps: float) -> Plant | None:
    """Return motor and mechanism in the workspace; None when inertia, damping or friction is unknown."""
    if bench.inertia is None or bench.viscous_damping is None or bench.coulomb_friction is None:
        return None
    # With x = ratio·θ and F = τ/ratio: J·θ̈ = τ becomes (J/ratio²)·ẍ = F.
    ratio = axis.mechanism.ratio
    return Plant(
        mass=bench.inertia / ratio**2,
        damping=bench.viscous_damping / ratio**2,
        coulomb=bench.coulomb_friction / ratio,
        resolution=2 * math.pi * ratio / steps,
        torque_lag=profile.torque_lag,
    )


SHORTEST_FADE_IN, LONGEST_FADE_IN = 0.1, 60.0
"""Range of the fade-in time [s]: a force that rises faster is a kick."""
SLEW_TIME = 0.005
"""Shortest time in which the command goes from 0 to the effort limit [s]."""
SPEED_LIMIT = {"linear": 2.0, "rotary": 60.0}
"""Speed limit of a rig without one [m/s or rad/s]."""
FIRST_SHARE = 0.2
"""Limit for the first runs that is recommended for a rig without one, as a share of rated torque."""
FIRST_SPEED = {"linear": 1.0, "rotary": 30.0}
"""Speed limit that is recommended for the first runs [m/s or rad/s], half of `SPEED_LIMIT`."""
HAND = {"linear": 500.0, "rotary": 25.0}
"""The largest force [N] or torque [N·m] of a hand, in a blow. A faster change of the position than this force can cause
is a jump of the encoder. Chosen here, well above a push (some 200 N) and below a hammer."""
DRIFT_TURNS = 0.1
"""Drift limit of a rig without one, in revolutions of the motor: 12 s of readings that are wrong by ½ r/min each."""
STALL_TIME = 90.0
"""Time for which counts may stand still under torque before the limit falls [s]."""
HOLDING_SHARE = 0.05
"""Holding torque, always safe for a hand, as a share of rated torque: after a stall, or without a proved guard."""
BEYOND_SHARE = 0.2
"""Largest torque of `certify` above the limit, by its own pulses and with nobody at the handle, as a share of rated
torque."""
PULSE_SHARE = 0.15
"""Largest torque before the motor direction is confirmed, as a share of rated torque; more needs a permission."""
PULSE_EFFORT = {"linear": 5.0, "rotary": 0.25}
"""Largest effort at the handle before the motor direction is confirmed [N or N·m], by the mechanism of the rig: a
finger can hold it back. More needs the permission of a person."""
START_SHARE = 0.25
"""Largest force of a scene in its first period, as a share of the effort limit."""
ECHO_TIME, ECHO_PERIODS = 0.035, 3
"""Longest time for which the drive may show another torque than the one sent: [s] and periods, the longer of both."""
ECHO_STEPS = 1
"""Largest difference between a torque demand and the torque sent, in steps of target torque."""
ECHO_SHARE = 0.03
"""Largest difference between a torque actual value and the torque sent, as a share of rated torque, for noise and
ripple of the current. It is below `HOLDING_SHARE`, so that a frozen torque that is not detected is safe for a hand."""
FOREIGN_TIMES, FOREIGN_WITHIN = 3, 10.0
"""Number of set-points of another master within a time [s] that is a trip."""
FOREIGN_SHARE = HOLDING_SHARE
"""Largest excess of the shown torque over the torque sent, as a share of rated torque: the holding torque."""
OVERSHOOT = 0.25
"""Largest overshoot of torque actual, as a share of the change of torque."""
FELT_SHARE = 0.08
"""Smallest change of a force that people notice, as a share of the force.

Pang, Tan and Durlach measured 7 % from 2.5 to 10 N: Manual discrimination of force using active finger motion,
Perception & Psychophysics 49 (1991).
"""
ENERGY_LIMIT = 0.005
"""Largest energy of the loop above the granted energy [J]: a handle of 0.6 kg at 0.13 m/s."""
LARGEST_MISSING_SHARE = 0.2
"""Largest share of missing samples in a second, for any stability margin."""
GAP_SHARE = 0.9
"""Largest share of the stability margin above 1 that feedback gaps may use at their worst timing; the rest damps."""
AGE_SHARE = 0.6
"""Age at which feedback is a trip, as a share of the drive's guard time."""
SOON_SHARE = 0.5
"""Longest short gap, as a share of that age: after a short gap the law of the scene goes on from its place."""
LARGEST_SHIFT = {"linear": 0.02, "rotary": 0.5}
"""Largest shift of a scene after gaps [m or rad]: the motion of a fast hand, 1.3 m/s or 33 rad/s, in the longest short
gap at 1 kHz. Chosen here."""
HELD_POWER = 0.002
"""Largest mean power [W] of torque held in gaps; a hand does not feel it."""
HELD_ENERGY = 0.05
"""Largest energy of held torque above that power [J], in one gap or many: a handle of 0.6 kg at 0.4 m/s."""
HOLD_FADE = 0.01
"""Time in which the held torque fades to zero, from the second missing period on [s]; longer than the slew time."""


def fade_periods(period: float) -> int:
    """Return the number of periods in which held torque fades to zero, at least 1."""
    return max(1, round(HOLD_FADE / period))


def soon_periods(period: float, age: float) -> int:
    """Return the number of missing periods in the longest short gap; feedback of this `age` [s] is a trip."""
    return math.floor(SOON_SHARE * age / period + 1e-9)


def doubt_time(period: float) -> float:
    """Return the deadline of a doubt [s]: the time for which the drive may show another torque than the one sent."""
    return max(ECHO_TIME, ECHO_PERIODS * period)


def recent_time(period: float, age: float, lag: float) -> float:
    """Return the time for which a drive may still show a target torque after it was sent [s].

    It is the sum of the deadline of a doubt, the age at which feedback is a trip, and three lags of the echo.
    """
    return doubt_time(period) + age + 3.0 * lag


def foreign_gap(period: float, every: int) -> float:
    """Return the time within which several detected set-points of another master count as one [s].

    Three in a row are found within the deadline of a doubt; a burst of noise counts as one.
    """
    return max(ECHO_TIME / ECHO_PERIODS, every * period)


def echo_time(echo: Signal | None, period: float) -> float:
    """Return the longest time until set-points without effect are detected [s]; infinity without an echo.

    An echo that is read back shows it in the second answer at the latest; a further answer within the deadline confirms
    it.
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
    """Largest uncertainty of a position that is integrated from velocity [m or rad]."""
    acceleration: float = math.inf
    """[m/s² or rad/s²]; motor and hand cannot accelerate the inertia more."""
    power: float = math.inf
    """Largest power of the motor on the hand [W]."""
    stall: float = math.inf
    """Longest time for which counts may stand still under torque [s]."""
    holding: float = math.inf
    """Largest effort after a stall."""
    unseen: float = math.inf
    """Largest effort, that of the pulses, before the motor direction is confirmed."""
    age: float = math.inf
    """Largest age of feedback with which force is rendered [s]."""
    echo: float = math.inf
    """Longest time until set-points without effect are detected [s]; infinity for a drive without an echo."""
    shift: float = math.inf
    """Largest shift of the scene after gaps in the feedback [m or rad]."""
    energy: float = math.inf
    """Largest energy that this axis and its coupled axes may generate together [J]; infinity: not judged."""
    forgiven: float = math.inf
    """Largest energy that these axes may give within a second while the sent force differs from the law [J]."""

    @property
    def before_sign(self) -> float:
        """Largest effort of the scene before the motor direction is confirmed [N or N·m]."""
        return min(self.effort, self.holding, self.unseen)

    def lowered(self, effort: float, step: float) -> "EffortLimits":
        """Return the limits for an effort of at most this, in whole steps before the motor direction is confirmed."""
        if effort >= self.effort:
            return self
        unseen = min(self.unseen, math.floor(effort / step + 1e-9) * step)
        return replace(self, effort=effort, slew=effort / SLEW_TIME, unseen=unseen)

    def jump(self, period: float, resolution: float) -> float:
        """Return the largest second difference of the position [m or rad] that motion and encoder can cause.

        Each of its three readings is wrong by up to half a count; the middle one counts twice.
        """
        return self.acceleration * period**2 + 2.0 * resolution


def limits_of(
    axis: RigAxis, rated: float, step: float, plant: Plant | None, workspace: Workspace, *, capped: bool
) -> EffortLimits:
    """Return the limits of an axis: those of the rig, else those that follow from motor, hand and inertia.

    `rated` is the rated effort in the workspace [N or N·m], `step` one step of the drive's target torque. `plant` is
    None when inertia, damping or friction is unknown. A `capped` effort is the holding effort (`guards.cap_reason`).
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
    """Return both bounds on the effort before the direction is confirmed: by the rated effort, and at the handle."""
    given = axis.permissions
    share = PULSE_SHARE if given.sign_pulse is None else given.sign_pulse
    return share * rated, PULSE_EFFORT[workspace.value] if given.sign_effort is None else given.sign_effort


def check_places(scene: Scene, name: str, rig: Rig, elements: tuple[Element, ...], limits: EffortLimits) -> None:
    """Refuse places outside the travel: such a wall would never be felt, or always with its full force."""
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
    """Return whether an element, such as a preloaded spring, acts at an end of the travel below the effort limit."""
    if not is_varying(element):
        return False
    there = element.local(end, end)
    return max(map(abs, there.force)) < effort and any((*there.force, *there.stiffness))


def _in_thousandths(place: float, unit: str) -> str:
    """Return a hint on mm or mrad for a place of at least 1 m or rad; empty for any other."""
    return f'; {exactly(place)} m{unit} is written "{exactly(place)} m{unit}"' if abs(place) >= 1.0 else ""

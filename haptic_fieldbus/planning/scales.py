"""Scales of one axis: steps of torque and position, and motor and mechanism in the workspace of the handle."""

import math
from typing import TYPE_CHECKING

from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import RigAxis, metres_per_revolution
from haptic_fieldbus.drive.units import (
    ABSOLUTE_TORQUE_UNITS,
    COUNTS,
    TORQUE_UNITS,
    is_current,
    needed_for,
    steps_per_revolution,
    torque_step,
)
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:
    from haptic_fieldbus.margins.bodies import HungBody


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
            f"the rig's {needed_for(unit, axis)} of node {axis.node} is unknown: torque cannot be scaled without it"
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
        raise PlanError(f"the rig's rated_torque of node {axis.node} is unknown: torque cannot be limited without it")
    if axis.coulomb_friction >= rated:
        raise PlanError(
            f"the rig's coulomb_friction of node {axis.node}, {exactly(axis.coulomb_friction)} N·m, is not below its "
            f"rated_torque, {exactly(rated)} N·m: the motor could not move the handle. Is one of them in mN·m?"
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
        raise PlanError(f"{profile.title} tells its position in {unit}; it needs a linear mechanism in the rig")
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

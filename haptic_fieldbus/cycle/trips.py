"""Conversion of a trip to an exception, whose class names the origin and whose message gives cause, value and time."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Protocol, runtime_checkable

from haptic_fieldbus import errors
from haptic_fieldbus.cycle.laws import Sensed, field_of, summed
from haptic_fieldbus.cycle.safety import LINK_TRIPS, Trip, TripKind
from haptic_fieldbus.numerals import DIGITS, GIVEN_DIGITS, LIMIT_DIGITS, in_unit, percent, rounded, rounded_limit
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.encoder_probe import HAND, PAIRS
from haptic_fieldbus.planning.limits import HELD_POWER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.sign_probe import raising
from haptic_fieldbus.scenes.own_faults import blamed
from haptic_fieldbus.scenes.registry import kind_of
from haptic_fieldbus.scenes.scene import Scene, axes_of
from haptic_fieldbus.signals import LinkFlag

# Search for a start position of a scene whose first force is too large.

SEARCHED = {"linear": 0.5, "rotary": 6.2832}
"""Largest distance of the search from the handle [m or rad]."""
PLACES = 2000
PERIOD = 1e-3
"""[s]; arbitrary: at rest no element depends on the period."""


def start_position(axis: AxisPlan, largest: float, here: float = 0.0) -> float | None:
    """Return the distance from `here` [m or rad] to the nearest position at which the scene asks for at most `largest`.

    Each position is tried with elements that begin there, at rest. None if there is no such position nearby.
    """
    step = SEARCHED[axis.workspace.value] / PLACES
    for way in (side * place * step for place in range(1, PLACES + 1) for side in (1, -1)):
        fields = [field_of(element, PERIOD, axis.method, Sensed()) for element in axis.elements]
        if fields and abs(summed(fields)(here + way)) <= largest:
            return way
    return None


TRIP_ERRORS: dict[TripKind, type[errors.HapticFieldbusError]] = {
    **dict.fromkeys(TripKind, errors.SafetyTripError),
    TripKind.EMERGENCY: errors.DriveFaultError,
    TripKind.DRIVE_FAULT: errors.DriveFaultError,
    TripKind.DRIVE_DISABLED: errors.DriveFaultError,
    TripKind.NODE_RESET: errors.DriveFaultError,
    TripKind.NODE_NOT_OPERATIONAL: errors.DriveFaultError,
    TripKind.NO_SIGN_OF_LIFE: errors.BusTimeoutError,
    TripKind.FEEDBACK_LOST: errors.BusTimeoutError,
    TripKind.BUS_OFF: errors.BusError,
    TripKind.BUS_EXCEPTION: errors.BusError,
    TripKind.FEEDBACK_SPARSE: errors.BusTimeoutError,
    TripKind.CLOCK: errors.BusError,
    TripKind.SET_POINTS_DEAD: errors.DriveFaultError,
    TripKind.SIGN_HIDDEN: errors.PlanError,
    TripKind.START_FORCE: errors.PlanError,
}
"""Exception class of each kind of trip: a fault of the drive, a fault of the bus, or a limit of this package."""


CONSEQUENCES = (
    TripKind.NODE_RESET,
    TripKind.NO_SIGN_OF_LIFE,
    TripKind.NODE_NOT_OPERATIONAL,
    TripKind.BUS_EXCEPTION,
    TripKind.FEEDBACK_LOST,
    TripKind.FEEDBACK_SPARSE,
    TripKind.DRIVE_FAULT,
    TripKind.DRIVE_DISABLED,
    TripKind.SET_POINTS_DEAD,
)
"""Trips that another link fault may cause; the message of this fault can arrive later."""


def explained(trip: Trip, causes: Mapping[str, tuple[LinkFlag, int]]) -> Trip:
    """Return the trip, or its cause if `causes` has one for the axis: a link fault with its code.

    To be called after the bus was stopped, because the cause may arrive later than the trip.
    """
    flag, code = causes.get(trip.axis, (None, 0))
    if flag is None or trip.kind not in CONSEQUENCES:
        return trip
    return replace(trip, kind=LINK_TRIPS[flag], value=code)


def failed_in(trip: Trip, error: Exception, scene: Scene) -> Trip:
    """Return the trip of a scene that raised an error, with element, file and line if an own element raised it.

    To be called after the bus was stopped, because reading a traceback takes time.
    """
    found = blamed(error, scene.elements)
    if trip.kind is not TripKind.ELEMENT_FAILED or found is None:
        return trip
    source, fault = found
    place = source if fault.line is None else f"{source} line {fault.line}"
    axis = next((axes_of(each)[0] for each in scene.elements if fault.key == f"element {each.name}"), trip.axis)
    return replace(trip, axis=axis, detail=f"{fault.key}: {fault.message} ({place})")


@runtime_checkable
class Remedying(Protocol):
    """An element of a command whose options bound the motion, and change what a trip is about."""

    def remedy(self, kind: TripKind) -> str:
        """Return the advice on a trip of this kind, as sentences; empty where the usual one is right."""


def trip_error(
    trip: Trip, plan: Plan, enabled_at_ns: int | None, *, released: bool = True
) -> errors.HapticFieldbusError:
    """Return the exception for a trip: time, cause, advice; `enabled_at_ns` is None before operation enabled.

    `released` tells that all drives have confirmed that their motors are off.
    """
    axis = next(axis for axis in plan.axes if axis.name == trip.axis)
    cause, advice = CAUSES[trip.kind](trip, axis)
    if trip.kind is TripKind.POSITION and not plan.rig.source:
        advice += (
            " Without a rig file it is that of the shipped bench; simulate --write-rig FILE writes one to widen it."
        )
    remedies = (each.remedy(trip.kind) for each in axis.elements if isinstance(each, Remedying))
    advice = next(filter(None, remedies), advice)
    if len(plan.axes) > 1:
        cause = f"axis {trip.axis}: {cause}"
    if trip.kind is TripKind.START_FORCE:
        return errors.PlanError(f"{cause}; no torque was applied. {advice}")
    torque = "torque is off" if released else "zero torque was commanded, not confirmed"
    tripped = f"Tripped {moment(trip.t_ns, enabled_at_ns)}: {cause}; {torque}. {advice}"
    return TRIP_ERRORS[trip.kind](tripped)


def moment(t_ns: int, enabled_at_ns: int | None) -> str:
    """Return an instant in words, relative to operation enabled; `enabled_at_ns` is None before it."""
    if enabled_at_ns is None:
        return "before enabling"
    return f"{(t_ns - enabled_at_ns) * 1e-9:.3f} s after enabling"


LINK_ADVICE = {
    LinkFlag.BUS_OFF: "Check the cable, and on CAN the terminators and the bit rate.",
    LinkFlag.EMERGENCY: "Look up this error in the manual of the drive.",
    LinkFlag.BOOT_UP: "Check the power supply of the drive.",
    LinkFlag.NO_SIGN_OF_LIFE: "Check cable and power of the drive.",
    LinkFlag.NOT_OPERATIONAL: "Another program may have stopped the drive.",
    LinkFlag.EXCEPTION: "Check the wiring. Another program may have changed the configuration of the drive.",
    LinkFlag.DUPLICATE: "Give each device on the bus an address of its own.",
}
"""Advice on a link fault, if the protocol has no advice of its own."""
Told = tuple[str, str]
"""Cause of a trip, as part of a sentence, and advice, as sentences."""


def _told_by_bus(flag: LinkFlag, trip: Trip, axis: AxisPlan) -> Told:
    # The value of a link trip is the code in the header; only some flags have one. Advice follows a semicolon.
    cause, _, advice = axis.traffic.fault_text(flag, int(trip.value), axis.bus_name).partition("; ")
    return cause, f"{advice[0].upper()}{advice[1:]}." if advice else LINK_ADVICE[flag]


def _power(trip: Trip, axis: AxisPlan) -> Told:
    # The value of these trips is the statusword.
    cause = f"node {axis.node} changed to {trip.detail} by itself (statusword {int(trip.value):04X}h)"
    return cause, "Look up the error code of the drive."


def _lost(trip: Trip, axis: AxisPlan) -> Told:
    # The value is the age [s].
    cause = f"feedback lost: the last from node {axis.node} is {rounded(1e3 * trip.value)} ms old"
    return cause, "Check cable, power and node-ID of the drive."


def _too_often(trip: Trip, axis: AxisPlan) -> Told:
    cause = (
        f"feedback lost too often: {percent(trip.value)} of the samples of node {axis.node} within one second, which "
        f"divides the stiffness limit by {trip.detail}"
    )
    return cause, "Check the cable and the load of the computer."


def _missed(trip: Trip, axis: AxisPlan) -> Told:
    """Return the cause of missed periods. One long sleep has no detail; many short ones have a stiffness factor."""
    advice = "Another process uses the processor, or --rate is too high for this computer."
    if not trip.detail:
        return f"the loop slept for {rounded(1e3 * trip.value)} ms", advice
    cause = (
        f"the loop missed {percent(trip.value)} of the periods within one second, which divides the stiffness limit "
        f"by {trip.detail}"
    )
    return cause, advice


def _clock(trip: Trip, axis: AxisPlan) -> Told:
    cause = f"the clock went back: a sample is {rounded(-1e3 * trip.value)} ms older than the one before"
    return cause, "`haptic-fieldbus doctor` checks the clock."


def _not_finite(trip: Trip, axis: AxisPlan) -> Told:
    workspace = axis.workspace
    cause = f"the {workspace.effort_name} of the scene is not finite: {trip.value} {workspace.effort_unit}"
    return cause, "Check the parameters of the scene and its own elements."


def _scene_failed(trip: Trip, axis: AxisPlan) -> Told:
    known = all(kind_of(type(element)) for element in axis.elements)
    advice = "Correct the element; `haptic-fieldbus scenes check` tests it." if known else "Correct its code."
    return f"the scene failed: {trip.detail}", advice


def _start(trip: Trip, axis: AxisPlan) -> Told:
    unit = axis.workspace.effort_unit
    where = start_position(axis, trip.limit or 0.0, trip.position)
    advice = (
        "No position nearby has a smaller force: reduce the force of the scene."
        if where is None
        else f"Start with the handle {rounded(where)} {axis.workspace.length_unit} from here."
    )
    cause = (
        f"the scene starts with {rounded(trip.value)} {unit}, at most {rounded(trip.limit or 0.0)} {unit} is allowed "
        "at the start"
    )
    return cause, advice


def _acceleration(trip: Trip, axis: AxisPlan) -> Told:
    unit = axis.workspace.length_unit
    cause = (
        f"the position jumped: {rounded(trip.value)} {unit}/s² is more than motor and hand can cause "
        f"({rounded(trip.limit or 0.0)} {unit}/s²)"
    )
    return cause, "Check the encoder and its cable."


def _mechanical_power(trip: Trip, axis: AxisPlan) -> Told:
    cause = f"power {_beyond(trip, DIGITS)} W, above the limit of {_limit(trip)} W"
    return cause, _softer("power", axis)


def _energy(trip: Trip, axis: AxisPlan) -> Told:
    cause = (
        f"the scene put {rounded(1e3 * trip.value)} mJ more into the handle than allowed "
        f"({rounded(1e3 * (trip.limit or 0.0))} mJ)"
    )
    return cause, "If an element stores energy, define `stored`; if it is a source, define `strongest`."


FIND_LOSS = "Find the cause of the lost feedback."


def _forgiven(trip: Trip, axis: AxisPlan) -> Told:
    cause = (
        f"feedback gaps, fade-in and doubts about the motor direction put {rounded(1e3 * trip.value)} mJ more into the "
        f"handle within one second than the scene had stored (limit {rounded(1e3 * (trip.limit or 0.0))} mJ)"
    )
    return cause, FIND_LOSS


def _held(trip: Trip, axis: AxisPlan) -> Told:
    cause = (
        f"torque held in feedback gaps put {rounded(1e3 * trip.value)} mJ into the handle, beyond the stored energy "
        f"and {rounded(1e3 * HELD_POWER)} mW (limit {rounded(1e3 * (trip.limit or 0.0))} mJ)"
    )
    return cause, FIND_LOSS


def _limit(trip: Trip) -> str:
    """Return the limit that was exceeded, in words."""
    return "unknown" if trip.limit is None else rounded_limit(trip.limit)


def _beyond(trip: Trip, digits: int) -> str:
    """Return the value that exceeded the limit, with these or as many more digits as tell it from the limit."""
    told = (rounded(trip.value, each) for each in range(digits, GIVEN_DIGITS + 1))
    return next((text for text in told if text != _limit(trip)), _limit(trip))


def _speed(trip: Trip, axis: AxisPlan) -> Told:
    unit = axis.workspace.length_unit
    cause = f"speed {_beyond(trip, DIGITS)} {unit}/s, above the limit of {_limit(trip)} {unit}/s{_weak(axis)}"
    return cause, _softer("speed", axis)


def _position(trip: Trip, axis: AxisPlan) -> Told:
    unit = axis.workspace.length_unit
    cause = f"position {_beyond(trip, LIMIT_DIGITS)} {unit}, beyond the limit of {_limit(trip)} {unit}{_weak(axis)}"
    return cause, f"Move the handle back. The travel is axis.{axis.name}.limits.position of the rig."


def _softer(limit: str, axis: AxisPlan) -> str:
    """Return the advice for a handle that moved too fast or too strongly."""
    return f"Make the scene softer, or raise axis.{axis.name}.limits.{limit} in the rig."


def _weak(axis: AxisPlan) -> str:
    """Return the force cap, above which a hand pushes through any wall, in words; empty without a cap."""
    return f" ({axis.cap}; the hand can push through walls)" if axis.cap else ""


def _dead(trip: Trip, axis: AxisPlan) -> Told:
    """Return the cause of set-points without effect; the value is the shown torque, the limit the torque sent."""
    unit, shown = axis.workspace.effort_unit, "echo" if axis.profile.echo is None else axis.profile.echo.value
    if math.isnan(trip.value):
        cause = f"set-points not confirmed: node {axis.node} has not returned its target torque for {trip.detail} ms"
        return cause, "Another tool may keep its SDO server busy."
    cause = (
        f"set-points do not act: {rounded(trip.limit or 0.0)} {unit} was sent, but the {shown} of node {axis.node} "
        f"is {rounded(trip.value)} {unit} and has not followed for {trip.detail} ms"
    )
    return cause, (
        "Another tool may have disabled the reception of set-points, changed the mode of operation or lowered the "
        "torque limit of the drive."
    )


def _foreign(trip: Trip, axis: AxisPlan) -> Told:
    """Return the cause of torque that was not sent; the value is the shown torque, the limit the torque sent."""
    unit = axis.workspace.effort_unit
    cause = (
        f"another master on {axis.bus_name} sets the torque of unit {axis.node}: {trip.detail} it was "
        f"{in_unit(trip.value, unit)}, but at most {in_unit(trip.limit or 0.0, unit)} in this direction was sent"
    )
    return cause, "End the other master."


def _reversed(trip: Trip, axis: AxisPlan) -> Told:
    """Return the cause of a motion against the torque; the value is the distance, the limit the torque."""
    force, length = axis.workspace.effort_unit, axis.workspace.length_unit
    cause = (
        f"motor direction wrong: test pulses of {in_unit(trip.limit or 0.0, force)} moved the handle "
        f"{in_unit(abs(trip.value), length)} the wrong way"
    )
    return cause, (
        "Encoder or motor is reversed: swap two wires of the reversed one, or reverse it in the drive. Do not change "
        "`sign` of the mechanism in the rig: it reverses both."
    )


def _hidden(trip: Trip, axis: AxisPlan) -> Told:
    """Return the cause of a refusal because nothing moved; the value is the attempts, the limit the torque."""
    cause = (
        f"motor direction not confirmed: test pulses up to ±{in_unit(trip.limit or 0.0, axis.workspace.effort_unit)} "
        f"did not move the handle in {trip.value:.0f} attempts"
    )
    return cause, (
        "Release the handle and its brake, and check the motor connection. If friction is larger than these pulses: "
        f"{raising(axis)}."
    )


def _stood_still(trip: Trip, axis: AxisPlan) -> Told:
    """Return the cause of a trip because no pulse moved the counts; the value is the force, the limit the pulses."""
    force, length, hand = axis.workspace.effort_unit, axis.workspace.length_unit, HAND[axis.workspace]
    cause = (
        f"the encoder does not count: under {in_unit(abs(trip.value), force)}, {PAIRS} pairs of test pulses of "
        f"±{in_unit(trip.limit or 0.0, force)} moved no count; two counts are expected against a hand of "
        f"{in_unit(hand.stiffness, f'{force}/{length}')}"
    )
    return cause, (
        "Check the encoder and its cable. Check that no brake or end stop blocks the handle. Friction may be larger "
        "than in the rig."
    )


def _drift(trip: Trip, axis: AxisPlan) -> Told:
    """Return the cause of a drift trip, with the remedy: a new run sets a new zero."""
    unit, step = axis.workspace.length_unit, abs(axis.velocity_unit)
    cause = (
        f"position uncertain by {_beyond(trip, DIGITS)} {unit}, above the limit of {_limit(trip)} {unit}: "
        f"{axis.profile.title} reports only velocity, rounded to {rounded(step)} {unit}/s, and the rounding errors "
        "add up"
    )
    return cause, f"Restart with the handle at its zero, or raise axis.{axis.name}.limits.drift."


CAUSES: dict[TripKind, Callable[[Trip, AxisPlan], Told]] = {
    **{kind: partial(_told_by_bus, flag) for flag, kind in LINK_TRIPS.items()},
    TripKind.DRIVE_FAULT: _power,
    TripKind.DRIVE_DISABLED: _power,
    TripKind.FEEDBACK_LOST: _lost,
    TripKind.FEEDBACK_SPARSE: _too_often,
    TripKind.PERIODS_MISSED: _missed,
    TripKind.CLOCK: _clock,
    TripKind.NOT_FINITE: _not_finite,
    TripKind.ELEMENT_FAILED: _scene_failed,
    TripKind.START_FORCE: _start,
    TripKind.ACCELERATION: _acceleration,
    TripKind.POWER: _mechanical_power,
    TripKind.ENERGY: _energy,
    TripKind.FORGIVEN: _forgiven,
    TripKind.HELD: _held,
    TripKind.SPEED: _speed,
    TripKind.POSITION: _position,
    TripKind.DRIFT: _drift,
    TripKind.SET_POINTS_DEAD: _dead,
    TripKind.SET_POINTS_FOREIGN: _foreign,
    TripKind.SIGN: _reversed,
    TripKind.SIGN_HIDDEN: _hidden,
    TripKind.ENCODER_STILL: _stood_still,
}

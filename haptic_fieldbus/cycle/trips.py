"""Conversion of a trip to an exception, whose class names the origin and whose message gives cause, value and time."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

from haptic_fieldbus.cycle.laws import Sensed, field_of, summed
from haptic_fieldbus.cycle.safety import LINK_TRIPS, Trip, TripKind
from haptic_fieldbus.errors import (
    BusError,
    BusTimeoutError,
    DriveFaultError,
    HapticFieldbusError,
    PlanError,
    SafetyTripError,
)
from haptic_fieldbus.numerals import in_unit, percent, rounded, rounded_limit
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.encoder_probe import HAND, PAIRS
from haptic_fieldbus.planning.limits import HELD_POWER
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.sign_probe import raising
from haptic_fieldbus.scenes.own_faults import blamed
from haptic_fieldbus.scenes.scene import Scene, axes_of
from haptic_fieldbus.signals import LinkFlag

# Where a scene that begins with too much force could begin instead.

SEARCHED = {"linear": 0.5, "rotary": 6.2832}
"""How far from where the handle is a place is looked for [m or rad]."""
PLACES = 2000
PERIOD = 1e-3
"""[s]; any period will do, for at rest no element depends on it."""


def start_position(axis: AxisPlan, largest: float, here: float = 0.0) -> float | None:
    """Return the nearest place, as a way from `here` [m or rad], at which the scene asks for at most `largest`.

    Each place is tried with elements that begin there, at rest. None when there is no such place nearby.
    """
    for way in _ways(SEARCHED[axis.workspace.value] / PLACES):
        fields = [field_of(element, PERIOD, axis.method, Sensed()) for element in axis.elements]
        if fields and abs(summed(fields)(here + way)) <= largest:
            return way
    return None


def _ways(step: float) -> Iterator[float]:
    """From small to large, to both sides."""
    for place in range(1, PLACES + 1):
        yield place * step
        yield -place * step


TRIP_ERRORS: dict[TripKind, type[HapticFieldbusError]] = {
    TripKind.EMERGENCY: DriveFaultError,
    TripKind.DRIVE_FAULT: DriveFaultError,
    TripKind.DRIVE_DISABLED: DriveFaultError,
    TripKind.NODE_RESET: DriveFaultError,
    TripKind.NODE_NOT_OPERATIONAL: DriveFaultError,
    TripKind.NO_SIGN_OF_LIFE: BusTimeoutError,
    TripKind.FEEDBACK_LOST: BusTimeoutError,
    TripKind.BUS_OFF: BusError,
    TripKind.BUS_EXCEPTION: BusError,
    TripKind.FEEDBACK_SPARSE: BusTimeoutError,
    TripKind.PERIODS_MISSED: SafetyTripError,
    TripKind.CLOCK: BusError,
    TripKind.ENCODER_STILL: SafetyTripError,
    TripKind.FOREIGN_MASTER: SafetyTripError,
    TripKind.DUPLICATE_NODE: SafetyTripError,
    TripKind.SET_POINTS_DEAD: DriveFaultError,
    TripKind.SET_POINTS_FOREIGN: SafetyTripError,
    TripKind.SIGN: SafetyTripError,
    TripKind.SIGN_HIDDEN: PlanError,
    TripKind.NOT_FINITE: SafetyTripError,
    TripKind.ELEMENT_FAILED: SafetyTripError,
    TripKind.START_FORCE: PlanError,
    TripKind.ACCELERATION: SafetyTripError,
    TripKind.POWER: SafetyTripError,
    TripKind.ENERGY: SafetyTripError,
    TripKind.FORGIVEN: SafetyTripError,
    TripKind.HELD: SafetyTripError,
    TripKind.SPEED: SafetyTripError,
    TripKind.POSITION: SafetyTripError,
    TripKind.DRIFT: SafetyTripError,
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
"""Trips that may come of another fault of the link, whose message arrives after them."""


def explained(trip: Trip, causes: Mapping[str, tuple[LinkFlag, int]]) -> Trip:
    """Return the trip, or the cause of it where `causes` has one for the axis: a fault of the link with its code.

    To be called after the bus was stopped, because the cause may arrive later than the trip.
    """
    flag, code = causes.get(trip.axis, (None, 0))
    if flag is None or trip.kind not in CONSEQUENCES:
        return trip
    return replace(trip, kind=LINK_TRIPS[flag], value=code)


def failed_in(trip: Trip, error: Exception, scene: Scene) -> Trip:
    """Return the trip of a scene that raised an error, with element, file and line where it came from an own element.

    To be called after the bus was stopped, because reading a traceback takes time.
    """
    found = blamed(error, scene.elements)
    if trip.kind is not TripKind.ELEMENT_FAILED or found is None:
        return trip
    source, fault = found
    place = source if fault.line is None else f"{source}, line {fault.line}"
    axis = next((axes_of(each)[0] for each in scene.elements if fault.key == f"element {each.name}"), trip.axis)
    return replace(trip, axis=axis, detail=f"{fault.key}: {fault.message} ({place})")


def trip_error(trip: Trip, plan: Plan, enabled_at_ns: int | None) -> HapticFieldbusError:
    """Return the exception for a trip; `enabled_at_ns` is None before operation enabled."""
    axis = next(axis for axis in plan.axes if axis.name == trip.axis)
    cause, when = CAUSES[trip.kind](trip, axis), moment(trip.t_ns, enabled_at_ns)
    if trip.kind is TripKind.START_FORCE:
        return PlanError(f"axis {trip.axis}: {cause}. No torque was given")
    return TRIP_ERRORS[trip.kind](f"axis {trip.axis}: {cause}, {when}. Torque was taken away")


def moment(t_ns: int, enabled_at_ns: int | None) -> str:
    """Return an instant in words, relative to operation enabled; `enabled_at_ns` is None before it."""
    if enabled_at_ns is None:
        return "before operation enabled"
    return f"{(t_ns - enabled_at_ns) * 1e-9:.3f} s after operation enabled"


def _told_by_bus(flag: LinkFlag, trip: Trip, axis: AxisPlan) -> str:
    # The value of a link trip is the code in the header, which only some of the flags have.
    return axis.traffic.fault_text(flag, int(trip.value), axis.bus_name)


def _power(trip: Trip, axis: AxisPlan) -> str:
    # The value of these trips is the statusword.
    return f"node {axis.node} went to {trip.detail} by itself (statusword {int(trip.value):04X}h)"


def _too_often(trip: Trip, axis: AxisPlan) -> str:
    return (
        f"{percent(trip.value)} of the feedback of node {axis.node} was lost within a second, which divides the "
        f"stiffness that is stable by {trip.detail}"
    )


def _missed(trip: Trip, axis: AxisPlan) -> str:
    """One long sleep has no detail; many short ones have the factor by which they cost stiffness."""
    advice = "another process takes the processor's time, or the rate is too high for this computer"
    if not trip.detail:
        return f"the loop slept for {rounded(1e3 * trip.value)} ms: {advice}"
    return (
        f"the loop missed {percent(trip.value)} of the periods of a second, which divides the stiffness that is "
        f"stable by {trip.detail}: {advice}"
    )


def _start(trip: Trip, axis: AxisPlan) -> str:
    unit = axis.workspace.effort_unit
    where = start_position(axis, trip.limit or 0.0, trip.position)
    advice = (
        "no place nearby would do: lower the force of the scene"
        if where is None
        else f"start with the handle {rounded(where)} {axis.workspace.length_unit} from here"
    )
    return (
        f"the scene begins with {rounded(trip.value)} {unit}, and at most {rounded(trip.limit or 0.0)} {unit} is "
        f"permitted at the start; {advice}"
    )


def _acceleration(trip: Trip, axis: AxisPlan) -> str:
    unit = axis.workspace.length_unit
    return (
        f"the position jumped: {rounded(trip.value)} {unit}/s² is more than motor, hand and inertia can do "
        f"({rounded(trip.limit or 0.0)} {unit}/s²). Check the encoder and its cable"
    )


def _energy(trip: Trip, axis: AxisPlan) -> str:
    return (
        f"the scene gave the hand {rounded(1e3 * trip.value)} mJ more than it had stored and the loop may leak, the "
        f"limit is {rounded(1e3 * (trip.limit or 0.0))} mJ. An element with a source of energy states its largest "
        "force (strongest), one that stores energy how much (stored)"
    )


def _forgiven(trip: Trip, axis: AxisPlan) -> str:
    return (
        f"gaps in the feedback, fade-in and doubts gave the hand {rounded(1e3 * trip.value)} mJ within a second beyond "
        f"what the scene had stored, the limit is {rounded(1e3 * (trip.limit or 0.0))} mJ. Look for what loses feedback"
    )


def _held(trip: Trip, axis: AxisPlan) -> str:
    return (
        f"torque held in gaps of the feedback gave the hand {rounded(1e3 * trip.value)} mJ, beyond what the scene had "
        f"stored and {rounded(1e3 * HELD_POWER)} mW; the limit is {rounded(1e3 * (trip.limit or 0.0))} mJ. Look for "
        "what loses feedback"
    )


def _limit(trip: Trip) -> str:
    """The limit that was exceeded."""
    return "unknown" if trip.limit is None else rounded_limit(trip.limit)


def _speed(trip: Trip, axis: AxisPlan) -> str:
    unit = axis.workspace.length_unit
    return f"speed {rounded(trip.value)} {unit}/s, the limit is {_limit(trip)} {unit}/s{_weak(axis)}"


def _position(trip: Trip, axis: AxisPlan) -> str:
    unit = axis.workspace.length_unit
    return f"position {rounded_limit(trip.value)} {unit}, the limit is {_limit(trip)} {unit}{_weak(axis)}"


def _weak(axis: AxisPlan) -> str:
    """Return the cap of the force, with which a hand pushes through any wall; empty without one."""
    return f" ({axis.cap}; a hand can push through walls)" if axis.cap else ""


def _dead(trip: Trip, axis: AxisPlan) -> str:
    """Return the cause of set-points that do not act; the value is what the drive says, the limit what it was sent."""
    unit, shown = axis.workspace.effort_unit, "echo" if axis.profile.echo is None else axis.profile.echo.value
    if math.isnan(trip.value):
        return (
            f"set-points are not proved to act: node {axis.node} has not answered for {trip.detail} ms what target "
            "torque it has. Another tool may keep its SDO server busy"
        )
    return (
        f"set-points do not act: {rounded(trip.limit or 0.0)} {unit} was sent, but the {shown} of node {axis.node} "
        f"says {rounded(trip.value)} {unit}, and has not followed for {trip.detail} ms. Another tool may have "
        "switched off what receives its set-points, changed its mode of operation or lowered its torque limit"
    )


def _foreign(trip: Trip, axis: AxisPlan) -> str:
    """Return the cause of torque that was not asked for; the value is what the drive says, the limit what was sent."""
    unit = axis.workspace.effort_unit
    return (
        f"another master on {axis.bus_name} sets the torque of unit {axis.node}: {trip.detail} it said "
        f"{in_unit(trip.value, unit)}, and at most {in_unit(trip.limit or 0.0, unit)} in this direction was sent. End "
        "that master"
    )


def _reversed(trip: Trip, axis: AxisPlan) -> str:
    """Return the cause of a motion against the torque; the value is how far, the limit the torque."""
    force, length = axis.workspace.effort_unit, axis.workspace.length_unit
    return (
        f"pulses of {in_unit(trip.limit or 0.0, force)} moved the handle {in_unit(abs(trip.value), length)} to the "
        "other side. Either the encoder counts backwards, or the motor turns backwards: swap two lines of the one that "
        "does, or reverse it in the drive. The sign of the mechanism in the rig turns both, and is no remedy"
    )


def _hidden(trip: Trip, axis: AxisPlan) -> str:
    """Return the cause of a refusal: nothing moved; the value is the number of attempts, the limit the torque."""
    return (
        f"pulses of up to ±{in_unit(trip.limit or 0.0, axis.workspace.effort_unit)} did not move the handle in "
        f"{trip.value:.0f} attempts, so its sign is not known. Let go of the handle, release its brake, and check that "
        f"the motor is connected. If friction is larger than these pulses: {raising(axis)}"
    )


def _stood_still(trip: Trip, axis: AxisPlan) -> str:
    """Return the cause of a trip by counts that no pulse moved; the value is the force, the limit the pulses."""
    force, length, hand = axis.workspace.effort_unit, axis.workspace.length_unit, HAND[axis.workspace]
    return (
        f"the counts stood still under {in_unit(abs(trip.value), force)}, and {PAIRS} pairs of pulses of "
        f"±{in_unit(trip.limit or 0.0, force)} moved none of them, though they move two against a hand of "
        f"{in_unit(hand.stiffness, f'{force}/{length}')}. Check the encoder and its cable, and that neither a brake "
        "nor an end stop holds the handle; friction may be larger than in the rig"
    )


def _drift(trip: Trip, axis: AxisPlan) -> str:
    """Return the cause of a drift trip, with the remedy: a new run sets a new zero."""
    unit, step = axis.workspace.length_unit, abs(axis.velocity_unit)
    return (
        f"the position may be off by {rounded(trip.value)} {unit}, the limit is {_limit(trip)} {unit}: what is "
        f"rounded off {axis.profile.title}'s velocity, its only feedback, in steps of {rounded(step)} {unit}/s, adds "
        f"up (to go on, start anew with the handle at its zero, or raise axis.{axis.name}.limits.drift)"
    )


Cause = Callable[[Trip, AxisPlan], str]
"""Function that words the cause of a trip, as a part of a sentence."""
# The value of a trip by missing feedback is its age [s].
CAUSES: dict[TripKind, Cause] = {
    **{kind: partial(_told_by_bus, flag) for flag, kind in LINK_TRIPS.items()},
    TripKind.DRIVE_FAULT: _power,
    TripKind.DRIVE_DISABLED: _power,
    TripKind.FEEDBACK_LOST: lambda trip, axis: (
        f"no feedback from node {axis.node}: the last is {rounded(1e3 * trip.value)} ms old"
    ),
    TripKind.FEEDBACK_SPARSE: _too_often,
    TripKind.PERIODS_MISSED: _missed,
    TripKind.CLOCK: lambda trip, axis: (
        f"the time of a sample lies {rounded(-1e3 * trip.value)} ms before that of the one before"
    ),
    TripKind.NOT_FINITE: lambda trip, axis: (
        f"the scene's {axis.workspace.effort_name} is not finite: {trip.value} {axis.workspace.effort_unit}"
    ),
    TripKind.ELEMENT_FAILED: lambda trip, axis: f"the scene failed: {trip.detail}",
    TripKind.START_FORCE: _start,
    TripKind.ACCELERATION: _acceleration,
    TripKind.POWER: lambda trip, axis: f"power {rounded(trip.value)} W, the limit is {rounded(trip.limit or 0.0)} W",
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

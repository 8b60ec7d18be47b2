"""Preparation of a drive beyond what all drives need: values that its profile asks for, and what its tool has set.

What is written is read back. A value that is there already is not written, so that a constant that is right is no
fault. Nothing is stored: 1010h is never written, and a drive that is switched off forgets all of it.
"""

import math
from collections.abc import Iterator

from haptic_fieldbus.buses.canopen.node import Node
from haptic_fieldbus.buses.rating import check_rating, rated_torque
from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.drive.units import COUNTS
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.enabling import first_enabling
from haptic_fieldbus.protocols.canopen.periods import period_objects
from haptic_fieldbus.protocols.canopen.profile import NO_SUCH, CanopenProfile, ShownObject

ENCODER_RESOLUTION = tuple(ObjectEntry(0x608F, DataType.UINT32, subindex) for subindex in (1, 2))
"""Position encoder resolution of CiA 402-2: increments, and the revolutions of the motor for which they are."""
MAX_MOTOR_SPEED, MOTOR_SPEED_UNIT = 0x6080, "r/min"
"""Object of CiA 402-2; some drives have it in a unit of their own."""


def prepare(node: Node, profile: CanopenProfile, rate: float) -> None:
    """Make the drive hold what its profile needs before the mode is set, and the period; raises BusError."""
    for each in profile.setup.writes:
        ensure(node, each.entry, each.value)
    for entry, value in period_objects(profile, rate):
        ensure(node, entry, value)
    slope = profile.torque.slope
    if slope is not None:
        ensure(node, slope.entry, slope.value)


def ensure(node: Node, entry: ObjectEntry, value: int) -> None:
    """Write an entry unless it has this value already, and read it back; raises BusError."""
    if node.read(entry) != value:
        node.write(entry, value)


def commissioned(node: Node, profile: CanopenProfile, axis: AxisPlan) -> Iterator[str]:
    """Yield a sentence with what the vendor's tool has set, and one for a commutation search.

    Raises BusConfigurationError when a value is missing without which torque means nothing, or when the rated current,
    by which every command is scaled, is not that of the rig.
    """
    section = profile.commissioning
    shown: list[str] = []
    told = list(_left_out(profile))
    for each in section.shown:
        value = node.optional(each.entry)
        if each.needed and not value:
            raise BusConfigurationError(
                f"{node.label}: {each.name} ({each.entry.object:04X}h:{each.entry.subindex:02X}) is not set, so the "
                f"drive does not know its motor. Commission it with {section.tool or 'the tool of its vendor'} first"
            )
        if value is not None:
            shown.append(f"{each.name} {value}{f' {each.unit}' if each.unit else ''}")
            told.extend(_slower(node, each, value, axis))
    if profile.torque.rated_current is not None:
        _check_rated_current(node, profile.torque.rated_current.entry, axis)
    told.extend(_other_counts(node, profile, axis))
    if shown:
        yield f"set by {section.tool or 'the tool of its vendor'}: {', '.join(shown)}"
    yield from told
    warning = first_enabling(profile)
    if warning:
        yield warning


def _left_out(profile: CanopenProfile) -> Iterator[str]:
    """Yield a sentence with what a profile of no particular drive names and this drive lacks."""
    lacking = [source.removeprefix(NO_SUCH) for source in profile.sources.values() if source.startswith(NO_SUCH)]
    if lacking:
        yield f"{profile.title} is a profile of no particular drive, and this one has no {', no '.join(lacking)}"


def _slower(node: Node, shown: ShownObject, value: int, axis: AxisPlan) -> Iterator[str]:
    """Yield a sentence when the drive's max motor speed is below the speed at which the run ends.

    What a drive does there is not laid down for torque modes: it may take torque away, or fault.
    """
    if shown.object != MAX_MOTOR_SPEED or shown.unit != MOTOR_SPEED_UNIT:
        return
    allowed = value * 2.0 * math.pi / 60.0 * axis.rig.mechanism.ratio
    limit, unit = axis.limits.speed, f"{axis.workspace.length_unit}/s"
    if allowed < limit:
        yield (
            f"{node.label}: its {shown.name} of {value} {shown.unit} (6080h) is {rounded(allowed)} {unit} at "
            f"the handle, below the {exactly(limit)} {unit} at which the run ends, so the drive may take torque "
            f"away or fault before that. Raise it with the drive's tool, or lower axis.{axis.name}.limits.speed"
        )


def _other_counts(node: Node, profile: CanopenProfile, axis: AxisPlan) -> Iterator[str]:
    """Yield a sentence when the drive tells another encoder than the rig (CiA 402-2, 608Fh).

    It is no refusal, because the factor group of a drive may scale its position besides.
    """
    if profile.position is None or profile.position.actual.unit != COUNTS:
        return
    increments, revolutions = (node.optional(each) for each in ENCODER_RESOLUTION)
    if not increments or not revolutions:
        return
    counts, expected = increments / revolutions, axis.rig.encoder_counts_per_revolution
    if abs(counts - expected) > 0.5:
        hint = ". Are the counts in the rig lines?" if round(counts) == 4 * expected else ""
        yield (
            f"{node.label}: its encoder has {exactly(counts)} counts in a revolution (608Fh), the rig says {expected} "
            f"(axis.{axis.name}.encoder_counts_per_revolution): positions, speeds and stiffnesses would be off by a "
            f"factor of {rounded(counts / expected)}, unless the drive scales its position{hint}"
        )


def check_rated_torque(node: Node, profile: CanopenProfile, axis: AxisPlan) -> float | None:
    """Return the drive's rated torque [N·m], which scales every command; None when the profile names no object.

    Raises BusError, BusConfigurationError when it is not that of the rig.
    """
    mapped = profile.torque.rated
    if mapped is None:
        return None
    rated = rated_torque(profile.title, str(mapped.entry), mapped.unit, node.read(mapped.entry))
    check_rating(node.label, axis, str(mapped.entry), "torque", rated, axis.rig.rated_torque, "N·m")
    return rated


def _check_rated_current(node: Node, entry: ObjectEntry, axis: AxisPlan) -> None:
    held = node.read(entry) * 1e-3
    check_rating(node.label, axis, str(entry), "current", held, axis.rig.rated_current, "A")

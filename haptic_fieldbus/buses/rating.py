"""Comparison of a drive's rated values with those of the rig: every command is scaled by them."""

from haptic_fieldbus.drive.units import RATED_TORQUE_UNITS
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.planning.axis_plan import AxisPlan

RATED_TOLERANCE = 0.02
"""Of a rated value in the rig; what a drive holds may differ by its rounding."""


def rated_torque(title: str, name: str, unit: str, held: int) -> float:
    """Return the rated torque [N·m] that the object or register `name` holds in `unit`.

    Raises BusConfigurationError for an unknown unit.
    """
    if unit not in RATED_TORQUE_UNITS:
        wrong = f"unit {unit!r} of {name} is not one of {', '.join(RATED_TORQUE_UNITS)}"
        raise BusConfigurationError(f"{title}: {wrong}")
    return held * RATED_TORQUE_UNITS[unit]


def check_rating(
    label: str, axis: AxisPlan, name: str, what: str, rated: float, expected: float | None, unit: str
) -> None:
    """Raise BusConfigurationError when the rated torque or current of a drive is not that of the rig."""
    if expected is not None and abs(rated - expected) > RATED_TOLERANCE * expected:
        in_thousandths = abs(1e3 * rated - expected) <= RATED_TOLERANCE * expected
        hint = f". Is the value in the rig in m{unit}?" if in_thousandths else ""
        raise BusConfigurationError(
            f"{label}: its rated {what} is {exactly(rated)} {unit} ({name}), the rig says {exactly(expected)} "
            f"{unit} (axis.{axis.name}.rated_{what}); every command would be off by that{hint}"
        )

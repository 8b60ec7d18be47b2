"""Limits stored in the drive that would cut the torque of a plan.

Reference: CiA 402-2, 6072h max torque, in ‰ of rated torque. Some drives are delivered with 0 or 10 % (Nanotec C5-E,
PD4-C). With such a drive everything would seem to work, but no force could be felt.
"""

import math

from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.numerals import in_unit
from haptic_fieldbus.planning.axis_plan import AxisPlan

MAX_TORQUE = ObjectEntry(0x6072, DataType.UINT16)


def check_max_torque(axis: AxisPlan, label: str, max_torque: int | None) -> None:
    """Check the drive's max torque [‰ of rated torque] against the limit of the axis; None passes: no such object.

    Raises BusConfigurationError when the drive allows less than the axis may ask for.
    """
    # The small addend keeps a ratio that is a whole number from being rounded down by its last digit.
    asked = math.floor(axis.limits.effort / axis.effort_unit + 1e-6)
    if max_torque is None or max_torque >= asked:
        return
    unit, allowed = axis.workspace.effort_unit, max_torque * axis.effort_unit
    raise BusConfigurationError(
        f"{label}: {MAX_TORQUE} is {max_torque} ‰ of rated torque ({in_unit(allowed, unit)}), the axis may ask for "
        f"{asked} ‰ ({in_unit(axis.limits.effort, unit)}): force would be cut without a word. Raise it with the "
        f"drive's own tool, or set axis.{axis.name}.limits.effort in the rig"
    )

"""Limits that stand in the drive and would cut what a plan asks for.

Reference: CiA 402-2, 6072h max torque, in ‰ of rated torque. Drives are delivered with 0 or 10 % in it (Nanotec C5-E,
PD4-C): everything would seem to work, and no force be felt.
"""

import math

from haptic_fieldbus.drive.objects import DataType, ObjectEntry
from haptic_fieldbus.errors import BusConfigurationError
from haptic_fieldbus.numerals import in_unit
from haptic_fieldbus.planning.axis_plan import AxisPlan

MAX_TORQUE = ObjectEntry(0x6072, DataType.UINT16)


def check_max_torque(axis: AxisPlan, label: str, max_torque: int | None) -> None:
    """Refuse a drive that allows less than the axis may ask for [‰ of rated torque]; None: it has no such object."""
    asked = math.floor(axis.limits.effort / axis.effort_unit + 1e-6)
    if max_torque is None or max_torque >= asked:
        return
    unit, allowed = axis.workspace.effort_unit, max_torque * axis.effort_unit
    raise BusConfigurationError(
        f"{label}: {MAX_TORQUE} is {max_torque} ‰ of rated torque ({in_unit(allowed, unit)}), the axis may ask for "
        f"{asked} ‰ ({in_unit(axis.limits.effort, unit)}): force would be cut without a word. Raise it with the "
        f"drive's own tool, or set axis.{axis.name}.limits.effort in the rig"
    )

"""Look back on an ordinary run: what its record shows of the bench on which its plan rests."""

import numpy as np

from haptic_fieldbus.assessing.loop_report import Record
from haptic_fieldbus.identification.fit import ShaftRecord
from haptic_fieldbus.planning.axis_plan import AxisPlan


def shaft_record(axis: AxisPlan, period: float, rows: Record, begin_ns: int) -> ShaftRecord:
    """Return the record of an axis at its motor shaft since `begin_ns`; missing samples are drawn as straight lines."""
    since = rows.column("t_ns") >= begin_ns
    times_ns, position, command = (
        rows.column(name)[since] for name in ("t_ns", f"{axis.name}.position", f"{axis.name}.command")
    )
    places = np.rint((times_ns - times_ns[0]) / (1e9 * period)).astype(int)
    grid, ratio = np.arange(places[-1] + 1), axis.rig.mechanism.ratio
    positions = np.interp(grid, places, position) / ratio
    torques = command[np.searchsorted(places, grid, side="right") - 1] * ratio
    return ShaftRecord(period, tuple(positions.tolist()), tuple(torques.tolist()), axis.resolution / ratio)

"""The running plan: one input image in, one output image out, once a period.

A cycle has no I/O and no clock. It works on one row of numbers, which is also the row that is recorded: the decoded
input image comes first, then what the axes compute, and last what is packed into the output image. Axes *observe* every
period (link, power state) and *render* only while all of them are in operation enabled and nothing has tripped;
otherwise every target is zero.
"""

from haptic_fieldbus.axis_cycle import AxisCycle, Row
from haptic_fieldbus.drive.image import AXIS_HEADER_FIELDS
from haptic_fieldbus.drive.power import DISABLE_VOLTAGE, PowerState
from haptic_fieldbus.planning import Plan
from haptic_fieldbus.safety import Trip
from haptic_fieldbus.signals import Signal

COMPUTED = ("position", "velocity", "force", "gain", "command")
"""Columns that an axis adds to the decoded ones."""


def decoded_columns(plan: Plan) -> tuple[str, ...]:
    """What the input image holds: `t_ns`, then `axis.quantity` for headers and mapped signals."""
    headers = [f"{axis.name}.{field}" for axis in plan.axes for field in AXIS_HEADER_FIELDS]
    mapped = [
        f"{axis.name}.{'position counts' if signal is Signal.POSITION else signal.value}"
        for axis in plan.axes
        for pdo in axis.tpdos
        for signal in pdo.signals
    ]
    return ("t_ns", *headers, *mapped)


def sent_columns(plan: Plan) -> tuple[str, ...]:
    """What the output image holds."""
    return tuple(f"{axis.name}.{signal.value}" for axis in plan.axes for pdo in axis.rpdos for signal in pdo.signals)


def columns(plan: Plan) -> tuple[str, ...]:
    """Names of a row."""
    computed = (f"{axis.name}.{name}" for axis in plan.axes for name in COMPUTED)
    return (*decoded_columns(plan), *computed, *sent_columns(plan))


class Cycle:
    """`cycle(image)` → output image (one buffer, reused); `row`, `trip`, `enabled` tell what happened."""

    def __init__(self, plan: Plan) -> None:
        self.columns = columns(plan)
        self.row: Row = [0.0] * len(self.columns)
        self.trip: Trip | None = None
        self.enabled = False
        """True while every axis is in operation enabled and nothing has tripped."""
        self.enabled_periods = 0
        self._unpack = plan.image.input.unpack_from
        self._pack = plan.image.output.pack_into
        self._output = bytearray(plan.image.output_size)
        self._decoded = len(decoded_columns(plan))
        self._first_sent = len(self.columns) - len(sent_columns(plan))
        index = {name: position for position, name in enumerate(self.columns)}
        self._axes = {axis.name: AxisCycle(self, axis, index) for axis in plan.axes}
        self._observe = tuple(axis.observe() for axis in self._axes.values())
        self._render = tuple(axis.render(plan.period) for axis in self._axes.values())
        self._controlwords = tuple(index[f"{name}.{Signal.CONTROLWORD.value}"] for name in self._axes)
        self._targets = tuple(index[f"{name}.{Signal.TARGET_TORQUE.value}"] for name in self._axes)

    def __call__(self, image: bytes | bytearray) -> bytearray:
        """One period; after a trip the output stays torque-free."""
        row = self.row
        row[: self._decoded] = self._unpack(image)
        for observe in self._observe:
            observe()
        if self.enabled:
            self.enabled_periods += 1
            for render in self._render:
                render()
        if not self.enabled:
            self._release(row)
        self._pack(self._output, 0, *row[self._first_sent :])
        return self._output

    def power_state(self, axis: str) -> PowerState:
        """The last power state that the drive of an axis reported."""
        return self._axes[axis].state.power

    def zero_counts(self, axis: str) -> int:
        """The encoder count at which the handle's position is zero; 0 before the first enabled period."""
        return self._axes[axis].state.zero_counts or 0

    def update_enabled(self) -> None:
        """After a power state changed."""
        states = [axis.state.power for axis in self._axes.values()]
        self.enabled = self.trip is None and all(state is PowerState.OPERATION_ENABLED for state in states)

    def _release(self, row: Row) -> None:
        """No torque; after a trip no voltage either."""
        for target in self._targets:
            row[target] = 0
        if self.trip is not None:
            for controlword in self._controlwords:
                row[controlword] = DISABLE_VOLTAGE

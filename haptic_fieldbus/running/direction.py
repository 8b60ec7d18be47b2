"""The direction of an axis, shown by a person before the drive is enabled for the first time.

With a reversed encoder *and* a reversed motor, torque and motion agree: no loop can tell this bench from a correct one,
but a wall on the right is felt on the left. Only a person who sees the handle can tell. So at the first start of a rig
on a real bus a person moves each handle to the positive side, while the drives are off. The rig file keeps the result
in `[axis.NAME.seen]`.
"""

from collections.abc import Callable, Iterator
from datetime import datetime

from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.documents.edits import Value, write_table
from haptic_fieldbus.errors import Fault, RigError, UsageError
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import EMERGENCY, FLAGS, STATUSWORD, AxisImage
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.loop import check_link, started
from haptic_fieldbus.signals import LinkFlag, Signal, Workspace

ENOUGH = {Workspace.LINEAR: 0.01, Workspace.ROTARY: 0.2}
"""Required motion [m or rad]; too large for an accidental one."""
FEWEST_COUNTS = 3
PATIENCE = 60.0
"""Longest time to wait for a person [s]."""
SHOWN_EVERY = 0.1
"""Time between two lines about the position [s]."""
INT32, HALF_TURN = 0x1_0000_0000, 0x8000_0000

Instruct = Callable[[str], None]


def confirm_direction(plan: Plan, bus: Bus, clock: Clock, instruct: Instruct | None, ending: EndSignals) -> list[str]:
    """Let a person show the direction of each axis whose rig does not have it; return the sentences about it.

    The bus must be inspected; the drives stay off, and are stopped before the rig file is written, because a disk may
    take longer than the watchdog time. Raises UsageError if the handle is not moved, RigError when positions fall on
    the way to the positive side, KeyboardInterrupt after a signal, and the error of a faulty link.
    """
    due = [axis for axis in plan.axes if axis.rig.seen.direction is None]
    if instruct is None or not plan.rig.source:
        return [
            f"axis {axis.name}: positive direction not confirmed by a person. Start once with a rig file at a "
            "terminal, without --yes, and move the handle when asked"
            for axis in due
        ]
    if not due:
        return []
    with started(plan, bus, ending):
        exchange = _WayExchange(plan, bus, clock, ending)
        for axis in due:
            _show(axis, plan, exchange, instruct)
    return [warning for axis in due for warning in _kept(axis, plan)]


def _show(axis: AxisPlan, plan: Plan, exchange: "_WayExchange", instruct: Instruct) -> None:
    """Wait until the handle was moved far enough, and check the direction."""
    unit = axis.workspace.length_unit
    enough = max(ENOUGH[axis.workspace], FEWEST_COUNTS * axis.resolution)
    every = max(1, round(SHOWN_EVERY * plan.rate))
    for number, way in enumerate(exchange.ways(axis)):
        if number % every == 0:
            instruct(
                f"axis {axis.name} is off: move the handle {rounded(1e3 * enough)} m{unit} to the positive "
                f"side; it is at {round(1e3 * way)} m{unit}"
            )
        if abs(way) >= enough:
            instruct("\n")
            break
    else:
        raise UsageError(
            f"not enabled: the handle of axis {axis.name} did not move within {PATIENCE:g} s. Move it to the positive "
            "side when asked, or start with --yes, which leaves the direction unconfirmed"
        )
    if way < 0.0:
        message = (
            f"the handle moved to the positive side, but its position fell by {in_unit(-way, unit)}. If this side is "
            f"to be positive, write sign = {-axis.rig.mechanism.sign}"
        )
        raise RigError(plan.rig.source, [Fault(f"axis.{axis.name}.mechanism.sign", message)])


def _kept(axis: AxisPlan, plan: Plan) -> Iterator[str]:
    """Write the shown direction into the rig file; yield a sentence if it cannot be written."""
    values: dict[str, Value] = {} if axis.rig.seen.sign is None else {"sign": axis.rig.seen.sign}
    values |= {"direction": "confirmed", "date": datetime.now().astimezone().isoformat(timespec="seconds")}
    if why := write_table(plan.rig.source, ("axis", axis.name, "seen"), values):
        yield f"axis {axis.name}: the confirmed direction was not saved in {plan.rig.source}: {why}"


class _WayExchange:
    """The exchange of the loop with drives that stay off."""

    def __init__(self, plan: Plan, bus: Bus, clock: Clock, ending: EndSignals) -> None:
        self._plan, self._bus, self._clock, self._ending = plan, bus, clock, ending
        self._deadline_ns = clock.now_ns()
        self._output = bytearray(plan.image.output_size)
        for axis, image in zip(plan.axes, plan.image.axes, strict=True):
            image.output.pack_into(self._output, image.outputs[0], axis.power.off, 0)

    def ways(self, axis: AxisPlan) -> Iterator[float]:
        """Yield the travel of the handle of an axis since the first sample [m or rad], once a period."""
        image = self._plan.image.axes[self._plan.axes.index(axis)]
        signal = Signal.VELOCITY if axis.integrates else Signal.POSITION
        place = STATUSWORD + [mapped.signal for mapped in axis.incoming].index(signal)
        first: int | None = None
        way = 0.0
        for _ in range(round(PATIENCE * self._plan.rate)):
            reading = self._read(axis, image, place)
            if reading is not None and axis.integrates:
                way += reading * axis.velocity_unit * self._plan.period
            elif reading is not None:
                first = reading if first is None else first
                way = ((reading - first + HALF_TURN) % INT32 - HALF_TURN) * axis.position_unit
            yield way

    def _read(self, axis: AxisPlan, image: AxisImage, place: int) -> int | None:
        """Go through one period; return the reading, None without new feedback."""
        self._clock.sleep_until(self._deadline_ns)
        if self._ending.signal is not None:
            raise KeyboardInterrupt
        # A computer that was late goes on from now, because nothing here depends on the time of a period.
        self._deadline_ns = max(self._deadline_ns, self._clock.now_ns()) + self._plan.period_ns
        feedback = image.input.unpack_from(self._bus.read(self._deadline_ns))
        self._bus.write(self._output)
        flags = feedback[FLAGS]
        check_link(axis, flags, feedback[EMERGENCY], "before enabling. No torque was applied")
        return None if flags & LinkFlag.STALE else feedback[place]

"""One axis of a running plan, as closures over its feedback: *observe* every period, *render* while force is permitted.

Each is a straight line for the period in which nothing is wrong; whatever is out of the ordinary is a call on the side.
Between the two `sense` works out what else the scene needs, where it needs anything beside positions.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from haptic_fieldbus.cycle.laws import READERS, Field, blended, field_of, summed
from haptic_fieldbus.cycle.safety import Permission, Trip, TripKind, bind_hold, bind_limiter
from haptic_fieldbus.cycle.sensing import Step, bind_sense, in_order
from haptic_fieldbus.cycle.state import AxisState, Sensed
from haptic_fieldbus.cycle.watch import FLAGS, STATUSWORD, T_NS, Watch
from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import AXIS_HEADER_FIELDS, AxisImage
from haptic_fieldbus.planning.limits import START_SHARE
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.signals import Signal

Observe = Callable[[bytes | bytearray], None]

FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
HALF_TURN_OF_INT32, INT32 = 0x8000_0000, 0xFFFF_FFFF
POSITION_COUNTS = STATUSWORD + 1
"""Place of the position in the feedback of an axis whose drive offers one."""
VELOCITY_READING = STATUSWORD + 1
"""Place of the velocity in the feedback of an axis whose drive offers no position."""
COMPUTED = ("position", "velocity", "force", "gain", "command")
"""Columns that an axis adds to the decoded ones."""


class Owner(Protocol):
    """The cycle, as far as its axes know it."""

    trip: Trip | None
    enabled: bool

    def update_enabled(self) -> None: ...


class AxisCycle:
    """Binds one axis of a plan; `output` is the output image of all axes."""

    def __init__(self, owner: Owner, axis: AxisPlan, image: AxisImage, output: bytearray, period: float) -> None:
        self.state, self.sensed, self.permission = AxisState(), Sensed(), Permission()
        self.stalls = 0
        """How often counts stood still under torque for so long that the limit fell."""
        self._owner, self._axis, self._period = owner, axis, period
        self._watch = Watch(axis, self.state, period, self._trip)
        self._image, self._output = image, output
        self._feedback: tuple[int, ...] = (0,) * (1 + len(AXIS_HEADER_FIELDS) + len(axis.incoming))
        self.observe = self._bind_observe_velocity() if axis.integrates else self._bind_observe()
        self.sense, self._step_estimator = bind_sense(axis, self.state, self.sensed, lambda: self._feedback, period)
        """Works out velocity, time and torque, once a period; None where the scene needs none of them."""
        self._fields = [self.field_of(element) for element in axis.elements]
        """One for each element in their order; the couplings, where the axis has any, stand last."""
        if axis.couplings:
            self._fields.append(lambda position: self.sensed.coupled)
        self._field = summed(self._fields)
        self.render = self._bind_render()

    @property
    def feedback(self) -> tuple[int, ...]:
        """What was decoded last; its first is t_ns."""
        return self._feedback

    def row(self) -> tuple[float, ...]:
        """The columns of this axis: what was decoded, `COMPUTED`, and what was sent."""
        state, unit = self.state, self._axis.effort_unit
        computed = (state.position, self.sensed.velocity, state.force, state.gain, state.target * unit)
        return (*self._feedback[1:], *computed, state.controlword, self._axis.rig.mechanism.sign * state.target)

    def begin(self) -> None:
        """The first rendered period: where zero is, and where the handle is then."""
        counts = self._feedback[POSITION_COUNTS]
        zero = self._axis.rig.mechanism.zero
        self.state.began_ns = self.state.moved_ns = self._feedback[T_NS]
        if self._axis.integrates:
            self._follow(self._feedback[T_NS], counts)
            self.state.zero_counts = 0
            return
        self.state.zero_counts = counts if zero == "start" else zero
        self.state.position = (counts - self.state.zero_counts) * self._axis.position_unit

    def check_start(self) -> None:
        """After the first force: one that is large already would throw the handle as soon as it is permitted."""
        largest = START_SHARE * self._axis.limits.effort
        if abs(self.state.force) > largest:
            self._trip(TripKind.START_FORCE, self.state.force, largest)

    def release(self, *, tripped: bool) -> None:
        """No torque; after a trip no voltage either."""
        self.state.target = 0
        if tripped:
            self.state.controlword = self._axis.power.off
        self._image.output.pack_into(self._output, self._image.outputs[0], self.state.controlword, 0)

    def field_of(self, element: Element) -> Field:
        """A fresh law of an element that needs no signal beyond those of the plan; made in any thread."""
        return field_of(element, self._period, self._axis.method, self.sensed)

    def exchange(self, fields: Mapping[int, Field], periods: int) -> None:
        """Go over to other fields at these places within so many periods; the others go on as they are."""
        for place, field in fields.items():
            self._fields[place] = blended(self._fields[place], field, periods)
        self._field = summed(self._fields)

    def reader(self, needs: Sequence[Signal]) -> Callable[[], list[float]]:
        """Reads the signals that a coupling needs of this axis, in their order."""
        state, sensed, readers = self.state, self.sensed, [READERS[signal] for signal in needs]
        return lambda: [read(state.position, sensed) for read in readers]

    def _trip(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        if self._owner.trip is None:
            self._owner.trip = Trip(kind, self._axis.name, self._feedback[T_NS], value, limit, detail)
            self._owner.enabled = False

    def _bind_observe(self) -> Observe:
        """Decode; link flags and statusword, which act only when not as in the period before; counts → position."""
        state, axis, owner, watch = self.state, self._axis, self._owner, self._watch
        unpack, power = self._image.input.unpack_from, self._power
        unit, mask = axis.position_unit, axis.power.mask
        lowest, highest = axis.limits.position or (-math.inf, math.inf)
        largest_way = axis.limits.speed * self._period + abs(unit)
        jump = axis.limits.jump(self._period, abs(unit))
        shortest, longest = _in_time(self._period)
        bits_before, fresh_ns = -1, 0

        def observe(image: bytes | bytearray) -> None:
            nonlocal bits_before, fresh_ns
            self._feedback = feedback = unpack(image)
            elapsed_ns = feedback[T_NS] - fresh_ns
            state.steps = steps = (
                1
                if shortest < elapsed_ns < longest and not feedback[FLAGS] and not state.missing
                else watch.link(feedback, elapsed_ns, owner.enabled)
            )
            bits = feedback[STATUSWORD] & mask
            if bits != bits_before:
                bits_before = bits
                power()
            if not steps:
                return
            fresh_ns = feedback[T_NS]
            zero = state.zero_counts
            if zero is not None:
                counts = feedback[POSITION_COUNTS] - zero
                if not -HALF_TURN_OF_INT32 <= counts < HALF_TURN_OF_INT32:
                    counts = (counts + HALF_TURN_OF_INT32 & INT32) - HALF_TURN_OF_INT32
                here = counts * unit
                way = here - state.position
                if (
                    steps != 1
                    or not (-largest_way <= way <= largest_way and lowest <= here <= highest)
                    or not -jump <= way - state.way <= jump
                ):
                    watch.motion(here, way, elapsed_ns)
                if way:
                    state.moved_ns = fresh_ns
                if steps != 1:
                    self._catch_up(here, steps)
                state.way = way / steps
                state.position = here

        return observe

    def _bind_observe_velocity(self) -> Observe:
        """The same for a drive that offers velocity only: velocity → position."""
        from haptic_fieldbus.cycle.tachometer import bind_follow

        state, owner, watch = self.state, self._owner, self._watch
        unpack, power = self._image.input.unpack_from, self._power
        mask = self._axis.power.mask
        follow = self._follow = bind_follow(self._axis, state, self.sensed, self._period, self._trip)
        shortest, longest = _in_time(self._period)
        bits_before, fresh_ns = -1, 0

        def observe(image: bytes | bytearray) -> None:
            nonlocal bits_before, fresh_ns
            self._feedback = feedback = unpack(image)
            elapsed_ns = feedback[T_NS] - fresh_ns
            state.steps = steps = (
                1
                if shortest < elapsed_ns < longest and not feedback[FLAGS] and not state.missing
                else watch.link(feedback, elapsed_ns, owner.enabled)
            )
            bits = feedback[STATUSWORD] & mask
            if bits != bits_before:
                bits_before = bits
                power()
            if steps:
                fresh_ns = feedback[T_NS]
            if state.zero_counts is not None:
                before = state.position
                follow(feedback[T_NS], feedback[VELOCITY_READING])
                if state.position != before:
                    state.moved_ns = feedback[T_NS]
                if steps > 1:
                    here, state.position = state.position, before
                    self._catch_up(here, steps)
                    state.position = here

        return observe

    def _catch_up(self, here: float, steps: int) -> None:
        """Let what remembers go through the periods that lie between two samples, along a straight line to `here`.

        Virtual states and estimators advance by one period a call; left at that, they would take the whole way for
        that of one period. Estimators that take time stamps see the gap by themselves.
        """
        state = self.state
        if not self._owner.enabled:
            return
        before = state.position
        for step in range(1, steps):
            state.position = before + (here - before) * step / steps
            if self._step_estimator is not None:
                self._step_estimator()
            self._field(state.position)

    def _power(self) -> None:
        """Statusword → power state → the controlword that asks for the next transition."""
        state, statusword = self.state, self._feedback[STATUSWORD]
        table = self._axis.power
        before, state.power = state.power, table.state(statusword)
        state.controlword = table.answer(state.power)
        if state.power in FAULT_STATES:
            self._trip(TripKind.DRIVE_FAULT, statusword, detail=state.power.value)
        elif before is PowerState.OPERATION_ENABLED is not state.power:
            self._trip(TripKind.DRIVE_DISABLED, statusword, detail=state.power.value)
        self._owner.update_enabled()

    def _bind_render(self) -> Step:
        """Position → force → permitted force → target torque; without new feedback the torque is held, then fades."""
        state, axis, permission, trip = self.state, self._axis, self.permission, self._trip
        effort_unit, sign = axis.effort_unit, axis.rig.mechanism.sign
        limit, hold = (
            bind_limiter(axis.limits, self._period, permission, effort_unit),
            bind_hold(self._period, permission),
        )
        pack_into, output, offset = self._image.output.pack_into, self._output, self._image.outputs[0]

        def render() -> None:
            if state.steps:
                state.force = force = self._field(state.position)
                permitted = limit(force)
            else:
                permitted = hold(state.missing)
                state.gain = permitted / permission.held if permission.held else 1.0
            if permitted != permitted:
                trip(TripKind.NOT_FINITE, state.force)
                return
            state.target = target = round(permitted / effort_unit)
            pack_into(output, offset, state.controlword, sign * target)

        guards = self._guards()
        return in_order((render, *guards)) if guards else render

    def _guards(self) -> list[Step]:
        """What must be looked at with the permitted torque known, each only where it is limited."""
        guards: list[Step] = []
        if math.isfinite(self._axis.limits.power):
            guards.append(self._check_power)
        if math.isfinite(self._axis.limits.stall):
            guards.append(self._check_stall)
        return guards

    def _check_power(self) -> None:
        state, limit = self.state, self._axis.limits.power
        power = state.target * self._axis.effort_unit * state.way / self._period
        if power > limit:
            self._trip(TripKind.POWER, power, limit)

    def _check_stall(self) -> None:
        """Counts that stood still under torque for long: a hand that leans, or an encoder that lies; less will do."""
        state, limits = self.state, self._axis.limits
        if (self._feedback[T_NS] - state.moved_ns) * 1e-9 < limits.stall:
            return
        effort = state.target * self._axis.effort_unit
        if abs(effort) > limits.holding and self.permission.cap > limits.holding:
            self.permission.cap_at(limits.holding, math.copysign(1.0, effort))
            self.stalls += 1


def _in_time(period: float) -> tuple[int, int]:
    """Between which times [ns] after the last one a sample belongs to the next period."""
    return round(0.5e9 * period), round(1.5e9 * period)

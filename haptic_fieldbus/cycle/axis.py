"""One axis of a running plan, as closures over its feedback: *observe* every period, *render* while force is permitted.

Each is a straight line for the period in which nothing is wrong; whatever is out of the ordinary is a call on the side.
Between the two `sense` works out what else the scene needs, where it needs anything beside positions.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from haptic_fieldbus.cycle.laws import READERS, Field, blended, field_of, summed
from haptic_fieldbus.cycle.safety import LINK_TRIPS, Trip, TripKind, bind_limiter, hold_gain
from haptic_fieldbus.cycle.state import AxisState, Sensed
from haptic_fieldbus.defaults import DEFAULT_ESTIMATOR
from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import AXIS_HEADER_FIELDS, AxisImage
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.signals import LinkFlag, Signal

PeriodStep = Callable[[], None]
Observe = Callable[[bytes | bytearray], None]

FAULT_STATES = (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)
HALF_TURN_OF_INT32, INT32 = 0x8000_0000, 0xFFFF_FFFF
T_NS, AGE_NS, FLAGS, EMERGENCY, STATUSWORD = range(2 + len(AXIS_HEADER_FIELDS))
"""Places in the feedback of an axis; what else is mapped follows (`_place`)."""
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
        self.state, self.sensed = AxisState(), Sensed()
        self._owner, self._axis, self._period = owner, axis, period
        self._image, self._output = image, output
        self._feedback: tuple[int, ...] = (0,) * (1 + len(AXIS_HEADER_FIELDS) + len(axis.incoming))
        self.observe = self._bind_observe_velocity() if axis.integrates else self._bind_observe()
        self.sense = self._bind_sense()
        """Works out velocity, time and torque, once a period; None where the scene needs none of them."""
        self._fields = [self.field_of(element) for element in axis.elements]
        """One for each element in their order; the couplings, where the axis has any, stand last."""
        if axis.couplings:
            self._fields.append(lambda position: self.sensed.coupled)
        self.render, self._exchange = self._bind_render()

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
        self.state.began_ns, self.state.begun = self._feedback[T_NS], True
        if self._axis.integrates:
            self._follow(self._feedback[T_NS], self._feedback[self._place(Signal.VELOCITY)])
            return
        counts, zero = self._feedback[self._place(Signal.POSITION)], self._axis.rig.mechanism.zero
        self.state.zero_counts = counts if zero == "start" else zero
        self.state.position = (counts - self.state.zero_counts) * self._axis.position_unit

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
        self._exchange(summed(self._fields))

    def reader(self, needs: Sequence[Signal]) -> Callable[[], list[float]]:
        """Reads the signals that a coupling needs of this axis, in their order."""
        state, sensed, readers = self.state, self.sensed, [READERS[signal] for signal in needs]
        return lambda: [read(state.position, sensed) for read in readers]

    def _trip(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        if self._owner.trip is None:
            self._owner.trip = Trip(kind, self._axis.name, self._feedback[T_NS], value, limit, detail)
            self._owner.enabled = False

    def _place(self, signal: Signal) -> int:
        """Where a mapped signal stands in the feedback."""
        return STATUSWORD + [mapped.signal for mapped in self._axis.incoming].index(signal)

    def _bind_observe(self) -> Observe:
        """Decode; link flags and statusword, which act only when not as in the period before; counts → position."""
        state, axis, unpack, link, power, check = (
            self.state,
            self._axis,
            self._image.input.unpack_from,
            self._link,
            self._power,
            self._check_motion,
        )
        unit, mask, place = axis.position_unit, axis.power.mask, self._place(Signal.POSITION)
        lowest, highest = axis.limits.position or (-math.inf, math.inf)
        largest_way = axis.limits.speed * self._period + abs(unit)
        bits_before = -1

        def observe(image: bytes | bytearray) -> None:
            nonlocal bits_before
            self._feedback = feedback = unpack(image)
            if feedback[FLAGS] or not state.settled:
                link()
            bits = feedback[STATUSWORD] & mask
            if bits != bits_before:
                bits_before = bits
                power()
            zero = state.zero_counts
            if zero is not None:
                counts = feedback[place] - zero
                if not -HALF_TURN_OF_INT32 <= counts < HALF_TURN_OF_INT32:
                    counts = (counts + HALF_TURN_OF_INT32 & INT32) - HALF_TURN_OF_INT32
                here = counts * unit
                if not (-largest_way <= here - state.position <= largest_way and lowest <= here <= highest):
                    check(here, abs(here - state.position))
                state.position = here

        return observe

    def _bind_observe_velocity(self) -> Observe:
        """The same for a drive that offers velocity only: velocity → position."""
        from haptic_fieldbus.cycle.tachometer import bind_follow

        state, unpack, link, power = self.state, self._image.input.unpack_from, self._link, self._power
        mask, place = self._axis.power.mask, self._place(Signal.VELOCITY)
        follow = self._follow = bind_follow(self._axis, state, self.sensed, self._period, self._trip)
        bits_before = -1

        def observe(image: bytes | bytearray) -> None:
            nonlocal bits_before
            self._feedback = feedback = unpack(image)
            if feedback[FLAGS] or not state.settled:
                link()
            bits = feedback[STATUSWORD] & mask
            if bits != bits_before:
                bits_before = bits
                power()
            if state.begun:
                follow(feedback[T_NS], feedback[place])

        return observe

    def _link(self) -> None:
        """Staleness and faults of the link: hold one period, fade the second, stop at the third."""
        state, feedback = self.state, self._feedback
        flags = feedback[FLAGS]
        for flag, kind in LINK_TRIPS.items():
            if flags & flag:
                self._trip(kind, feedback[EMERGENCY])
        state.periods_apart = state.stale_periods + 1
        state.stale_periods = state.stale_periods + 1 if flags & LinkFlag.STALE else 0
        state.settled = state.stale_periods == 0 and state.periods_apart == 1
        gain = hold_gain(state.stale_periods)
        if gain is None and self._owner.enabled:
            self._trip(TripKind.FEEDBACK_LOST, feedback[AGE_NS] * 1e-9)
        state.gain = gain or 0.0

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

    def _check_motion(self, here: float, moved: float) -> None:
        """Called when the handle seems to be too fast, or outside; after held periods a longer way is allowed."""
        limits = self._axis.limits
        largest_way = limits.speed * self._period + abs(self._axis.position_unit)
        lowest, highest = limits.position or (-math.inf, math.inf)
        if moved > largest_way * self.state.periods_apart:
            self._trip(TripKind.SPEED, moved / self._period, limits.speed)
        if not lowest <= here <= highest:
            self._trip(TripKind.POSITION, here, lowest if here < lowest else highest)

    def _bind_sense(self) -> PeriodStep | None:
        """Only what the scene needs is worked out, and an estimator imported only where one is."""
        needs, state, sensed = self._axis.needs, self.state, self.sensed
        steps: list[PeriodStep] = []
        if Signal.VELOCITY in needs and not self._axis.integrates:
            estimate = self._estimator()

            def velocity() -> None:
                sensed.velocity = estimate(state.position)

            steps.append(velocity)
        if Signal.ELAPSED_NS in needs:

            def elapsed() -> None:
                sensed.elapsed_ns = self._feedback[T_NS] - state.began_ns

            steps.append(elapsed)
        if Signal.TORQUE_ACTUAL in needs:
            unit = self._axis.effort_unit * self._axis.rig.mechanism.sign
            place = self._place(Signal.TORQUE_ACTUAL)

            def torque() -> None:
                sensed.torque_actual = self._feedback[place] * unit

            steps.append(torque)
        if len(steps) < 2:
            return steps[0] if steps else None

        def sense() -> None:
            for step in steps:
                step()

        return sense

    def _estimator(self) -> Callable[[float], float]:
        from haptic_fieldbus.numerics.estimators import bind, is_timed

        name = self._axis.estimator or DEFAULT_ESTIMATOR
        estimate = bind(name, self._period, self._axis.resolution)
        return (lambda position: estimate(position, self._feedback[T_NS])) if is_timed(name) else estimate

    def _bind_render(self) -> tuple[PeriodStep, Callable[[Field], None]]:
        """Position → force → permitted force → target torque; and what exchanges the field that it renders."""
        state, axis, trip = self.state, self._axis, self._trip
        field, limit = summed(self._fields), bind_limiter(axis.limits, self._period)
        pack_into, output, offset = self._image.output.pack_into, self._output, self._image.outputs[0]
        effort_unit, sign = axis.effort_unit, axis.rig.mechanism.sign

        def render() -> None:
            state.force = force = field(state.position)
            permitted = limit(force)
            if permitted != permitted:
                trip(TripKind.NOT_FINITE, force)
                return
            state.target = target = round(permitted * state.gain / effort_unit)
            pack_into(output, offset, state.controlword, sign * target)

        def exchange(after: Field) -> None:
            nonlocal field
            field = after

        return render, exchange

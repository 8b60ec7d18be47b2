"""One axis of a running plan, as three closures over its feedback, called in this order in each period.

`observe` runs every period: it decodes the input image and follows link, power state and position. `sense` and
`render` run only while force is permitted: `sense` derives velocity, time and torque actual, as far as the scene needs
them; `render` computes and encodes the target torque. Each closure is a straight line for a period in which nothing is
wrong. A link flag, a changed statusword or a motion beyond the limits is handled by a separate call.
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
"""Half the range and the mask of the INT32 position actual value, which wraps around."""
T_NS, AGE_NS, FLAGS, EMERGENCY, STATUSWORD = range(2 + len(AXIS_HEADER_FIELDS))
"""Indices into the decoded feedback of an axis; the mapped signals follow (`_place`)."""
COMPUTED = ("position", "velocity", "force", "gain", "command")
"""Columns of a row that the axis computes; they follow the decoded ones."""


class Owner(Protocol):
    """The part of a cycle that its axes use."""

    trip: Trip | None
    enabled: bool

    def update_enabled(self) -> None: ...


class AxisCycle:
    """One axis of a running plan; `output` is the output image, shared by all axes."""

    def __init__(self, owner: Owner, axis: AxisPlan, image: AxisImage, output: bytearray, period: float) -> None:
        self.state, self.sensed = AxisState(), Sensed()
        self._owner, self._axis, self._period = owner, axis, period
        self._image, self._output = image, output
        self._feedback: tuple[int, ...] = (0,) * (1 + len(AXIS_HEADER_FIELDS) + len(axis.incoming))
        self.observe = self._bind_observe_velocity() if axis.integrates else self._bind_observe()
        self.sense = self._bind_sense()
        """Step that updates velocity, time and torque actual, once a period; None when the scene needs none of them."""
        self._fields = [self.field_of(element) for element in axis.elements]
        """Force field of each element in order; the sum of all couplings is the last field, if the axis has any."""
        if axis.couplings:
            # The cycle adds up the couplings before any axis renders, so their field only reads the sum.
            self._fields.append(lambda position: self.sensed.coupled)
        self.render, self._exchange = self._bind_render()

    @property
    def feedback(self) -> tuple[int, ...]:
        """Feedback decoded last; its first value is t_ns."""
        return self._feedback

    def row(self) -> tuple[float, ...]:
        """Return the columns of this axis: decoded values without t_ns, `COMPUTED`, controlword and target torque."""
        state, unit = self.state, self._axis.effort_unit
        computed = (state.position, self.sensed.velocity, state.force, state.gain, state.target * unit)
        return (*self._feedback[1:], *computed, state.controlword, self._axis.rig.mechanism.sign * state.target)

    def begin(self) -> None:
        """Set the zero and the position of the handle, in the first rendered period."""
        self.state.began_ns, self.state.begun = self._feedback[T_NS], True
        if self._axis.integrates:
            self._follow(self._feedback[T_NS], self._feedback[self._place(Signal.VELOCITY)])
            return
        counts, zero = self._feedback[self._place(Signal.POSITION)], self._axis.rig.mechanism.zero
        self.state.zero_counts = counts if zero == "start" else zero
        self.state.position = (counts - self.state.zero_counts) * self._axis.position_unit

    def release(self, *, tripped: bool) -> None:
        """Encode target torque 0; after a trip also the controlword that disables the voltage."""
        self.state.target = 0
        if tripped:
            self.state.controlword = self._axis.power.off
        self._image.output.pack_into(self._output, self._image.outputs[0], self.state.controlword, 0)

    def field_of(self, element: Element) -> Field:
        """Return a fresh force field of `element`, which needs no signal beyond those of the plan.

        May be called from any thread.
        """
        return field_of(element, self._period, self._axis.method, self.sensed)

    def exchange(self, fields: Mapping[int, Field], periods: int) -> None:
        """Replace the fields at these places along a ramp of `periods`; the other fields keep their state."""
        for place, field in fields.items():
            self._fields[place] = blended(self._fields[place], field, periods)
        self._exchange(summed(self._fields))

    def reader(self, needs: Sequence[Signal]) -> Callable[[], list[float]]:
        """Return a function that reads the signals `needs` of this axis, in their order."""
        state, sensed, readers = self.state, self.sensed, [READERS[signal] for signal in needs]
        return lambda: [read(state.position, sensed) for read in readers]

    def _trip(self, kind: TripKind, value: float, limit: float | None = None, detail: str = "") -> None:
        """Record the first trip of the run and withdraw the permission; later trips are ignored."""
        if self._owner.trip is None:
            self._owner.trip = Trip(kind, self._axis.name, self._feedback[T_NS], value, limit, detail)
            self._owner.enabled = False

    def _place(self, signal: Signal) -> int:
        """Where a mapped signal stands in the feedback."""
        return STATUSWORD + [mapped.signal for mapped in self._axis.incoming].index(signal)

    def _bind_observe(self) -> Observe:
        """Return `observe` for a drive that offers its position: decode, check link and power state, counts → position.

        The power state is evaluated only when a bit of the statusword that it depends on has changed.
        """
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
        # Rounding to counts adds up to one count to the difference of two positions.
        largest_way = axis.limits.speed * self._period + abs(unit)
        bits_before = -1  # differs from every statusword, so that the first one is evaluated

        def observe(image: bytes | bytearray) -> None:
            nonlocal bits_before
            self._feedback = feedback = unpack(image)
            # After a gap `link` is needed once more without any flag, to restore the gain.
            if feedback[FLAGS] or not state.settled:
                link()
            bits = feedback[STATUSWORD] & mask
            if bits != bits_before:
                bits_before = bits
                power()
            zero = state.zero_counts
            if zero is not None:
                counts = feedback[place] - zero
                # The encoder may wrap around between zero and here; the difference modulo 2³² is still right.
                if not -HALF_TURN_OF_INT32 <= counts < HALF_TURN_OF_INT32:
                    counts = (counts + HALF_TURN_OF_INT32 & INT32) - HALF_TURN_OF_INT32
                here = counts * unit
                if not (-largest_way <= here - state.position <= largest_way and lowest <= here <= highest):
                    check(here, abs(here - state.position))
                state.position = here

        return observe

    def _bind_observe_velocity(self) -> Observe:
        """Return `observe` for a drive that offers velocity only, from which the position is integrated."""
        from haptic_fieldbus.cycle.tachometer import bind_follow  # a drive with a position does without it

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
                follow(feedback[T_NS], feedback[place])  # here the velocity reading

        return observe

    def _link(self) -> None:
        """Evaluate the link flags: trip on a fault; without feedback hold one period, fade the second, then trip."""
        state, feedback = self.state, self._feedback
        flags = feedback[FLAGS]
        for flag, kind in LINK_TRIPS.items():
            if flags & flag:
                self._trip(kind, feedback[EMERGENCY])
        # Before `stale_periods` changes: in the first fresh period it still holds the length of the gap.
        state.periods_apart = state.stale_periods + 1
        state.stale_periods = state.stale_periods + 1 if flags & LinkFlag.STALE else 0
        state.settled = state.stale_periods == 0 and state.periods_apart == 1
        gain = hold_gain(state.stale_periods)
        # Before operation enabled there is no torque to take away.
        if gain is None and self._owner.enabled:
            self._trip(TripKind.FEEDBACK_LOST, feedback[AGE_NS] * 1e-9)
        state.gain = gain or 0.0

    def _power(self) -> None:
        """Derive the power state from the statusword, and the controlword that requests the next transition.

        Trips on a fault state, and when the drive leaves operation enabled.
        """
        state, statusword = self.state, self._feedback[STATUSWORD]
        table = self._axis.power
        before, state.power = state.power, table.state(statusword)
        state.controlword = table.answer(state.power)
        if state.power in FAULT_STATES:
            self._trip(TripKind.DRIVE_FAULT, statusword, detail=state.power.value)
        # A chained comparison: it was operation enabled, and is not any more.
        elif before is PowerState.OPERATION_ENABLED is not state.power:
            self._trip(TripKind.DRIVE_DISABLED, statusword, detail=state.power.value)
        self._owner.update_enabled()

    def _check_motion(self, here: float, moved: float) -> None:
        """Trip when the handle is too fast or outside its position limits; `moved` [m or rad] is its last step.

        After periods without feedback the permitted way is that of the whole gap.
        """
        limits = self._axis.limits
        largest_way = limits.speed * self._period + abs(self._axis.position_unit)
        lowest, highest = limits.position or (-math.inf, math.inf)
        if moved > largest_way * self.state.periods_apart:
            self._trip(TripKind.SPEED, moved / self._period, limits.speed)
        if not lowest <= here <= highest:
            self._trip(TripKind.POSITION, here, lowest if here < lowest else highest)

    def _bind_sense(self) -> PeriodStep | None:
        """Return the step that derives the signals needed beside position; None when the scene needs none."""
        needs, state, sensed = self._axis.needs, self.state, self.sensed
        steps: list[PeriodStep] = []
        if Signal.VELOCITY in needs and not self._axis.integrates:
            estimate = self._estimator()

            def velocity() -> None:
                sensed.velocity = estimate(state.position)

            steps.append(velocity)
        if Signal.ELAPSED_NS in needs:

            def elapsed() -> None:  # whole nanoseconds, so that a wave keeps its exact phase
                sensed.elapsed_ns = self._feedback[T_NS] - state.began_ns

            steps.append(elapsed)
        if Signal.TORQUE_ACTUAL in needs:
            unit = self._axis.effort_unit * self._axis.rig.mechanism.sign
            # Both lists are in the order of the cycle, in which the statusword is the first signal.
            place = self._place(Signal.TORQUE_ACTUAL)

            def torque() -> None:
                sensed.torque_actual = self._feedback[place] * unit

            steps.append(torque)
        if len(steps) < 2:  # a single step is called directly, without a loop
            return steps[0] if steps else None

        def sense() -> None:
            for step in steps:
                step()

        return sense

    def _estimator(self) -> Callable[[float], float]:
        """Return a fresh velocity estimator: position [m or rad] → velocity [m/s or rad/s]."""
        # Imported here, because a scene without velocity needs no estimator.
        from haptic_fieldbus.numerics.estimators import bind, is_timed

        name = self._axis.estimator or DEFAULT_ESTIMATOR
        estimate = bind(name, self._period, self._axis.resolution)
        return (lambda position: estimate(position, self._feedback[T_NS])) if is_timed(name) else estimate

    def _bind_render(self) -> tuple[PeriodStep, Callable[[Field], None]]:
        """Return `render` (position → force → permitted force → target torque), and a function that sets its field."""
        state, axis, trip = self.state, self._axis, self._trip
        field, limit = summed(self._fields), bind_limiter(axis.limits, self._period)
        pack_into, output, offset = self._image.output.pack_into, self._output, self._image.outputs[0]
        effort_unit, sign = axis.effort_unit, axis.rig.mechanism.sign

        def render() -> None:
            state.force = force = field(state.position)
            permitted = limit(force)
            if permitted != permitted:  # true for NaN alone, and faster than a call of math.isnan
                trip(TripKind.NOT_FINITE, force)
                return
            state.target = target = round(permitted * state.gain / effort_unit)
            pack_into(output, offset, state.controlword, sign * target)

        def exchange(after: Field) -> None:
            nonlocal field
            field = after

        return render, exchange
